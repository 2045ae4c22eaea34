"""Predicts whether a fault detector will find joint wear, and checks the simulator behind that prediction.

These names are for notebooks and scripts; each is imported when it is first used:

- `Study`: reads the results of a study as data frames with units, and its figures;
- `diagnose`: finds what the declared model of a measured machine lacks;
- `track`: finds what has changed since the machine was healthy;
- `detect`: applies fault detectors to recordings;
- `evaluate`: measures how well a model predicts recordings;
- `example_dataset`: returns the folder of the data set that comes with the package;
- `simulate`: simulates and records one run of a robot with given wear, temperature and payload error;
- `InputError`: is raised for bad input, with a message of one sentence.

Examples
--------
>>> import wearscope
>>> run = wearscope.simulate("medium", "axis_sweeps", wear=20.0, seed=1)
>>> list(run.columns), run.attrs["units"]["tau"]
(['t', 'joint', 'q', 'qd', 'tau'], 'N m')
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from wearscope.errors import InputError
    from wearscope.home import example_dataset
    from wearscope.notebook.calls import detect, diagnose, evaluate, track
    from wearscope.notebook.one_run import simulate
    from wearscope.notebook.study import Study

__all__ = [
    "InputError", "Study", "detect", "diagnose", "evaluate", "example_dataset", "simulate", "track",
]  # fmt: skip

_MODULES = {
    "InputError": "wearscope.errors",
    "Study": "wearscope.notebook.study",
    "detect": "wearscope.notebook.calls",
    "diagnose": "wearscope.notebook.calls",
    "evaluate": "wearscope.notebook.calls",
    "track": "wearscope.notebook.calls",
    "example_dataset": "wearscope.home",
    "simulate": "wearscope.notebook.one_run",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == "__version__":
        return import_module("importlib.metadata").version("wearscope")
    if name not in _MODULES:
        raise AttributeError(f"module 'wearscope' has no attribute '{name}'")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
