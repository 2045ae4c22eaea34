"""Checks a robot, data set, study or Python file of a user in seconds, and lists all problems at once."""
