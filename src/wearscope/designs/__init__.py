"""Factors, coded and natural levels, experimental designs and their checks."""
