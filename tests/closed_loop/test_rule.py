"""The rule on evidence made by hand: why a term is refused, which are tied, which gives the name."""

from dataclasses import replace

import numpy as np
import pytest

from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, Refusal, sum_by_part
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.significance import find_critical
from wearscope.effects.base import load_effect
from wearscope.effects.unknown import SIGNALS

POLICY = Policy()
FREE = [(-np.inf, np.inf)]
#: Of a coefficient and ten codes of its signals.
GENERIC = 11 * FREE
SPREAD = np.array([1.0, -1.0] * 20)


def evidence(name="quadratic_viscous", gain=40.0, noise=0.1, joints=(0,), shape=(), subset=(0,), **changed):
    """Evidence that passes every question, on 40 blocks with an equal gain but for `noise`."""
    effect = load_effect(name)
    rows = tuple(np.ones((4, len(effect.coefficients))) for _ in joints)
    chosen = Chosen(Candidate(effect, joints[0], (shape,), joints, rows), subset)
    change = -gain / len(SPREAD) + noise * SPREAD
    made = Evidence(
        chosen=chosen, joint=joints[0],
        change=change, gain=gain, share=0.3, fitted=0.3, gains=dict.fromkeys(joints, gain),
        left=60.0, torque=0.1, statistic=8.0, chance=np.zeros(9), agreement=1.0, opposed=False,
        informing=4, recordings=4, sine=0.9, blocks=30.0, cancellation=1.0, beta=np.ones(len(subset)),
        tried=1.0, whole=0.3, p_value=0.001,
    )  # fmt: skip
    return replace(made, **changed)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, Refusal.NONE),
        ({"refusal": Refusal.FULL}, Refusal.FULL),
        ({"share": 0.5 * POLICY.material_share}, Refusal.IMMATERIAL),
        ({"share": 2.0 * POLICY.material_share}, Refusal.NONE),
        # What of its torque no other term could give: 0.9 of it here.
        ({"torque": 0.5 / 0.9 * POLICY.material_torque}, Refusal.ABSORBED),
        ({"torque": 2.0 / 0.9 * POLICY.material_torque}, Refusal.NONE),
        # Of a torque half of which, RMS, changes along the runs: the rest no filter and no clock can spoil.
        ({"torque": 0.501 / 0.9 * POLICY.material_torque, "varies": 0.5}, Refusal.NONE),
        ({"torque": 0.499 / 0.9 * POLICY.material_torque, "varies": 0.5}, Refusal.ABSORBED),
        ({"torque": 0.01, "sine": 0.5 * POLICY.material_torque / 0.01}, Refusal.ABSORBED),
        ({"torque": 0.01, "sine": 2.0 * POLICY.material_torque / 0.01}, Refusal.NONE),
        ({"whole": 0.5 * POLICY.material_whole}, Refusal.IMMATERIAL),
        ({"whole": 2.0 * POLICY.material_whole}, Refusal.NONE),
        ({"informing": 1}, Refusal.LOCAL),
        ({"cancellation": 12.1}, Refusal.CANCELS),
        ({"torque": 12.1}, Refusal.CANCELS),
        ({"cancellation": 11.9, "torque": 11.9}, Refusal.NONE),
        # More than the joint's torque, of which others take back nearly all: a spring and its opposite.
        ({"torque": 9.2, "sine": 0.001}, Refusal.CANCELS),
        ({"torque": 1.01, "sine": 0.083}, Refusal.CANCELS),
        ({"torque": 1.01, "sine": 0.084}, Refusal.NONE),
        ({"torque": 0.99, "sine": 0.083}, Refusal.NONE),
        ({"beta": np.array([-0.1])}, Refusal.BOUNDS),
        ({"beta": np.array([2.1])}, Refusal.BOUNDS),
        ({"beta": np.array([2.0])}, Refusal.NONE),
        ({"beta": np.array([0.04])}, Refusal.SMALL),
        ({"p_value": 2.0 * POLICY.family_level}, Refusal.CHANCE),
        ({"p_value": 1.0, "share": 0.5, "fitted": 0.5}, Refusal.NONE),
        # What gains on held-out runs alone keeps the model from running away there.
        ({"p_value": 1.0, "share": 0.9, "fitted": 0.49}, Refusal.CHANCE),
        ({"p_value": 1.0, "share": 0.49, "fitted": 0.9}, Refusal.CHANCE),
        ({"p_value": 1.0, "share": 0.69, "fitted": 0.7, "informing": 2}, Refusal.CHANCE),
        ({"p_value": 1.0, "share": 0.7, "fitted": 0.7, "informing": 2}, Refusal.NONE),
        ({"p_value": 1.0, "share": 0.5, "fitted": 0.5, "informing": 3}, Refusal.NONE),
        ({"p_value": 1.0, "share": 0.5, "fitted": 0.5, "agreement": 0.99}, Refusal.CHANCE),
        ({"agreement": 0.75}, Refusal.NONE),
        ({"agreement": 0.75, "opposed": True}, Refusal.DISAGREES),
        ({"agreement": 0.5}, Refusal.DISAGREES),
        ({"agreement": 0.8}, Refusal.NONE),
        ({"agreement": 0.8, "opposed": True}, Refusal.NONE),
        ({"blocks": 1.0}, Refusal.NONE),
    ],
)
def test_each_refusal_has_its_reason(changed, why):
    assert rule.judge(evidence(**changed), POLICY, [(0.0, 2.0)], 0.05, by_run=True) is why


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, Refusal.NONE),
        ({"blocks": 3.9}, Refusal.LOCAL),
        ({"blocks": 4.0}, Refusal.NONE),
        # One event lies in one part, from which the others predict nothing.
        ({"blocks": 3.4, "share": 0.7, "fitted": 0.7, "informing": 3}, Refusal.NONE),
        ({"blocks": 3.4, "share": 0.7, "fitted": 0.7, "informing": 2}, Refusal.LOCAL),
        ({"blocks": 3.4, "share": 0.69, "fitted": 0.9, "informing": 3}, Refusal.LOCAL),
        ({"blocks": 3.4, "share": 0.9, "fitted": 0.69, "informing": 3}, Refusal.LOCAL),
        ({"blocks": 3.4, "share": 0.9, "fitted": 0.9, "informing": 3, "agreement": 0.9}, Refusal.LOCAL),
        ({"agreement": 0.79}, Refusal.DISAGREES),
        ({"agreement": 0.8}, Refusal.NONE),
        ({"agreement": 0.8, "opposed": True}, Refusal.DISAGREES),
        ({"p_value": 1.0, "share": 0.6, "fitted": 0.9}, Refusal.CHANCE),
        ({"p_value": 1.0, "share": 0.7, "fitted": 0.7}, Refusal.NONE),
    ],
)
def test_more_is_asked_of_parts_of_a_single_run(changed, why):
    assert rule.judge(evidence(**changed), POLICY, FREE, 0.0, by_run=False) is why


