"""YAML of plain values, in which no key stands twice."""

from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """Refuses a key that stands twice in a mapping: of two values YAML itself keeps the last, silently."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        keys: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in keys:
                    raise yaml.composer.ComposerError(
                        None, None, f"'{key.value}' stands twice, keep one of them", key.start_mark
                    )
                keys.add((key.tag, key.value))
        return node


def load_plain_yaml(text: str) -> Any:
    """Content of a YAML text.

    Raises
    ------
    yaml.YAMLError
        Where it is no YAML, a key stands twice, or a tag asks for more than plain values.
    ValueError, TypeError, RecursionError
        Where a value is none, or lies too deep.
    """
    return yaml.load(text, _Loader)
