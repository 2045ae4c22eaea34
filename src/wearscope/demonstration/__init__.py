"""The demonstration: a simulated robot with an effect that its data set does not declare, for diagnosis."""