def test_what_is_asked_for_more_than_a_number_is_not_given_by_the_number():
    relieving = evidence("rotor_inertia", relief=POLICY.unexpected**2, fitted=0.0)
    assert not rule.relieves(relieving, POLICY)
    relieving = replace(relieving, relief=10.0 * relieving.relief)
    assert rule.relieves(relieving, POLICY)
    assert not rule.relieves(replace(relieving, fitted=POLICY.material_whole), POLICY)
    # Of four parameters as improbable as three standard errors of one: chi-square of four, 16.25.
    for relief, there in ((16.2, False), (16.3, True)):
        load = evidence("payload_error", subset=(0, 1, 2, 3), relief=relief, fitted=0.0)
        assert rule.relieves(load, POLICY) is there
    just = evidence("rotor_inertia", relief=10.0 * POLICY.unexpected**2, fitted=0.0, beta=np.array([0.05]))
    for least, why in ((0.05, Refusal.NONE), (0.051, Refusal.SMALL)):
        assert rule.judge(just, POLICY, [(0.0, 2.0)], least, by_run=True) is why
    # Ten of the loss, a quarter of what the better one leaves; and a hundredth of what a large one gains.
    apart = Policy(material_apart=0.25)
    better, worse = (evidence(gain=gain, noise=0.0, left=40.0) for gain in (40.0, 30.0))
    assert not rule.separates(better, worse, apart)
    assert rule.separates(better, worse, Policy(material_apart=0.249))
    rich = evidence("gravity_counterbalance", subset=(0, 1, 2), gain=1000.0, noise=0.0)
    assert not rule.separates_names(rich, evidence("joint_spring", gain=990.0, noise=0.0), POLICY)


