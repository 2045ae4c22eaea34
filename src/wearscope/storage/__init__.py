"""Writes files and tables atomically and with checksums; reads plain YAML and verdicts."""
