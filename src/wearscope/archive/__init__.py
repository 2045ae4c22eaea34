"""Packs a study into one file, reads such a file from an unknown source safely, and compares two studies."""
