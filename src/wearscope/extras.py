"""Packages that only some commands need: an extra of the installation holds them."""

import sys
from importlib.util import find_spec

from wearscope.errors import InputError

#: Extra of pyproject.toml and what needs it, by the module.
EXTRAS = {"mujoco": ("export", "an export"), "rosbags": ("ros", "a recording of ROS 2")}


def need(module: str) -> None:
    """Refuse, with the command that installs it, where a module of an extra is missing."""
    if find_spec(module) is None:
        extra, what = EXTRAS[module]
        raise InputError(
            f"{what} needs {module}, which is not installed; install it with "
            f"{sys.executable} -m pip install 'wearscope[{extra}]'"
        )
