"""Everything that is wrong with a robot, data set, study, or file of own code: in one list, in seconds."""