def test_alike_is_up_to_its_factor():
    assert rule.is_alike(POLICY.alike, 1.0, POLICY) and rule.is_alike(1.0, POLICY.alike**2, POLICY)
    # Errors (RMS) within 1.5: what is left, 0.25 of it, within 2.25 of that.
    best, like, unlike = (evidence(fitted=fitted) for fitted in (0.75, 0.4375, 0.4374))
    assert rule.fit_alike([like, unlike, best], POLICY) == [like, best]
    # A fifth of the rows are away from reversals, beyond a fifth of the largest speed.
    speed, kept = np.array([-1.0, 0.2, -0.2, 0.1, 0.0]), np.ones(5, dtype=bool)
    assert rule.find_fast(speed, kept, POLICY).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(
    ("name", "changed", "why"),
    [
        ("warm_up_drift", {}, Refusal.NONE),
        ("warm_up_drift", {"blocks": 3.4}, Refusal.NONE),
        ("warm_up_drift", {"share": 0.69}, Refusal.LOCAL),
        ("warm_up_drift", {"fitted": 0.69}, Refusal.LOCAL),
        ("temperature_dependent_friction", {}, Refusal.LOCAL),
        ("quadratic_viscous", {}, Refusal.LOCAL),
    ],
)
def test_a_warm_up_may_be_over_in_the_first_part(name, changed, why):
    shape = tuple(p.default for p in load_effect(name).shape)
    e = evidence(name, shape=shape, **({"informing": 1, "share": 0.7, "fitted": 0.7} | changed))
    for by_run in (True, False):
        assert rule.judge(e, POLICY, (1 + len(shape)) * FREE, 0.0, by_run=by_run) is why
    assert rule.is_beyond_chance(e, POLICY, by_run=False) is (why is Refusal.NONE)


def test_a_constant_torque_is_as_likely_a_drift_in_few_runs():
    """As asymmetric friction is while the joint moves; not where it removes what no drift of few runs is."""
    for name, sure in (("torque_offset", False), ("coulomb_asymmetry", False), ("quadratic_viscous", True)):
        e = evidence(name, informing=3, share=0.53, fitted=0.53)
        assert rule.is_beyond_chance(e, POLICY, by_run=True) is sure
        assert rule.is_beyond_chance(replace(e, share=0.7, fitted=0.7), POLICY, by_run=True)


@pytest.mark.parametrize("name", ["warm_up_drift", "temperature_dependent_friction"])
def test_what_goes_with_time_is_as_likely_a_drift_in_few_runs(name):
    """Of torques that drift at random, in every fourth set of three runs all start on the same side."""
    shape = tuple(p.default for p in load_effect(name).shape)
    bounds = (2 + len(shape)) * FREE

    def judge(share):
        e = evidence(name, shape=shape, informing=3, p_value=0.03, share=share, fitted=share)
        return rule.judge(e, POLICY, bounds[: 1 + len(shape)], 0.0, by_run=True)

    assert judge(0.66) is Refusal.CHANCE
    assert judge(0.75) is Refusal.NONE


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, Refusal.NONE),
        ({"relief": 0.99 * POLICY.unexpected**2}, Refusal.ABSORBED),
        ({"relief": np.nan}, Refusal.ABSORBED),
        # Where the data themselves ask for it, they decide.
        ({"fitted": 1.01 * POLICY.material_whole}, Refusal.ABSORBED),
        ({"name": "torque_constant_error"}, Refusal.ABSORBED),
        ({"beta": np.array([-1.0])}, Refusal.BOUNDS),
    ],
)
def test_a_drive_s_inertia_that_links_could_hold_only_unbelievably_is_there(changed, why):
    held = {"name": "rotor_inertia", "relief": 1.01 * POLICY.unexpected**2, "beta": np.ones(1)}
    held |= {"sine": 0.0, "share": 0.0, "fitted": 0.0, "p_value": 1.0, "agreement": 0.0}
    e = evidence(**(held | changed))
    assert rule.judge(e, POLICY, [(0.0, np.inf)], 0.0, by_run=True) is why
    if why is not Refusal.BOUNDS:
        assert rule.is_needed(e, POLICY, by_run=True) is (why is Refusal.NONE)


