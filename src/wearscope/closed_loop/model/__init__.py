"""Regression of the torque on signals of the motion: terms, fits, predictions, the corrected model."""
