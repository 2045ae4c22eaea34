"""From files to the answer: planted sessions whose answer was wrong or silent before."""

import numpy as np
import pandas as pd
import pytest
from planar_sessions import Planar, write_planar

from wearscope.checking.dataset import check_dataset
from wearscope.errors import InputError
from wearscope.tracking.run import track

SMALL = Planar(
    [(0.4, 1.5), (0.35, 1.0), (0.2, 0.4)], [0.05, 0.07, 0.05], [0.09, 0.2, 0.05], 0.02,
    [-0.7, 0.5, 0.3], 0.4, (0.15, 0.3, 0.45, 0.6),
)  # fmt: skip
LARGE = Planar(
    [(0.9, 20.0), (0.8, 12.0)], [9.0, 5.0], [6.0, 4.0], 1.0, [-0.8, 0.9], 0.45, (0.11, 0.19, 0.31, 0.47)
)
FOUR = Planar(
    [(0.3, 3.0), (0.3, 2.5), (0.25, 1.5), (0.15, 0.8)], [0.6, 0.5, 0.3, 0.1], [0.5, 0.4, 0.2, 0.1], 0.03,
    [-0.6, 0.5, 0.4, 0.3], 0.4, (0.13, 0.27, 0.41, 0.59),
)  # fmt: skip
PENDULUM = Planar([(0.5, 0.7)], [0.15], [0.02], 0.05, [1.2], 1.0, (0.2, 0.4, 0.7, 1.1))


def changes(told, session):
    """Joint, effect and parameter of each change of a session, with its size."""
    (one,) = (s for s in told["sessions"] if s["session"] == session)
    return {(c["joint"], c["effect"], c["parameter"]): c for c in one["changes"]}


def tell(folder, arm, later, healthy=None, seed=0):
    sessions = {"a": {}, "b": {}, "c": {}} | (healthy or {})
    return track(write_planar(folder / "arm", arm, sessions | later, len(sessions), seed), folder / "out")


@pytest.mark.parametrize(("arm", "link", "mass", "at"), [(LARGE, 0, 2.5, 0.6), (FOUR, 2, 0.4, 0.15)])
def test_mass_on_a_middle_link_is_a_body_there_and_nothing_else(arm, link, mass, at, tmp_path):
    told = tell(tmp_path, arm, {"d": {}, "e": {"weight": (link, mass, at)}})
    assert changes(told, "d") == {}
    found = changes(told, "e")
    assert {effect for _, effect, _ in found} == {"payload_error"}
    joint = arm.joints[link]
    body = found[joint, "payload_error", "mass"]
    assert body["unit"] == "kg" and body["since"] == "e"
    assert body["ci95"][0] <= mass <= body["ci95"][1] and body["change"] == pytest.approx(mass, rel=0.15)
    assert found[joint, "payload_error", "moment_x"]["change"] == pytest.approx(mass * at, rel=0.1)


@pytest.mark.parametrize(
    ("arm", "weight", "hand"),
    [(PENDULUM, (0, 0.5, 0.45), 3.0), (LARGE, (1, 2.0, 0.7), 60.0)],
)
def test_healthy_session_moved_by_hand_is_named_and_a_weight_found_without_it(arm, weight, hand, tmp_path):
    def push(t, q):
        sway = np.sin(2.0 * t) + np.sin(3.7 * t + 1.0)
        return -hand * (t > 3.0)[:, None] * (np.sin(q - 1.0) + 0.4 * sway[:, None])

    told = tell(tmp_path, arm, {"d": {}, "e": {"weight": weight}}, {"b": {"torque": push}})
    (left,) = told["reference_scatter"]
    assert left["session"] == "b" and left["joint"] in arm.joints and left["rms"] > 5.0 * left["others"]
    assert told["reference"] == ["a", "c"] and any("session b" in note for note in told["notes"])
    assert changes(told, "d") == {}
    found = changes(told, "e")
    assert {effect for _, effect, _ in found} == {"payload_error"}
    body = found[arm.joints[weight[0]], "payload_error", "mass"]
    assert body["ci95"][0] <= weight[1] <= body["ci95"][1]


