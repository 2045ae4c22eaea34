"""Writes generated files and folders: only where nothing exists, and whole or not at all."""

import json
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from pydantic import BaseModel

from wearscope.errors import InputError, escape_text
from wearscope.storage.files import FULL, explain_unwritten


def quote(text: str) -> str:
    """Return a text as YAML on one line, in quotes where YAML would read something else.

    Such texts are ``yes``, ``1``, ``a, b``, or a name with a line break.
    """
    plain = re.fullmatch(r"(?:[^\W\d]|[/.])[\w./ -]*", text) and yaml.safe_load(text) == text
    return text if plain else json.dumps(text)


def flow(values: Iterable[object]) -> str:
    """Return a list as YAML on one line; numbers have six digits, texts are quoted where needed."""
    told = (quote(one) if isinstance(one, str) else f"{one:.6g}" for one in values)
    return f"[{', '.join(told)}]"


def flow_map(values: Mapping[str, float]) -> str:
    """Return a mapping of names to numbers as YAML on one line."""
    return f"{{{', '.join(f'{quote(name)}: {one:.6g}' for name, one in values.items())}}}"


def _escape(value: object) -> object:
    """Escape line breaks in a text that a template inserts."""
    return escape_text(value) if isinstance(value, str) else value


_TEMPLATES = Environment(
    loader=PackageLoader("wearscope.starters"),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    finalize=_escape,
)
_TEMPLATES.filters |= {"quote": quote, "flow": flow, "flow_map": flow_map}


def fill_template(template: str, **values: object) -> str:
    """Return the text of a template of this room, filled with values."""
    return _TEMPLATES.get_template(f"{template}.jinja").render(**values)


def refuse_existing(*paths: Path) -> None:
    """Refuse to overwrite files or folders.

    Raises
    ------
    InputError
        Where one of the paths exists.
    """
    for path in paths:
        if path.exists():
            raise InputError(f"{path}: is there already; choose another name, or remove it first.")


def write_files(files: Mapping[Path, str]) -> None:
    """Write new files.

    Raises
    ------
    InputError
        Where a file exists already, or cannot be written.
    """
    refuse_existing(*files)
    for path, text in files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise explain_unwritten(path, error) from None


def write_schema(folder: Path, fields: type[BaseModel]) -> str:
    """Write the JSON Schema of a YAML file's fields into its folder.

    Parameters
    ----------
    folder : Path
    fields : type
        Pydantic model of the fields.

    Returns
    -------
    str
        Comment for the first line of the YAML file, by which editors find the schema.
    """
    (folder / "schema.json").write_text(
        json.dumps(fields.model_json_schema(), indent=2) + "\n", encoding="utf-8"
    )
    return "# yaml-language-server: $schema=schema.json\n"


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder to fill; it is renamed to `target` afterwards, or removed after an error.

    Raises
    ------
    InputError
        Where `target` exists already, or cannot be written.
    """
    refuse_existing(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise explain_unwritten(target, error) from None
    try:
        yield made
        made.chmod(0o755)
        made.rename(target)
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise explain_unwritten(made, error) from None
    finally:
        shutil.rmtree(made, ignore_errors=True)


def check_identifier(name: str, what: str) -> str:
    """Return the name if a Python module can have it.

    Raises
    ------
    InputError
        Where it cannot.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(f"{what} '{name}': use small letters, digits and '_', and begin with a letter.")
    return name


def check_folder_name(name: str, what: str) -> str:
    """Return the name if a robot, study or data set can have it.

    Raises
    ------
    InputError
        Where it cannot.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}", name):
        raise InputError(
            f"{what} '{name}': use letters, digits, '_', '-' and '.', begin with a letter or digit, and take "
            "at most 100 characters."
        )
    return name
