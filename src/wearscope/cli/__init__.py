"""The command `wearscope`, which makes, checks and runs studies, robots, data sets and diagnoses."""
