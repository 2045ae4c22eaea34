"""Test-cycles: one file for each, which builds a jerk-limited reference motion of all joints."""
