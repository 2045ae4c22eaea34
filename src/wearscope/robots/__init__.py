"""Robots: reading of URDFs, the model file, rigid-body dynamics, friction."""
