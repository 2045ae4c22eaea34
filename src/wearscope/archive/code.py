"""Lines of a restored configuration that would let code run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from wearscope.errors import InputError, explain_yaml
from wearscope.storage.plain_yaml import load_plain_yaml

#: Put before the path of code, so that the configuration is refused until the user has written it again.
REFUSED = "refused, read it first: "


def read_settings(path: Path) -> dict[str, Any]:
    """Configuration of an unpacked archive.

    Raises
    ------
    InputError
        Where it holds no plain settings.
    """
    try:
        settings = load_plain_yaml(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path.name}: is no configuration ({explain_yaml(error)}); get the file again."
        ) from None
    if not isinstance(settings, dict):
        raise InputError(f"{path.name}: holds no settings; get the file again.")
    return settings


def refuse_code(settings: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """A configuration whose paths of code are marked as refused, and which allows none.

    Snakemake itself would run Python in a configuration that asks for its template engine by a key with two
    underscores; such keys are taken out.

    Returns
    -------
    dict
    list of str
        What was refused, as ``place: value``.
    """
    refused: list[str] = []

    def walk(value: Any, place: str) -> Any:
        if isinstance(value, Mapping):
            kept = {}
            for key, inner in value.items():
                where = f"{place}.{key}" if place else str(key)
                if str(key).startswith("__"):
                    refused.append(where)
                elif key == "allow_code" and inner not in (False, None, []):
                    refused.append(f"{where}: {inner}")
                    kept[key] = False
                else:
                    kept[key] = walk(inner, where)
            return kept
        if isinstance(value, list):
            return [walk(one, place) for one in value]
        if isinstance(value, str) and value.endswith(".py"):
            refused.append(f"{place}: {value}")
            return f"{REFUSED}{value.removesuffix('.py')}"
        return value

    return walk(settings, ""), refused
