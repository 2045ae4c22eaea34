"""What a notebook or a script calls: recordings in, results with tables, plots and a short text out."""
