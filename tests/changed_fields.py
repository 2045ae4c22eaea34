"""Changes of YAML files that tests copy."""

from contextlib import contextmanager

import yaml


@contextmanager
def changed_fields(file):
    """Content of a YAML file, written back as the body leaves it."""
    fields = yaml.safe_load(file.read_text())
    yield fields
    file.write_text(yaml.safe_dump(fields))
