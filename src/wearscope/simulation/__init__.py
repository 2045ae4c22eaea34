"""Simulation of a robot model in PyBullet under a controller, recorded as a drive would."""
