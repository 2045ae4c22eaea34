"""A hum is taken out of what the search compares, as it is, and nothing else is."""

import numpy as np
import pytest
from scipy import signal

from wearscope.closed_loop.diagnosis import diagnose, pose_problem
from wearscope.closed_loop.intake.filtering import low_pass
from wearscope.closed_loop.selection import answer
from wearscope.closed_loop.selection.hum import find_hum
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search

AMPLITUDES = (4.0, 2.0)


def humming(*frequencies, in_step=False):
    """Extra torque of both joints, sines with a phase of each run or one of all, and a list that keeps it."""
    kept = []

    def add(t, q, v, a, rng):
        own = np.random.default_rng(int(1e9 * abs(q[0, 0])))
        phases = own.uniform(0.0, 2.0 * np.pi, (len(frequencies), 2)) * (not in_step)
        at = 2.0 * np.pi * np.outer(t, frequencies)[:, :, None]
        kept.append(np.sin(at + phases).sum(axis=1) * AMPLITUDES)
        return kept[-1]

    return add, kept


@pytest.fixture
def find(record_at, tmp_path):
    """Find the problem of a data set, and the hum that is found beside its declared model."""
    count = iter(range(100))

    def find(**kwargs):
        problem = pose_problem(record_at(tmp_path / f"duo{next(count)}", **kwargs))
        search = Search(problem, Policy())
        return problem, find_hum(problem, search.assemble(()), search.policy)

    return find


@pytest.mark.parametrize("frequencies", [(2.37,), (1.9, 3.8)])
@pytest.mark.parametrize("runs", [1, 2, 4])
def test_a_hum_is_taken_out_as_it_is(find, frequencies, runs):
    add, kept = humming(*frequencies)
    problem, hum = find(extra_torque=add, seed=5, runs=runs + 1)
    assert all(len(own) == len(frequencies) for own in hum.frequencies.values())
    assert np.allclose([sorted(own) for own in hum.frequencies.values()], frequencies, atol=0.01)
    band, keep = problem.prepared.band, problem.layout.keep
    filtered = [low_pass(x, band.torque, 200.0) for x in kept[:runs]]
    rows = [np.rint(run.t * 200.0).astype(int) for run in problem.train]
    truth = np.concatenate([x[k] for x, k in zip(filtered, rows, strict=True)])[keep]
    left = truth - hum.torque[keep]
    assert np.sqrt(np.mean(left**2) / np.mean(truth**2)) < 0.15


@pytest.mark.parametrize("colour", [0.0, 0.9, 0.99, 1.0])
def test_noise_has_none(find, colour):
    def add(t, q, v, a, rng):
        noise = signal.lfilter([1.0], [1.0, -colour], rng.standard_normal((len(t), 2)), axis=0)
        return AMPLITUDES * noise / noise.std(axis=0)

    for seed in range(3):
        for runs in (2, 4):
            assert find(extra_torque=add, seed=seed, runs=runs)[1] is None, (seed, runs)


def test_what_runs_share_in_time_is_left_to_terms_that_go_with_it(find):
    assert find(extra_torque=humming(2.37, in_step=True)[0], seed=6, runs=5)[1] is None


@pytest.mark.parametrize("frequency", [6.0 / 9.0, 8.0 / 9.0])
def test_a_line_that_the_motion_has_too_is_none(find, frequency):
    """Both joints' speeds have lines at ninths of a hertz to the sixth, their sizes also further."""
    assert find(extra_torque=humming(frequency)[0], seed=7, runs=5, duration=18.0)[1] is None


@pytest.mark.parametrize(
    ("effect", "values", "names"),
    [
        ("viscous_asymmetry", {"half_difference": 0.4}, ["viscous_asymmetry"]),
        ("joint_spring", {"stiffness": 1.0, "preload": 0.0}, ["joint_spring", "gravity_counterbalance"]),
    ],
)
def test_an_effect_beneath_a_hum_is_named(record, monkeypatch, effect, values, names):
    folder = record([(0, effect, values)], extra_torque=humming(2.37)[0], seed=103, runs=4)
    verdict = diagnose(folder).verdict
    (named,) = verdict["verdict"]
    assert named["joint"] == "a" and named["effect"] in names and named["status"] != "refuted"
    # The hum itself is told, and is in every error.
    assert {j["state"] for j in verdict["joints"].values()} == {"unexplained"}
    assert all("2.3" in j["reason"] for j in verdict["joints"].values())
    assert all(j["rms_after"] > 0.6 * a for j, a in zip(verdict["joints"].values(), AMPLITUDES, strict=True))
    assert sum("2.37 Hz in time" in note for note in verdict["notes"]) == 2
    monkeypatch.setattr(answer, "find_hum", lambda *_: None)
    assert diagnose(folder).verdict["verdict"] == []


@pytest.mark.parametrize("runs", [2, 4])
def test_a_hum_alone_has_no_name(record, runs):
    verdict = diagnose(record(extra_torque=humming(2.37)[0], seed=104, runs=runs)).verdict
    assert verdict["verdict"] == []
    assert {j["state"] for j in verdict["joints"].values()} == {"unexplained"}
