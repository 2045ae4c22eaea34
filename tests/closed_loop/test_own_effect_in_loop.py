"""A user's own effect, from a file outside the package to its name in the verdict and its torque."""

import numpy as np
import pytest
import yaml
from folders import change_runs
from own_effects import HOSE, PRESSURE

from wearscope.closed_loop.run import close_loop
from wearscope.cycles.base import Reference
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.simulation.study import simulate_forward

SHAPE = '    shape=(Parameter("k", "1/{position}", default=2.0),),\n'
FIXED = HOSE.replace("shape[0]", "3.0").replace(SHAPE, "")
SMALL = {"runs": 4, "duration": 8.0, "seed": 4}


def drag(t, q, v, a, rng):
    return np.column_stack([5.0 * np.sin(3.0 * q[:, 0]) * np.sign(v[:, 0]), 0.0 * t])


@pytest.fixture
def hose(tmp_path):
    """Effect file outside of package and data set."""
    path = tmp_path / "mine" / "hose.py"
    path.parent.mkdir()
    path.write_text(FIXED)
    return path


def entries(verdict):
    return [(e["joint"], e["effect"]) for e in verdict["verdict"]]


def test_named_on_the_command_line_it_is_named_and_simulated(record, hose, tmp_path):
    folder, out = record(extra_torque=drag, **SMALL), tmp_path / "out"
    verdict = close_loop(folder, out, light=True, effects=[hose])
    assert entries(verdict) == [("a", "hose_drag")]
    (entry,) = verdict["verdict"]
    level = entry["parameters"]["level"]
    assert level["value"] == pytest.approx(5.0, rel=0.05) and level["unit"] == "N m"
    assert level["ci95"][0] < level["value"] < level["ci95"][1]
    assert entry["depends_on"] == ["q_a", "sign_qd_a"] and entry["status"] == "confirmed"

    # The model as it lies there is simulated with the drag, and without it.
    t = np.arange(0.0, 2.0, 1e-3)
    angle = np.outer(t, [2.0, 1.5])
    reference = Reference(
        t, np.sin(angle), [2.0, 1.5] * np.cos(angle), -np.square([2.0, 1.5]) * np.sin(angle)
    )
    after, before = (
        load_model(out / f"model_{stage}.yaml", allow_code=[str(hose)]) for stage in ("after", "before")
    )
    recorded = [simulate_forward(model, reference, declared=before).tau for model in (after, before)]
    own = (recorded[0] - recorded[1])[:, 0]
    expected = level["value"] * np.sin(3.0 * reference.q[:, 0]) * np.sign(reference.v[:, 0])
    moving = (np.abs(reference.v[:, 0]) > 0.3) & (t > 0.3)
    assert np.corrcoef(own[moving], expected[moving])[0, 1] > 0.98
    assert np.std((own - expected)[moving]) < 0.2 * np.std(expected[moving])


@pytest.mark.slow
def test_without_the_file_the_same_torque_has_no_name(record, tmp_path):
    verdict = close_loop(record(extra_torque=drag, **SMALL), tmp_path / "out", light=True)
    assert entries(verdict) == [("a", "unknown")]


@pytest.mark.parametrize("place", ["effects", "declared_effects"])
def test_code_that_a_data_set_names_runs_only_where_it_is_allowed(record, tmp_path, place):
    declared = ["rigid_body", "rotor_inertia", "coulomb", "viscous"]
    fields = {"effects": ["hose.py"]} if place == "effects" else {"declared_effects": [*declared, "hose.py"]}
    folder = record(extra_torque=drag, fields=fields, **SMALL)
    mark = tmp_path / "ran"
    (folder / "hose.py").write_text(f"open({str(mark)!r}, 'w').close()\n{FIXED}")
    with pytest.raises(InputError, match=r"hose\.py: is Python code that a data set names.*allow_code=true"):
        close_loop(folder, tmp_path / "out", light=True)
    assert not mark.exists() and not (tmp_path / "out").exists()
    verdict = close_loop(folder, tmp_path / "out", light=True, allow_code=True)
    assert mark.exists()
    # A candidate is named; what is declared is fitted, and nothing is missing then.
    assert entries(verdict) == ([("a", "hose_drag")] if place == "effects" else [])
    assert verdict["joints"]["a"]["rms_after"] < 0.35
    stage = yaml.safe_load((tmp_path / "out" / "model_after.yaml").read_text())
    (own,) = [e for e in stage["effects"] if e["joint"] == "a" and "hose" in e["effect"]]
    assert own["parameters"]["level"] == pytest.approx(5.0, rel=0.05)


def test_an_effect_with_a_measured_channel_is_named(record, tmp_path):
    """A pressure that is another one in every run; the effect needs it, the simulator does not have it."""
    folder = record(fields={"channels": {"pressure": "bar"}}, **SMALL)
    level = iter(np.arange(30.0, 60.0, 6.0))

    def press(table):
        pressure = next(level) + 2.0 * np.sin(0.7 * table["t"])
        return table.assign(pressure=pressure, tau_a=table["tau_a"] + 0.15 * pressure * table["q_a"])

    change_runs(folder, press)
    own = tmp_path / "pressure.py"
    own.write_text(PRESSURE)
    verdict = close_loop(folder, tmp_path / "out", light=True, effects=[own])
    (entry,) = verdict["verdict"]
    assert entry["effect"] == "balancer_pressure" and entry["equivalent"] == []
    assert entry["depends_on"] == ["pressure", "q_a"]
    area = entry["parameters"]["area"]
    assert area["unit"] == "N m/(bar rad)" and area["value"] == pytest.approx(0.15, rel=0.05)
