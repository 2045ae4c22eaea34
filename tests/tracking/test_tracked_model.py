"""The model that comes out of tracking: wear and temperature as planted, within their intervals."""

import numpy as np
import pytest
from session_machine import COULOMB, HEALTHY, HEAT, MEAN, VISCOUS, write_machine

import wearscope
from wearscope.effects.base import load_effect
from wearscope.home import find_home
from wearscope.robots.fields import EffectEntry
from wearscope.robots.friction import carry_over, find_lacking, friction_torque
from wearscope.robots.model import load_model
from wearscope.tracking.run import track

PLANTED = {"height": 3.0, "width": 0.3, "slope": 0.6}
WORN = {"temperature": MEAN, "worn": tuple(PLANTED.values())}
FELL = {"temperature": MEAN, "wear": -0.25}
SESSIONS = 8


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """Folder and what was told of a machine in many worn sessions, then in one whose friction fell."""
    folder = tmp_path_factory.mktemp("tracked")
    days = [*HEALTHY, *([WORN] * SESSIONS), FELL]
    machine = write_machine(folder / "duo", days, len(HEALTHY), seed=11)
    return folder / "out", track(machine, folder / "out")


@pytest.fixture(scope="module")
def model(tracked):
    return load_model(tracked[0] / "model_tracked.yaml")


@pytest.fixture(scope="module")
def entries(model) -> dict[tuple[str, str], EffectEntry]:
    """Entries of the tracked model by joint and effect."""
    return {(entry.joint, entry.effect): entry for entry in model.effects}


def test_planted_wear_lies_in_its_intervals(tracked):
    told = [one for one in tracked[1]["wear"] if one["joint"] == "a"]
    assert len(told) >= SESSIONS - 1
    held = {"eta7": 0, "eta8": 0, "eta9": 0}
    for one in told:
        for name, value in zip(held, PLANTED.values(), strict=True):
            low, high = one["parameters"][name]["ci95"]
            held[name] += low <= value / one["level"] <= high
    # Five of eight or fewer have a probability of 0.006 at a coverage of 0.95.
    assert min(held.values()) >= len(told) - 2


def test_intervals_of_wear_say_something(tracked):
    for one in tracked[1]["wear"]:
        low, high = (one["level"] * x for x in one["parameters"]["eta7"]["ci95"])
        assert 0.0 < low < 1.1 * PLANTED["height"] and PLANTED["height"] < 2.0 * high < 12.0


def test_friction_that_fell_is_no_wear(tracked):
    last = tracked[1]["sessions"][-1]
    assert last["changes"] and {change["joint"] for change in last["changes"]} == {"a"}
    assert not any(one["session"] == last["session"] for one in tracked[1]["wear"])


def test_model_holds_the_last_worn_session(tracked, entries):
    last = tracked[1]["wear"][-1]
    entry = entries["a", "wear"]
    assert entry.identified and not entry.assumed
    assert entry.parameters["eta7"] == last["parameters"]["eta7"]["value"]
    assert entry.intervals["eta7"] == last["parameters"]["eta7"]["ci95"]
    assert last["session"] in entry.source
    assert ("b", "wear") not in entries


def test_model_wears_as_the_sessions_did(tracked, model):
    level = tracked[1]["wear"][-1]["level"]
    v = np.linspace(0.05, 3.0, 60)
    healthy = friction_torque(model, 0, v, MEAN)
    worn = friction_torque(model, 0, v, MEAN, level) - healthy
    truth = PLANTED["height"] * np.exp(-v / PLANTED["width"]) + PLANTED["slope"] * v
    assert np.sqrt(np.mean((worn - truth) ** 2)) < 0.2 * np.sqrt(np.mean(truth**2))
    np.testing.assert_allclose(healthy, COULOMB[0] + VISCOUS[0] * v, rtol=0.06)
    assert load_effect("wear").needs_wear


@pytest.mark.parametrize(("joint", "k"), [("a", 0), ("b", 1)])
def test_temperature_is_identified_where_healthy_sessions_show_it(entries, joint, k):
    (entry,) = (e for (j, _), e in entries.items() if j == joint and "coulomb_slope" in e.parameters)
    assert entry.identified
    warmth = np.linspace(25.0, 47.0, 200)
    true = np.polynomial.polynomial.polyfit(warmth, np.exp(-HEAT * (warmth - MEAN)), 1)[1]
    low, high = entry.intervals["coulomb_slope"]
    assert low <= true * COULOMB[k] <= high < 0.0


def test_only_what_is_lacking_is_carried_over(model):
    assert find_lacking(model) == [("wear", "b")]
    complete = carry_over(model, load_model("medium", find_home() / "config" / "robots"))
    added = [entry for entry in complete.effects if entry.assumed]
    assert {entry.joint for entry in added} == {"b"}
    kept = [entry for entry in complete.effects if entry.identified and entry.effect == "wear"]
    assert [entry.joint for entry in kept] == ["a"]


def test_tracked_machine_is_simulated_at_a_wear_of_its_own(tracked):
    path = str(tracked[0] / "model_tracked.yaml")
    healthy, worn = (
        wearscope.simulate(path, "point_to_point", wear=[level, 0.0], temperature=35.0, step=0.005, seed=3)
        for level in (0.0, 20.0)
    )
    own = healthy["joint"] == "a"
    moving = own & (healthy["qd"].abs() > 0.1)
    rise = np.sign(healthy["qd"]) * (worn["tau"] - healthy["tau"])
    assert rise[moving].mean() == pytest.approx(0.2 * COULOMB[0], rel=0.6)
