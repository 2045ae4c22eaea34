"""Fault detectors (the paper's FDAs): one file each, a batch in, a scalar test quantity out."""
