"""Will a fault detector find joint wear, and can the simulator that says so be trusted.

For a notebook or a script; each name is imported when it is first used:

- `Study`: results of a study as data frames with units, and its figures;
- `diagnose`: what the declared model of a measured machine lacks;
- `track`: what changed since the machine was healthy;
- `detect`: recordings judged by detectors;
- `evaluate`: how well a model predicts recordings;
- `example_dataset`: where the data set is that ships with the package;
- `simulate`: one recorded run of a robot under given wear, temperature and payload error;
- `InputError`: bad input, said in one sentence.

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
    """Import a public name when it is asked for."""
    if name == "__version__":
        return import_module("importlib.metadata").version("wearscope")
    if name not in _MODULES:
        raise AttributeError(f"module 'wearscope' has no attribute '{name}'")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
