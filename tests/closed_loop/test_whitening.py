"""Drifts of the torque channels do not pass for effects, and effects are found in spite of drifts."""

import shutil

import numpy as np
import pytest
from scipy import signal

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import weigh
from wearscope.closed_loop.selection.levels import take_levels
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.whitening import bridge_uncounted, drift_p_value, find_filter
from wearscope.effects.base import load_effect


def walk(t, q, v, a, rng):
    """Torque that walks at random in every run, with twice the noise of 1 N m and 0.5 N m."""
    steps = np.cumsum(rng.standard_normal(q.shape), axis=0)
    return np.array([2.0, 1.0]) * steps / steps.std(axis=0)


def colour(persistence, runs, length, rng):
    series = []
    for _ in range(runs):
        x = np.zeros(length)
        for i, e in enumerate(rng.standard_normal(length)):
            x[i] = persistence * x[i - 1] + e
        series.append(x)
    return series


@pytest.fixture
def search_of(pose):
    """Search over a data set's folder."""
    return lambda folder: Search(pose(folder), Policy())


@pytest.fixture(scope="module")
def quiet(record_at, pose, tmp_path_factory):
    """A data set of which the declared model lacks nothing."""
    return pose(record_at(tmp_path_factory.mktemp("quiet") / "duo", seed=6))


@pytest.fixture(scope="module")
def walking(record_at, pose, tmp_path_factory):
    """A data set with a Stribeck effect and a random walk."""
    effect = [(0, "stribeck", {"level": 3.0, "speed": 0.3})]
    return pose(record_at(tmp_path_factory.mktemp("walk") / "duo", effect, seed=3, extra_torque=walk))


@pytest.fixture
def planted(walking):
    """Search over it, and the term that was planted."""
    search = Search(walking, Policy())
    candidate = search.problem.candidate(load_effect("stribeck"), 0)
    nearest = int(np.argmin([abs(np.log(shape[0] / 0.3)) for shape in candidate.shapes]))
    return search, Chosen(candidate.at(nearest), (0,))


@pytest.mark.parametrize("persistence", [0.0, 0.5, 0.95, 0.99])
def test_filtered_series_is_white(persistence):
    series = colour(persistence, 4, 800, np.random.default_rng(1))
    taps = find_filter(series, 40)
    assert taps[0] == 1.0
    assert len(taps) == 41
    left = np.concatenate([np.convolve(x, taps)[41:800] for x in series])
    correlation = [np.mean(left[k:] * left[:-k]) / np.mean(left**2) for k in range(1, 20)]
    assert np.abs(correlation).max() < 0.15
    # A white series stays as it is; an autocorrelated one is reduced to what is new in it.
    assert left.var() < 1.1


def test_the_filter_of_a_first_order_autoregression_is_its_own():
    """x_t - phi x_(t-1) is white: the filter is (1, -phi, 0, 0, ...)."""
    taps = find_filter(colour(0.8, 6, 4000, np.random.default_rng(2)), 5)
    np.testing.assert_allclose(taps, [1.0, -0.8, 0.0, 0.0, 0.0, 0.0], atol=0.04)


def test_what_holds_of_a_run_holds_across_rows_that_do_not_count():
    """Lines through the neighbours, the end values beyond: the same combination of columns in every row."""
    rng = np.random.default_rng(5)
    x, keep = rng.standard_normal((10, 3)), np.array([0, 1, 1, 0, 0, 0, 1, 1, 1, 0], dtype=bool)
    bridged = bridge_uncounted(x, keep)
    np.testing.assert_array_equal(bridged[keep], x[keep])
    np.testing.assert_allclose(bridged[3:6], x[2] + np.outer([0.25, 0.5, 0.75], x[6] - x[2]))
    np.testing.assert_array_equal(bridged[[0, 9]], x[[1, 8]])
    weights = np.array([2.0, -1.0, 0.5])
    np.testing.assert_allclose(bridge_uncounted(x @ weights[:, None], keep), bridged @ weights[:, None])
    np.testing.assert_array_equal(bridge_uncounted(x, np.ones(10, dtype=bool)), x)
    assert not bridge_uncounted(x, np.zeros(10, dtype=bool)).any()


