"""Examinations in addition to the verdict."""
