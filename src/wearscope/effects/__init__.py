"""Joint-torque effects: one file and one object for each, used by identification, simulation and verdict."""
