"""Diagnostics after the search: what is left at each joint, forward simulation, what to measure next."""
