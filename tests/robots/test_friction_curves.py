from pathlib import Path

import numpy as np
import pytest

from wearscope.robots.friction import friction_curves
from wearscope.robots.model import load_model

ROBOTS = Path(__file__).parents[2] / "config" / "robots"


def test_curves_are_equation_17():
    model = load_model("medium", ROBOTS)
    curves = friction_curves(model, (30.0, 70.0), (0.0, 50.0), points=20)
    assert set(curves["joint"]) == set(model.wear_joints)
    assert len(curves) == 3 * 2 * 2 * 20
    entry = next(one for one in model.effects if one.joint == "axis_2")
    p = entry.parameters
    rows = curves[(curves["joint"] == "axis_2") & (curves["temperature"] == 30) & (curves["wear"] == 50)]
    v = rows["speed"].to_numpy()
    expected = (
        p["eta0"]
        + (p["eta1"] + p["eta2"] * 30) * np.exp(-((v / (p["eta3"] + p["eta4"] * 30)) ** p["alpha"]))
        + (p["eta5"] + p["eta6"] * 30) * v
        + p["eta7"] * 50 * np.exp(-((v / (p["eta8"] * 50)) ** p["alpha"]))
        + p["eta9"] * 50 * v
    )
    assert rows["torque"].to_numpy() == pytest.approx(expected, rel=1e-9)
    assert v.max() == pytest.approx(model.motion_limits()[0][1])
