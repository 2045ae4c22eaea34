"""Regression on the signals: terms, fits, predictions, the corrected model."""
