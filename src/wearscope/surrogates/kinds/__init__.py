"""Kinds of surrogate with one interface: each has a function that fits it, and predicts and draws."""
