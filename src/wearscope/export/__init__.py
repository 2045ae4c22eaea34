"""Export of a corrected model for other simulators: URDF, MJCF, Isaac Lab, and a table of parameters."""
