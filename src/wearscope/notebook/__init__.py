"""Functions for notebooks and scripts: from recordings to results with tables, plots and a short text."""
