"""The command `wearscope`: makes, checks and runs what the rooms offer."""