def test_silence_is_left_alone():
    assert find_filter([np.zeros(100)] * 3, 5).tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def count_in_turns(assembly, on, off):
    """The same model where rows count `on` in a row and then `off` do not, as about rests of a joint."""
    counts = np.arange(len(assembly.target)) % (on + off) < on
    layout = assembly.layout
    for joint in range(assembly.target.shape[1]):
        layout = layout.restrict(joint, counts)
    return Assembly(layout, assembly.target, assembly.chosen, assembly.sigma)


@pytest.mark.parametrize("off", [0, 12], ids=["whole", "with_gaps"])
def test_slow_effects_are_not_significant_beside_a_walk(record, search_of, off):
    """p-values of effects that are not there: small ones are rare, where block by block they are frequent."""
    beside, plain = [], []
    for seed in range(4):
        folder = record(seed=seed, extra_torque=walk)
        search = search_of(folder)
        shutil.rmtree(folder)
        assembly = count_in_turns(search.assemble(()), 25, off)
        for candidate in search.candidates(assembly, (), (0, 1)):
            if candidate.effect.name not in ("gravity_counterbalance", "joint_spring", "viscous_asymmetry"):
                continue
            subset = tuple(int(k) for k in candidate.effect.subsets()[0])
            e = weigh(assembly, candidate, subset, search.policy)
            plain.append((1 + np.sum(e.chance >= e.statistic)) / (1 + len(e.chance)))
            beside.append(drift_p_value(assembly, e.chosen, e.joint, search.flips))
    beside, plain = np.array(beside), np.array(plain)
    assert len(beside) >= 20
    assert np.mean(plain < 0.01) > 0.2
    assert np.mean(beside < 0.01) <= 0.1
    assert beside.min() > 1e-4


def test_an_effect_is_significant_beside_a_walk(planted):
    search, stribeck = planted
    assert drift_p_value(search.assemble(()), stribeck, 0, search.flips) < 1e-4


def test_what_other_joints_know_of_a_term_absorbs_nothing(planted):
    """A term felt at both joints: columns next to nothing here, or fixed there, take no evidence away."""
    search, stribeck = planted
    plain = search.assemble(())
    alone = drift_p_value(plain, stribeck, 0, search.flips)
    rows = stribeck.rows[0]
    rng = np.random.default_rng(8)

    def ask(here, there):
        spread = Candidate(load_effect("inertial_error"), 1, ((),), (0, 1), (here, there))
        chosen = (*plain.chosen, Chosen(spread, (0,)))
        beside = Assembly(plain.layout, plain.target, chosen, plain.sigma)
        return drift_p_value(beside, stribeck, 0, search.flips)

    noise = rng.standard_normal((len(rows), 1))
    for tiny in (1e-5, 1e-10, 1e-14):
        assert ask(tiny * rows, noise) < 10 * alone
    # The same torque here, and much more of it at the other joint, whose rows fix it.
    assert ask(rows, 1e3 * noise) < 10 * alone
    # Felt here alone it is the term itself.
    assert ask(rows, 0.0 * noise) > 0.5


def test_an_offset_is_not_told_from_the_levels_of_a_walk(record, search_of):
    """Four runs whose levels happen to agree are four numbers, not as many as they have blocks."""

    def levels(t, q, v, a, rng):
        ramp = np.sin(np.pi * t / t[-1] - 0.5 * np.pi)
        return np.column_stack([3.0 + 3.0 * ramp, 0.0 * ramp])

    search = search_of(record(seed=4, extra_torque=levels))
    offset = Chosen(search.problem.candidate(load_effect("torque_offset"), 0), (0,))
    assert drift_p_value(search.assemble(()), offset, 0, search.flips) > 0.5


def test_a_white_residual_is_not_asked_for_drifts(quiet):
    search = Search(quiet, Policy())
    offset = Chosen(search.problem.candidate(load_effect("torque_offset"), 0), (0,))
    assert drift_p_value(search.assemble(()), offset, 0, search.flips) == 0.0