def test_nan_is_not_taken_for_evidence():
    """A p-value that nobody worked out and a share that is not a number must not pass."""
    for changed in ({"p_value": np.nan}, {"share": np.nan}, {"torque": np.nan}, {"agreement": np.nan}):
        e = evidence(**changed)
        assert rule.judge(e, POLICY, FREE, 0.0, by_run=True) is not Refusal.NONE, changed


def test_generic_structure_needs_more_than_a_name():
    for changed, why in (
        ({}, Refusal.NONE),
        ({"share": 0.5 * POLICY.structure_share}, Refusal.IMMATERIAL),
        ({"share": 2.0 * POLICY.structure_share}, Refusal.NONE),
        ({"whole": 0.5 * POLICY.large_share}, Refusal.IMMATERIAL),
        ({"p_value": 2.0 * POLICY.unknown_level}, Refusal.CHANCE),
    ):
        e = evidence("unknown", shape=(0.0,) * 10, **changed)
        assert rule.judge(e, POLICY, GENERIC, 0.0, by_run=True, generic=True) is why
    # Columns of a spline cancel each other as they like; a single run shows nothing of other motions.
    e = evidence("unknown", shape=(0.0,) * 10, cancellation=1e6)
    assert rule.judge(e, POLICY, GENERIC, 0.0, by_run=False, generic=True) is Refusal.ALONE


@pytest.mark.parametrize("place", [0, 5])
@pytest.mark.parametrize(
    ("signal", "source", "known"),
    [("q", 0, True), ("load", 0, True), ("q", 1, False), ("temp", 0, False), ("t", 0, False)],
)
def test_two_runs_show_structure_in_a_joint_s_own_motion_alone(place, signal, source, known):
    shape = [0.0] * 10
    shape[place], shape[place + 1] = float(SIGNALS.index(signal)), float(source)
    for recordings in (2, 3):
        e = evidence("unknown", shape=tuple(shape), recordings=recordings)
        why = Refusal.NONE if known or recordings == 3 else Refusal.ALONE
        assert rule.judge(e, POLICY, GENERIC, 0.0, by_run=True, generic=True) is why


def test_a_single_run_shows_that_another_joint_drives_a_torque_only_beyond_doubt():
    for share, fitted, by_run, why in (
        (0.71, 0.71, False, Refusal.NONE), (0.69, 0.71, False, Refusal.ALONE),
        (0.71, 0.69, False, Refusal.ALONE), (0.3, 0.3, True, Refusal.NONE),
    ):  # fmt: skip
        e = evidence("cross_coupling", shape=(1.0,), share=share, fitted=fitted)
        assert rule.judge(e, POLICY, 2 * FREE, 0.0, by_run) is why
    assert rule.judge(evidence(), POLICY, FREE, 0.0, by_run=False) is Refusal.NONE


def test_parts_of_one_run_agree_but_for_noise_and_runs_for_the_most():
    for agreement, opposed, by_run, agrees in (
        (0.8, True, True, True), (0.79, False, True, False), (1.0, False, False, True),
        (0.8, False, False, True), (0.8, True, False, False), (0.79, False, False, False),
    ):  # fmt: skip
        e = evidence("torque_offset", agreement=agreement, opposed=opposed)
        assert rule.agrees(e, POLICY, by_run) is agrees, (agreement, opposed, by_run)
        assert rule.is_needed(e, POLICY, by_run) is agrees, (agreement, opposed, by_run)


