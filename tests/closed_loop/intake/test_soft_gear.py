"""A gear so soft that many wrong columns explain part of it: the data set is taken with a doubt."""

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from changed_fields import write_fields
from planar_sessions import RATE, Planar, describe_arm

from wearscope.checking.dataset import check_dataset

LINKS = [(0.4, 6.0), (0.35, 4.0)]
SIDEWAYS = [0.0, 9.81, 0.0]


@pytest.mark.parametrize(("seed", "size", "off"), [(1, 1.0, 0.2), (5, 1.0, 0.3)])
def test_a_very_soft_gear_is_no_wrong_column(tmp_path, seed, size, off):
    """Joint 1 turns about the vertical; its motor's position is recorded, and masses are off."""
    rng = np.random.default_rng(seed)
    links = [(size * length, mass) for length, mass in LINKS]
    arm = Planar(
        links, [3.0, 2.5], [2.0, 1.5], 0.0, [-0.7, 0.5], 0.3, (0.11, 0.17, 0.29, 0.41), seconds=14.0,
    )  # fmt: skip
    arm.model.gravity.linear[:] = SIDEWAYS
    data, files = arm.model.createData(), []
    (tmp_path / "runs").mkdir()
    for k in range(3):
        q, v, a = arm.move(rng)
        load = np.array([pin.rnea(arm.model, data, *row).copy() for row in zip(q, v, a, strict=True)])
        q[:, 0] += load[:, 0] / 6.0
        v[:, 0] = np.gradient(q[:, 0], 1 / RATE)
        tau = load + arm.coulomb * np.tanh(v / 0.01) + arm.viscous * v
        tau[:, 0] += np.gradient(v[:, 0], 1 / RATE)
        tau += 0.08 * tau.std(axis=0) * rng.standard_normal(tau.shape)
        columns = {
            f"{kind}_{j}": x[:, i]
            for kind, x in (("q", q), ("qd", v), ("tau", tau))
            for i, j in enumerate(arm.joints)
        }
        pd.DataFrame({"t": arm.t} | columns).to_parquet(tmp_path / "runs" / f"r{k}.parquet")
        files.append({"file": f"runs/r{k}.parquet", "use": "test" if k == 2 else "train"})
    lengths, masses = zip(*links, strict=True)
    stated = np.array(masses) * (1.0 + rng.uniform(-off, off, len(links)))
    (tmp_path / "robot.urdf").write_text(describe_arm(lengths, stated, ["0 1 0"] * len(links), raised=0.0))
    robot = {"gravity": SIDEWAYS, "inertials": "trusted"}
    write_fields(tmp_path, arm.joints, RATE, files, ["rigid_body", "rotor_inertia"], robot)
    found = check_dataset(tmp_path)
    assert found.problems == []
    said = [note for note in found.notes if note.startswith("perhaps")]
    assert all(note.startswith("perhaps, though it leaves up to") for note in said)
