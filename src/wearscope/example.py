"""The example data set that ships with the package."""

from pathlib import Path


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
    return Path(__file__).with_name("example_data")
