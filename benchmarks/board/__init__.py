"""The attribution board: planted truth by an independent generator, and the scoring of verdicts on it."""
