"""Prints the JSON Schema of the configuration: ``python -m wearscope.config > config/schema.json``."""

from wearscope.config.reading import make_schema

print(make_schema(), end="")
