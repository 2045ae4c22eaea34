"""Evaluation of detectors by surrogates: relevant factors, SNR, scope, and audit by direct simulation."""