@pytest.mark.parametrize(("arm", "joint", "count"), [(PENDULUM, 0, 3), (SMALL, 1, 14)])
def test_pushes_are_no_change_however_many(arm, joint, count, tmp_path):
    moments = np.linspace(1.2, 18.5, count)
    size = 0.5 * float(np.sqrt(np.mean(arm.record(np.random.default_rng(1))[f"tau_j{joint + 1}"] ** 2)))

    def push(t, q):
        own = np.zeros_like(q)
        for k, at in enumerate(moments):
            own[:, joint] += (-1) ** k * size * np.exp(-(((t - at) / 0.2) ** 4))
        return own

    told = tell(tmp_path, arm, {"d": {}, "e": {"torque": push}})
    calm, pushed = told["sessions"]
    assert calm["events"] == [] and calm["changes"] == [] and pushed["changes"] == []
    assert {e["joint"] for e in pushed["events"]} == {arm.joints[joint]}
    found = [e["t"] + 0.5 * e["seconds"] for e in pushed["events"]]
    near = [min(abs(at - t) for t in found) < 0.3 for at in moments]
    assert np.mean(near) > 0.6 or any(arm.joints[joint] in text for text in pushed["cannot_tell"])


def test_what_is_larger_than_the_smallest_visible_change_is_seen(tmp_path):
    arm, joint = LARGE, 0
    told = tell(tmp_path, arm, {"d": {}})
    seen = told["sessions"][0]["smallest_visible"][arm.joints[joint]]
    assert 0.005 < seen["friction"] < 0.6 and seen["mass"] < 0.3 * sum(mass for _, mass in arm.links)
    factors = np.ones(len(arm.joints))
    factors[joint] += 2.0 * seen["friction"]
    mass = 2.0 * seen["mass"]
    later = {"f": {"friction": factors}, "w": {"weight": (joint, mass, 0.5 * arm.links[joint][0])}}
    told = tell(tmp_path / "again", arm, {"d": {}} | later)
    claimed = [c["joint"] for c in told["sessions"][1]["changes"]] + told["sessions"][1]["cannot_tell"]
    assert any(arm.joints[joint] in text for text in claimed)
    body = changes(told, "w")[arm.joints[joint], "payload_error", "mass"]
    assert body["ci95"][0] <= mass <= body["ci95"][1]


@pytest.mark.parametrize(("arm", "joint"), [(SMALL, 0), (LARGE, 1)])
def test_friction_that_differs_as_between_healthy_sessions_is_no_change(arm, joint, tmp_path):
    """No temperature is recorded: what it does is in the differences of the healthy sessions."""
    shares = (0.05, -0.04, 0.01, -0.02)
    healthy = {name: {"friction": 1.0 + share} for name, share in zip("abco", shares, strict=True)}
    worn = np.ones(len(arm.joints))
    worn[joint] = 1.4
    told = tell(tmp_path, arm, {"d": {"friction": 1.06}, "e": {"friction": worn}}, healthy)
    calm, changed = told["sessions"]
    assert calm["changes"] == [] and calm["cannot_tell"] == []
    assert any(f"friction of {arm.joints[joint]} changed by" in text for text in changed["cannot_tell"])


def test_check_refuses_a_session_that_stands_as_track_does(tmp_path):
    folder = write_planar(tmp_path / "arm", PENDULUM, {"a": {}, "b": {}, "c": {}, "d": {}}, 2)
    assert check_dataset(folder).problems == []
    table = pd.read_parquet(folder / "runs" / "d.parquet")
    rng = np.random.default_rng(0)
    for joint in PENDULUM.joints:
        table[f"q_{joint}"] = 0.3 + 1e-4 * rng.standard_normal(len(table))
        table[f"qd_{joint}"] = 0.0
    table.to_parquet(folder / "runs" / "d.parquet")
    assert any("stands still in runs/d.parquet" in text for text in check_dataset(folder).problems)
    with pytest.raises(InputError, match=r"stands still in runs/d\.parquet"):
        track(folder, tmp_path / "out")
