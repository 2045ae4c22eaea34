"""Files and tables, written whole or not at all, with checksums; readers of plain YAML and of verdicts."""
