"""Joint-torque effects: one file each, one object for identification, simulation and verdict."""