def test_a_standard_term_may_be_small_but_not_chance():
    e = evidence("coulomb", share=0.011, whole=0.0)
    assert rule.judge(e, POLICY, FREE, 0.0, by_run=True) is Refusal.NONE
    assert rule.is_needed(e, POLICY, by_run=True)
    assert not rule.is_needed(replace(e, share=0.009), POLICY, by_run=True)
    assert not rule.is_needed(replace(e, torque=0.5 * POLICY.material_torque), POLICY, by_run=True)
    assert not rule.is_needed(replace(e, sine=1e-4), POLICY, by_run=True)
    # Of a joint's plain friction no accuracy of filters is asked where it explains much.
    for name, share, kept in (
        ("coulomb", 0.101, True),
        ("coulomb", 0.099, False),
        ("rotor_inertia", 0.101, False),
    ):
        small = evidence(name, share=share, fitted=0.101, torque=0.5 * POLICY.material_torque)
        assert rule.is_needed(small, POLICY, by_run=True) is kept
        assert (rule.judge(small, POLICY, FREE, 0.0, by_run=True) is Refusal.NONE) is kept
    noisy = evidence("coulomb", gain=2.0, noise=1.0, share=0.011)
    assert not rule.is_needed(noisy, POLICY, by_run=True)


def test_an_offset_beside_what_was_found_must_matter_beside_that():
    """Every drive has friction, however small; a hundredth of a ripple's size is the ripple's own form."""
    e = evidence("torque_offset", share=0.11, whole=0.5 * POLICY.material_whole)
    assert not rule.is_needed(e, POLICY, by_run=True)
    assert not rule.is_needed(replace(e, whole=np.nan), POLICY, by_run=True)
    assert rule.is_needed(replace(e, whole=POLICY.material_whole), POLICY, by_run=True)
    rest = {"share": POLICY.beyond_doubt, "fitted": POLICY.beyond_doubt, "informing": 4}
    assert rule.is_needed(replace(e, **rest), POLICY, by_run=True)
    for name in ("coulomb", "viscous", "rotor_inertia"):
        assert rule.is_needed(evidence(name, share=0.11, whole=0.0), POLICY, by_run=True), name


def test_one_run_in_three_may_lose_within_its_noise():
    """A weak one loses in some run by chance; not what a drift resembles, of which few runs are few parts."""
    for name, shape in (("coulomb", ()), ("viscous", ()), ("rotor_inertia", ()), ("stribeck", (1.0, 1.0))):
        e = evidence(name, shape=shape, informing=3, agreement=0.66)
        bounds = (1 + len(shape)) * FREE
        assert rule.is_needed(e, POLICY, by_run=True), name
        assert rule.judge(e, POLICY, bounds, 0.0, by_run=True) is Refusal.NONE, name
        for changed, by_run in (
            ({"agreement": 0.5}, True), ({"opposed": True}, True), ({}, False), ({"by_fifths": True}, True),
        ):  # fmt: skip
            other = replace(e, **changed)
            assert rule.judge(other, POLICY, bounds, 0.0, by_run) is Refusal.DISAGREES, (
                name,
                changed,
                by_run,
            )
    for name in ("torque_offset", "warm_up_drift", "temperature_dependent_friction", "unknown"):
        assert not rule.agrees(evidence(name, shape=(1.0,) * 2, agreement=0.75), POLICY, by_run=True), name


def test_an_offset_which_no_drive_must_have_is_asked_as_any_name_is():
    for name in ("coulomb", "viscous", "rotor_inertia"):
        assert load_effect(name).is_in_every_drive
    for changed, why in (
        ({}, Refusal.NONE),
        ({"share": 0.5 * POLICY.material_share}, Refusal.IMMATERIAL),
        ({"whole": 0.5 * POLICY.material_whole}, Refusal.IMMATERIAL),
    ):
        assert rule.judge(evidence("torque_offset", **changed), POLICY, FREE, 0.0, by_run=True) is why


def test_a_standard_term_without_which_the_parts_run_away_is_needed():
    """One part gains far more than the others: that is no scatter of a gain that could be nil."""
    change = np.full(40, -3.0)
    change[-1] = -4000.0
    away = evidence("rotor_inertia", change=change, gain=4117.0, share=0.9, fitted=0.9)
    gain, error = rule.summed(-change)
    assert gain < 2.0 * error
    assert rule.is_needed(away, POLICY, by_run=True)
    for changed in ({"share": 0.49}, {"fitted": 0.49}, {"agreement": 0.9}):
        assert not rule.is_needed(replace(away, **changed), POLICY, by_run=True), changed