def test_what_other_joints_know_of_a_term_holds_about_its_fit(quiet):
    """A slow torque that a term of the model gives, and another joint measures far better, is no drift."""
    search = Search(quiet, Policy())
    offset = Chosen(search.problem.candidate(load_effect("torque_offset"), 0), (0,))
    plain = search.assemble(())
    rows = len(plain.target)
    slow = np.sin(2 * np.pi * np.arange(rows) / 400.0)[:, None]
    there = 1e3 * np.random.default_rng(9).standard_normal((rows, 1))
    spread = Chosen(Candidate(load_effect("inertial_error"), 1, ((),), (0, 1), (slow, there)), (0,))
    target = plain.target + 5.0 * np.hstack([slow, there])
    beside = Assembly(plain.layout, target, (*plain.chosen, spread), plain.sigma)
    assert drift_p_value(plain, offset, 0, search.flips) == 0.0
    assert drift_p_value(beside, offset, 0, search.flips) == 0.0


def test_the_level_of_a_drift_in_a_single_run_is_no_offset(record, search_of):
    """Over a run as long as its memory a drift has a level on which all parts agree; other runs differ."""

    for seed in range(3):
        levels = iter((7.0, 3.0))

        def wander(t, q, v, a, rng, levels=levels):
            drift = signal.lfilter([1.0], [1.0, -np.exp(-(t[1] - t[0]) / t[-1])], rng.standard_normal(len(t)))
            return np.column_stack([next(levels) + 2.0 * (drift - drift.mean()) / drift.std(), 0.0 * t])

        folder = record(seed=seed, runs=2, duration=10.0, extra_torque=wander)
        search = search_of(folder)
        if not seed:
            left = diagnose(folder)
            assert left.verdict["verdict"] == []
            assert left.states[0].reason.startswith("a level of ")
            assert left.states[1].state == "explained"
        shutil.rmtree(folder)
        offset = Chosen(search.problem.candidate(load_effect("torque_offset"), 0), (0,))
        own = weigh(search.assemble((), standard=True), offset.candidate, offset.subset, search.policy)
        assert rule.is_beyond_chance(own, search.policy, by_run=False)
        assert find_named(search) == []
        # A part of any model from then on, so that no spline takes it for structure; asked once.
        assert take_levels(search, [])
        assert list(search.problem.levels) == [0]
        assert not take_levels(search, [])


def test_a_level_that_the_test_run_has_too_is_an_offset(record):
    def wander(t, q, v, a, rng):
        drift = signal.lfilter([1.0], [1.0, -np.exp(-(t[1] - t[0]) / t[-1])], rng.standard_normal(len(t)))
        return np.column_stack([7.0 + 2.0 * (drift - drift.mean()) / drift.std(), 0.0 * t])

    verdict = diagnose(record(seed=0, runs=2, duration=10.0, extra_torque=wander)).verdict
    (offset,) = verdict["verdict"]
    assert (offset["joint"], offset["effect"], offset["status"]) == ("a", "torque_offset", "confirmed")
    assert offset["in_model"] and offset["parameters"]["offset"]["value"] == pytest.approx(7.0, abs=1.0)


def test_a_level_that_several_recordings_would_tell_is_no_part_of_a_model(quiet):
    assert not take_levels(Search(quiet, Policy()), [])


def test_an_offset_of_a_single_run_is_named(record, search_of):
    folder = record([(0, "torque_offset", {"offset": 2.0})], seed=1, runs=2, duration=10.0)
    assert [f.effect.name for f in find_named(search_of(folder))] == ["torque_offset"]


def test_what_imitates_a_drift_is_asked_for_one_though_it_leaves_none(quiet):
    """Where what is left is white the question is waived, but for one that must always be answered."""
    search = Search(quiet, Policy())
    offset = Chosen(search.problem.candidate(load_effect("torque_offset"), 0), (0,))
    assert drift_p_value(search.assemble(()), offset, 0, search.flips) == 0.0
    assert drift_p_value(search.assemble(()), offset, 0, search.flips, always=True) == 1.0
