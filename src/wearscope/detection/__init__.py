"""The study's detectors on recordings: fitted on nominal ones, asked of others of the same motion."""
