"""Test-cycles: one file each, a jerk-limited reference motion of all joints."""