def test_friction_that_explains_much_is_kept_where_it_gains_in_most_runs():
    """What every joint has is not asked for its standard error there; what it may have is."""
    for name in ("viscous", "coulomb"):
        e = evidence(name, gain=0.5, noise=1.0, share=0.1, fitted=0.1, agreement=0.6)
        assert rule.is_needed(e, POLICY, by_run=True), name
        for changed in ({"share": 0.09}, {"fitted": 0.09}, {"agreement": 0.5}, {"sine": 1e-4}):
            assert not rule.is_needed(replace(e, **changed), POLICY, by_run=True), (name, changed)
    for name in ("rotor_inertia", "torque_offset"):
        error = rule.summed(-evidence(name, noise=1.0).change)[1]
        for gain, kept in ((3.03 * error, True), (2.97 * error, False)):
            e = evidence(name, gain=gain, noise=1.0, share=0.1, fitted=0.1)
            assert rule.is_needed(e, POLICY, by_run=True) is kept, (name, gain)
            assert not rule.is_needed(replace(e, agreement=0.6), POLICY, by_run=True), name
        # An offset, which a drift resembles, is asked of nearly all runs.
        assert rule.is_needed(evidence(name, agreement=0.7), POLICY, by_run=True) is (name != "torque_offset")


def test_what_a_joint_may_have_is_asked_for_more_than_the_friction_it_has():
    """An offset of two and a half standard errors is chance, as there are several joints to have one."""
    error = rule.summed(-evidence(noise=1.0).change)[1]
    for name, kept in (
        ("coulomb", True),
        ("viscous", True),
        ("torque_offset", False),
        ("rotor_inertia", False),
    ):
        e = evidence(name, gain=2.5 * error, noise=1.0, share=0.03, fitted=0.03)
        assert rule.is_needed(e, POLICY, by_run=True) is kept


def test_more_of_the_whole_is_asked_where_a_single_run_was_recorded():
    for whole, by_run, why in (
        (1.1 * POLICY.material_whole, True, Refusal.NONE),
        (0.99 * POLICY.material_alone, False, Refusal.IMMATERIAL),
        (1.01 * POLICY.material_alone, False, Refusal.NONE),
    ):
        e = evidence(whole=whole)
        assert rule.judge(e, POLICY, FREE, 0.0, by_run) is why


def test_a_generic_term_that_gains_by_other_joints_is_none():
    for share, why in ((0.99, Refusal.NONE), (1.0, Refusal.NONE), (1.01, Refusal.DISAGREES)):
        e = evidence("unknown", shape=(0.0,) * 10, share=share)
        assert rule.judge(e, POLICY, GENERIC, 0.0, by_run=True, generic=True) is why
    assert rule.judge(evidence(share=1.01), POLICY, FREE, 0.0, by_run=True) is Refusal.NONE


def test_a_simpler_term_that_fits_far_worse_is_not_tied():
    """Held-out losses tell neither from the other; of the fitted rows one leaves 1 %, one 2 or 3 %."""
    richer = evidence("gravity_counterbalance", subset=(0, 1, 2), fitted=0.99)
    for fitted, name in ((0.98, "viscous"), (0.97, "gravity_counterbalance")):
        simple = evidence("viscous", gain=39.9, fitted=fitted)
        assert not rule.separates(richer, simple, POLICY)
        assert rule.choose([richer, simple], POLICY).term.effect.name == name
    assert rule.fit_alike([], POLICY) == []


def test_the_rule_changes_nothing_it_is_given():
    e = evidence()
    before = {name: np.copy(getattr(e, name)) for name in ("change", "beta", "chance", "gain", "p_value")}
    rule.judge(e, POLICY, FREE, 0.0, by_run=True)
    rule.choose([e, evidence("stribeck", 41.0, shape=(0.3, 1.0))], POLICY)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(e, name), value)
    with pytest.raises(AttributeError):
        e.gain = 0.0


