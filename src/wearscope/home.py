"""Finds the workflow, which is next to the package in a clone and inside it in a wheel; and example data."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
#: Folder inside a wheel's package with the files that are at the top of a clone.
_CARRIED = _PACKAGE / "platform"


def find_home() -> Path:
    """Return the folder that holds ``Snakefile``, ``workflow/``, ``config/`` and ``profiles/``.

    Raises
    ------
    FileNotFoundError
        If the package is neither in a clone nor installed from a wheel.
    """
    for folder in (_CARRIED, _PACKAGE.parents[1]):
        if (folder / "Snakefile").is_file() and (folder / "workflow" / "rules").is_dir():
            return folder
    raise FileNotFoundError(
        f"{_PACKAGE}: no Snakefile belongs to it; install wearscope from its wheel again."
    )


def example_dataset() -> Path:
    """Return the folder of a small data set for trials.

    It holds simulated recordings of an arm with three joints (`wearscope.starters.machine`). Its declared
    model lacks a spring at the second joint, and friction at the third that depends on the direction.

    Examples
    --------
    >>> from wearscope import example_dataset
    >>> (example_dataset() / "dataset.yaml").is_file()
    True
    """
    return _PACKAGE / "example_data"
