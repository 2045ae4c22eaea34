"""Kinds of surrogate behind one interface: `fit(z, y, ...)` gives an object that predicts and draws."""