def test_sum_and_error_are_those_of_the_blocks_that_are_held_out():
    values = np.array([1.0, 3.0, np.nan, 2.0, np.nan])
    total, error = rule.summed(values)
    assert total == 6.0
    assert error == pytest.approx(np.sqrt(3.0) * np.std([1.0, 3.0, 2.0], ddof=1))


def test_terms_are_told_apart_materially_and_outside_their_noise():
    best = evidence(gain=40.0, noise=0.0)
    # Two in a hundred of what the better one leaves, 60, are 1.2.
    assert not rule.separates(best, evidence(gain=38.9, noise=0.0), POLICY)
    assert rule.separates(best, evidence(gain=38.7, noise=0.0), POLICY)
    # A standard error of the difference of 1 x sqrt(40) x 40/39 ...: 10 lies within two of them.
    assert not rule.separates(best, evidence(gain=30.0, noise=1.0), POLICY)
    assert rule.separates(best, evidence(gain=25.0, noise=1.0), POLICY)
    assert not rule.separates(evidence(gain=25.0, noise=0.0), best, POLICY)


def test_a_simpler_name_of_a_large_term_is_told_apart_by_a_part_of_it():
    """A spring that hardens by some per cent is still a spring: of 1000 removed, ten do not count."""
    richer = evidence("gravity_counterbalance", subset=(0, 1, 2), gain=1000.0, noise=0.0)
    for gain, apart in ((990.1, False), (989.9, True)):
        simpler = evidence("joint_spring", subset=(0, 1), gain=gain, noise=0.0)
        assert rule.separates(richer, simpler, POLICY)
        assert rule.separates_names(richer, simpler, POLICY) is apart
    # One as rich is none the less another form, and what is not told apart at all is none the more.
    simple = evidence("joint_spring", subset=(0, 1), gain=1000.0, noise=0.0)
    assert rule.separates_names(
        simple, evidence("torque_ripple", subset=(0, 1), gain=995.0, noise=0.0), POLICY
    )
    noisy = evidence(gain=30.0, noise=1.0)
    assert not rule.separates_names(evidence(gain=40.0, noise=0.0), noisy, POLICY)


def test_few_blocks_tell_less():
    """Two standard errors of normal noise are 4.5 where three blocks inform."""
    assert find_critical(POLICY.told_apart, 10_000) == pytest.approx(2.0, abs=1e-3)
    assert find_critical(POLICY.told_apart, 3) == pytest.approx(4.53, abs=0.01)
    assert find_critical(POLICY.told_apart, 1.2) > 13.0
    best, worse = evidence(gain=40.0, noise=0.0), evidence(gain=25.0, noise=1.0)
    assert rule.separates(best, worse, POLICY)
    assert not rule.separates(best, replace(worse, blocks=4.0), POLICY)
    assert not rule.separates(replace(best, blocks=4.0), worse, POLICY)


def test_a_delay_is_alike_within_a_factor_and_of_one_sign():
    for other, same in ((2.0, True), (4.4, True), (4.6, False), (1.4, True), (1.3, False), (-2.0, False)):
        assert rule.is_alike(2.0, other, POLICY) is same, other


def test_rows_away_from_reversals_are_asked_only_where_there_are_some():
    speed = np.array([0.0, 0.1, -0.5, 1.0, -1.0])
    kept = np.ones(5, dtype=bool)
    assert rule.find_fast(speed, kept, POLICY).tolist() == [False, False, True, True, True]
    # The share is of the largest speed, whatever that is.
    assert rule.find_fast(7.0 * speed, kept, POLICY).tolist() == [False, False, True, True, True]
    # Of those that count, none is fast.
    assert rule.find_fast(speed, np.array([True, True, False, False, False]), POLICY) is None


def test_noise_that_two_terms_share_does_not_tie_them():
    """Held-out losses are compared block by block: what both leave alike cancels."""
    best, worse = evidence(gain=40.0, noise=5.0), evidence(gain=35.0, noise=5.0)
    assert rule.separates(best, worse, POLICY)


