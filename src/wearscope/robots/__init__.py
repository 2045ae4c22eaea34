"""Robots: URDF intake, the model file, rigid-body dynamics."""
