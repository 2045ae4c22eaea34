"""Which terms the declared model lacks: one score of a whole model, and the moves that raise it."""