def test_the_simplest_of_those_tied_gives_the_name():
    stribeck = evidence("stribeck", 40.0, shape=(0.3, 1.0))
    simple = evidence("quadratic_viscous", 39.5)
    rich = evidence("cross_coupling", 39.9, shape=(1.0,), subset=(0, 1))
    assert stribeck.complexity > simple.complexity
    assert rule.choose([stribeck, simple, rich], POLICY) is simple
    # Told apart from the best, it is not asked.
    assert rule.choose([stribeck, evidence("quadratic_viscous", 30.0, noise=0.1)], POLICY) is stribeck
    # Of equals, what gains most.
    other = evidence("viscous_asymmetry", 39.7)
    assert other.complexity == simple.complexity
    assert rule.choose([simple, other], POLICY) is other and rule.choose([other, simple], POLICY) is other


def test_a_term_felt_elsewhere_is_not_tied():
    best = evidence("stribeck", 40.0, shape=(0.3, 1.0))
    elsewhere = evidence("quadratic_viscous", 39.9, joints=(1,))
    assert rule.choose([best, elsewhere], POLICY) is best
    wide = evidence("payload_error", 39.9, joints=(0, 1), subset=(0,))
    assert rule.touches(best, wide) and rule.touches(wide, elsewhere)
    assert not rule.touches(best, elsewhere)


def test_nothing_able_is_no_name():
    assert rule.choose([], POLICY) is None


def test_what_is_built_against_gravity_is_preferred_only_where_it_works_against_it():
    spring = evidence("joint_spring", 40.0, subset=(0, 1))
    balance = evidence("gravity_counterbalance", 39.0, subset=(0, 1))
    assert spring.complexity == balance.complexity
    assert rule.simplest([spring, balance]) is spring
    assert rule.simplest([spring, balance], [balance]) is balance


def test_a_coefficient_at_its_bound_is_believed():
    assert rule.judge(evidence(beta=np.zeros(1)), POLICY, [(0.0, 2.0)], 0.0, by_run=True) is Refusal.NONE


def test_a_shape_beyond_what_is_built_is_refused():
    for displacement, why in ((0.14, Refusal.NONE), (0.16, Refusal.BOUNDS)):
        e = evidence("presliding_hysteresis", shape=(displacement,))
        assert rule.judge(e, POLICY, [*FREE, (0.0, 0.15)], 0.0, by_run=True) is why


def test_only_what_gains_where_a_term_does_may_stand_in_its_place():
    """A lost motion gains a little at three joints; an offset gains more, at the last alone."""
    lost = evidence("backlash", joints=(0, 1, 2), gains={0: 30.0, 1: 25.0, 2: 20.0})
    for gains, replaces in (
        ({2: 200.0}, False),
        ({0: 30.0, 1: 8.0}, True),
        ({0: 30.0, 1: 7.0}, False),
        ({0: 15.0, 1: 12.0, 2: 11.0}, True),
        ({0: -5.0, 1: 25.0, 2: 10.0}, False),
        ({}, False),
    ):
        assert rule.gains_there(evidence("torque_offset", gains=gains), lost) is replaces
    assert rule.gains_there(lost, lost)
    # Where it gains nothing itself, nobody needs to.
    worse = replace(lost, gains={0: 30.0, 1: -100.0, 2: 0.0})
    assert rule.gains_there(evidence("torque_offset", gains={0: 16.0}), worse)
    assert rule.gains_there(evidence("torque_offset", gains={0: 16.0, 1: -200.0, 2: -5.0}), worse)
    # Most is more than half.
    assert not rule.gains_there(evidence("torque_offset", gains={0: 15.0}), worse)


def test_a_part_that_loses_within_its_noise_opposes_nothing():
    """Of three blocks two standard errors are 4.53; a block that no fold holds out does not count."""
    parts = np.array([0, 0, 0, 1, 1, 1, 1, 2])
    values = np.array([1.0, 2.0, 3.0, -4.0, -5.0, -6.0, np.nan, -7.0])
    total, error = sum_by_part(values, parts, POLICY)
    assert total.tolist() == [6.0, -15.0, -7.0]
    assert error[:2] == pytest.approx(4.527 * np.sqrt(3.0), rel=1e-3)
    assert total[1] < -error[1]
    # One block has no noise to be told from.
    assert error[2] == 0.0
