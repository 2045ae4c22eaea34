"""A model with plain friction, without wear or temperature."""

import shutil
from pathlib import Path

import yaml


def write_plain_robot(clone: Path) -> str:
    """Write into a clone a model as a closed loop leaves it, and return its path there."""
    medium = clone / "config" / "robots" / "medium"
    model = yaml.safe_load((medium / "model.yaml").read_text())
    model["effects"] = [
        {"joint": joint, "effect": effect, "parameters": values, "source": "fitted"}
        for joint in model["joints"]
        for effect, values in (("coulomb", {"level": 40.0}), ("viscous", {"slope": 10.0}))
    ]
    (clone / "plain.yaml").write_text(yaml.safe_dump(model))
    shutil.copy(medium / "robot.urdf", clone / "robot.urdf")
    return "plain.yaml"
