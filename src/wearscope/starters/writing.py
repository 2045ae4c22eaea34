"""Writes what is generated: new files and folders only, whole or not at all."""

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
    """A text in YAML on one line, also in a list; in quotes where YAML may read something else.

    Such as ``yes``, ``1``, ``a, b``, or a name with an end of line in it.
    """
    plain = re.fullmatch(r"(?:[^\W\d]|[/.])[\w./ -]*", text) and yaml.safe_load(text) == text
    return text if plain else json.dumps(text)


def flow(values: Iterable[object]) -> str:
    """A list in YAML on one line: numbers with six digits, texts as `quote` has them."""
    told = (quote(one) if isinstance(one, str) else f"{one:.6g}" for one in values)
    return f"[{', '.join(told)}]"


def flow_map(values: Mapping[str, float]) -> str:
    """A mapping of names to numbers in YAML on one line."""
    return f"{{{', '.join(f'{quote(name)}: {one:.6g}' for name, one in values.items())}}}"


def _escape(value: object) -> object:
    """Text of a value in a template, without line breaks."""
    return escape_text(value) if isinstance(value, str) else value


_TEMPLATES = Environment(
    loader=PackageLoader("wearscope.starters"),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    finalize=_escape,
)
_TEMPLATES.filters |= {"quote": quote, "flow": flow, "flow_map": flow_map}


def fill_template(template: str, **values: object) -> str:
    """Text of a template of this room."""
    return _TEMPLATES.get_template(f"{template}.jinja").render(**values)


def refuse_existing(*paths: Path) -> None:
    """Refuse to write over what is there.

    Raises
    ------
    InputError
    """
    for path in paths:
        if path.exists():
            raise InputError(f"{path}: is there already; choose another name, or remove it first.")


def write_files(files: Mapping[Path, str]) -> None:
    """Write new files.

    Raises
    ------
    InputError
        Where one is there already, or cannot be written.
    """
    refuse_existing(*files)
    for path, text in files.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror}); choose another place.") from None


def write_schema(folder: Path, fields: type[BaseModel]) -> str:
    """Write the JSON Schema of a YAML file's fields into its folder.

    Parameters
    ----------
    folder : Path
    fields : type

    Returns
    -------
    str
        First line of the YAML file, by which editors find the schema.
    """
    (folder / "schema.json").write_text(
        json.dumps(fields.model_json_schema(), indent=2) + "\n", encoding="utf-8"
    )
    return "# yaml-language-server: $schema=schema.json\n"


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """A folder to fill; it gets its name once all is well and is removed otherwise.

    Raises
    ------
    InputError
        Where there is one already, or it cannot be written.
    """
    refuse_existing(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InputError(f"{target}: cannot be written ({error.strerror}); choose another place.") from None
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
    """Name that a Python file can have.

    Raises
    ------
    InputError
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(f"{what} '{name}': use small letters, digits and '_', and begin with a letter.")
    return name


def check_folder_name(name: str, what: str) -> str:
    """Name that a robot, study or data set can have.

    Raises
    ------
    InputError
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}", name):
        raise InputError(
            f"{what} '{name}': use letters, digits, '_', '-' and '.', begin with a letter or digit, and take "
            "at most 100 characters."
        )
    return name
