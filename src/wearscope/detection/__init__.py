"""The study's detectors on recordings: fitted to nominal ones, then applied to others of the same motion."""
