"""Checks a robot, data set, study or file of own code: all that is wrong in one list, in seconds."""
