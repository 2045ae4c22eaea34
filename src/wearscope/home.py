"""Where the workflow is, next to the package in a clone or inside it in a wheel, and the example data set."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
#: Folder of a wheel's package that holds what a clone holds at its top.
_CARRIED = _PACKAGE / "platform"


def find_home() -> Path:
    """Folder that holds ``Snakefile``, ``workflow/``, ``config/`` and ``profiles/``.

    Raises
    ------
    FileNotFoundError
        Where the package lies in neither a clone nor a wheel.
    """
    for folder in (_CARRIED, _PACKAGE.parents[1]):
        if (folder / "Snakefile").is_file() and (folder / "workflow" / "rules").is_dir():
            return folder
    raise FileNotFoundError(
        f"{_PACKAGE}: no Snakefile belongs to it; install wearscope from its wheel again."
    )


def example_dataset() -> Path:
    """Folder of a small measured data set, to try things on.

    An arm of three joints that the project simulated (`wearscope.starters.machine`): a spring at its second
    joint, and friction that differs by direction at its third, are not in the model that it declares.

    Examples
    --------
    >>> from wearscope import example_dataset
    >>> (example_dataset() / "dataset.yaml").is_file()
    True
    """
    return _PACKAGE / "example_data"
