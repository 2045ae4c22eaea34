"""Hypotheses (traits) of what the columns of a recording hold, compared with missing effects by one score."""
