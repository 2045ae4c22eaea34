"""One figure a module; each takes result tables and returns a matplotlib figure."""
