"""Divides a study into jobs and lists the source files and data files that each job depends on."""
