"""What the columns of a recording are: traits as hypotheses, which one score compares with the effects."""
