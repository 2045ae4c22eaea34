"""Fault detectors (the paper's FDAs), one file for each: from a batch to a scalar test quantity."""
