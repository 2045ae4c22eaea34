"""The set of names keeps what is as good and drops what is clearly worse, with the stated coverage."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, Found, Refusal
from wearscope.closed_loop.selection.naming import _is_same, _keep_columns, find_confidence_set, name_terms
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import load_effect

POLICY = Policy()
BLOCKS = 60
NAMES = ("quadratic_viscous", "viscous_asymmetry", "joint_spring", "torque_offset")


def evidence(name, change):
    effect = load_effect(name)
    chosen = Chosen(Candidate(effect, 0, ((),), (0,), (np.ones((4, len(effect.coefficients))),)), (0,))
    return Evidence(
        chosen=chosen, joint=0, change=change, gain=float(-np.nansum(change)), share=0.3, fitted=0.3,
        gains={0: 1.0}, left=30.0, torque=0.1, statistic=8.0, chance=np.zeros(9), agreement=1.0,
        opposed=False, informing=4, recordings=4, sine=0.9, blocks=30.0, cancellation=1.0, beta=np.ones(1),
        tried=1.0,
    )  # fmt: skip


def names_in(evidences, policy=POLICY):
    return [e.term.effect.name for e in find_confidence_set(evidences, policy)]


def draw(rng, means, common=1.0, own=0.3, blocks=BLOCKS):
    """Losses whose noise is mostly shared, as that of one residual under several models is."""
    shared = common * rng.standard_normal(blocks)
    return [
        evidence(name, mean + shared + own * rng.standard_normal(blocks))
        for name, mean in zip(NAMES, means, strict=False)
    ]


def test_a_clearly_worse_name_is_dropped_in_either_order():
    made = draw(np.random.default_rng(0), [-3.0, -3.0, -1.0])
    assert names_in(made) == list(NAMES[:2])
    assert names_in(made[::-1]) == [NAMES[1], NAMES[0]]


def test_the_set_is_arch_s():
    from arch.bootstrap import MCS

    rng = np.random.default_rng(6)
    sizes = set()
    for k in (2, 4, 9):
        losses = rng.standard_normal((30, 1)) + 0.5 * rng.standard_normal((30, k)) + 0.2 * np.arange(k)
        policy = Policy(seed=k)
        other = MCS(
            losses, policy.set_level, reps=500, block_size=2, method="R", bootstrap="stationary",
            seed=np.random.default_rng(k),
        )  # fmt: skip
        other.compute()
        assert sorted(_keep_columns(losses, policy)) == sorted(map(int, other.included))
        sizes.add(len(other.included))
    assert len(sizes) > 1


def test_a_name_alone_is_its_own_set():
    (one,) = draw(np.random.default_rng(1), [-3.0])
    assert names_in([one]) == [NAMES[0]]


def test_terms_that_predict_the_same_stay_together():
    """Collinear terms have losses equal to rounding, which no bootstrap may divide by."""
    one, worse = draw(np.random.default_rng(2), [-3.0, -1.0])
    same = replace(one, chosen=evidence(NAMES[2], one.change).chosen, change=one.change * (1 + 1e-13))
    assert names_in([one, same]) == [NAMES[0], NAMES[2]]
    assert names_in([one, same, worse]) == [NAMES[0], NAMES[2]]


def test_blocks_that_no_fold_holds_out_do_not_count():
    made = draw(np.random.default_rng(3), [-3.0, -1.0])
    gaps = np.arange(BLOCKS) % 5 == 0
    made = [replace(e, change=np.where(gaps, np.nan, e.change)) for e in made]
    assert names_in(made) == [NAMES[0]]


def test_a_simpler_name_stays_for_the_form_of_a_large_term_whatever_the_bootstrap_is_sure_of():
    """Of a gain of 100 a block 0.5 are lost, always: that is form up to a hundredth, of what is simpler."""
    for names, lost, kept in (
        (("stribeck", "joint_spring"), 0.5, 2),
        (("stribeck", "joint_spring"), 1.5, 1),
        (("joint_spring", "stribeck"), 0.5, 1),
    ):
        rng = np.random.default_rng(8)
        best, other = (
            evidence(name, level + 0.01 * rng.standard_normal(BLOCKS))
            for name, level in zip(names, (-100.0, lost - 100.0), strict=True)
        )
        assert names_in([best, other]) == list(names[:kept])


def test_the_set_is_wider_where_more_coverage_is_asked_for():
    sizes = {}
    for level in (0.01, 0.1, 0.5):
        policy = Policy(set_level=level)
        made = [draw(np.random.default_rng([4, k]), [-3.0, -2.95, -2.9], own=0.5) for k in range(20)]
        sizes[level] = sum(len(names_in(m, policy)) for m in made)
    assert sizes[0.01] >= sizes[0.1] >= sizes[0.5]
    assert sizes[0.01] > 40


@pytest.mark.parametrize(
    "means", [[-3.0, -3.0, -3.0], [-3.0, -2.95, -2.8]], ids=["all_equal", "one_a_little_better"]
)
def test_the_best_name_is_in_its_set_as_often_as_is_said(means):
    """Coverage on simulated losses: at least 90 %, within what 120 draws can show."""
    inside = sum(NAMES[0] in names_in(draw(np.random.default_rng([5, k]), means)) for k in range(120))
    assert inside >= stats.binom.ppf(0.001, 120, 0.9)


def test_an_evident_second_name_is_left_out_nearly_always():
    wide = sum(len(names_in(draw(np.random.default_rng([6, k]), [-3.0, -2.5]))) for k in range(40))
    assert wide <= 44


@pytest.fixture(scope="module")
def two_effects(record_at, tmp_path_factory):
    """A Stribeck effect, found first, and a ripple that changes its shape and its scale."""
    planted = [
        (0, "stribeck", {"level": 10.0, "speed": 0.3, "exponent": 1.0}),
        (0, "torque_ripple", {"cosine": 1.0, "sine": 0.8, "wavenumber": 20.0}),
    ]
    return record_at(tmp_path_factory.mktemp("two") / "duo", planted, seed=3, runs=4, duration=8.0)


def test_names_are_compared_on_one_scale(two_effects, pose):
    """What a term gained before the others were found says nothing of what a rival gains now."""
    search = Search(pose(two_effects), Policy(flips=199))
    found = find_named(search)
    named, _ = name_terms(search, found)
    assert {f.effect.name for f in named} == {"stribeck", "torque_ripple"}
    (base,) = (f.evidence.gain + f.evidence.left for f in named if f.effect.name == "stribeck")
    beside = search.assemble([f for f in named if f.effect.name != "stribeck"])
    # The other one's shape is refined in turn.
    assert base == pytest.approx(float(np.nansum(beside.joint_losses[:, 0])), rel=1e-3)


def test_what_the_runs_cannot_tell_apart_stands_beside_the_name(record):
    """Rows at rest do not count: an offset and a level that depends on the direction are one."""
    verdict = diagnose(record([(0, "torque_offset", {"offset": 3.0})], seed=3, runs=4, duration=8.0)).verdict
    (entry,) = verdict["verdict"]
    assert "torque_offset" in {entry["effect"], *entry["equivalent"]}
    assert entry["effect"] not in entry["equivalent"]


class Scripted:
    """A search whose answers are given: which candidates are offered for a term, and the evidence on each."""

    def __init__(self, own, offered, left_out=()):
        self.own, self.offered, self.policy, self.left_out = own, offered, POLICY, left_out
        self.problem = SimpleNamespace(prepared=SimpleNamespace(n=2))

    def assemble(self, terms):
        gain = SimpleNamespace(gain=np.ones(1))
        sums = SimpleNamespace(select=lambda subset: None)
        return SimpleNamespace(sum_products=lambda candidate: sums, add=lambda sums: gain)

    def list_rivals(self, beside, others, joints, every):
        made = [e.chosen.candidate for e in self.offered]
        return [c for c in made if set(c.joints) & set(joints)]

    def weigh_again(self, beside, found):
        return self.own

    def weigh_all(self, beside, candidates, least):
        return [e for e in self.offered if any(e.chosen.candidate is one for one in candidates)]

    def is_delay(self, beside, e, settled=False):
        return not (settled and e.term.effect.name == "time_delay")

    def refine(self, beside, e):
        return e

    def opposes_gravity(self, e):
        return False


def losses(mean, noise):
    return mean + 0.1 * np.random.default_rng(noise).standard_normal(BLOCKS)


def named(own, *offered, **more):
    (found,), (beside,) = name_terms(Scripted(own, offered, **more), [Found(own.chosen, own)])
    return found.effect.name, beside


def test_the_simplest_able_name_of_the_set_is_given_and_the_others_stand_beside_it():
    complex_, simple = evidence("stribeck", losses(-1.0, 0)), evidence("joint_spring", losses(-1.0, 1))
    assert complex_.complexity > simple.complexity
    assert named(complex_, simple) == ("joint_spring", ["stribeck"])
    # What was refused may be listed with a name, and does not give it, whatever its gain.
    refused = replace(simple, refusal=Refusal.CHANCE)
    assert named(complex_, refused) == ("stribeck", ["joint_spring"])
    assert named(complex_, replace(simple, refusal=Refusal.ABSORBED)) == ("stribeck", [])
    # A term keeps its own name although it would itself be refused anew.
    assert named(replace(complex_, refusal=Refusal.CHANCE)) == ("stribeck", [])
    weak = evidence("joint_spring", losses(-0.2, 1))
    assert named(complex_, weak) == ("stribeck", [])


def test_where_single_joints_are_preferred_the_whole_robot_s_stand_beside_them():
    own, whole = (
        evidence("gravity_counterbalance", losses(-1.0, 0)),
        evidence("payload_error", losses(-2.0, 1)),
    )
    assert named(own, whole) == ("payload_error", [])
    assert named(own, whole, left_out={"payload_error"}) == ("gravity_counterbalance", ["payload_error"])


def test_what_is_no_delay_is_no_name():
    own, lag = evidence("presliding_hysteresis", losses(-1.0, 0)), evidence("time_delay", losses(-1.0, 1))
    assert lag.complexity < own.complexity
    assert named(own, lag) == ("presliding_hysteresis", [])


def test_what_is_compared_is_near_the_best_that_may_be_named():
    own, other = evidence("quadratic_viscous", losses(-1.0, 0)), evidence("joint_spring", losses(-1.0, 1))
    # One that may not be named gains far more; next to it the other would not be near.
    absorbed = replace(evidence("torque_offset", losses(-1.0, 2)), gain=500.0, refusal=Refusal.ABSORBED)
    name, beside = named(own, other, absorbed)
    assert {name, *beside} == {"quadratic_viscous", "joint_spring"}
    # One that may be named gains far more, and the other is left out.
    able = evidence("torque_offset", losses(-3.0, 2))
    assert "joint_spring" not in {named(own, other, able)[0], *named(own, other, able)[1]}


def test_a_term_is_not_compared_with_itself():
    own = evidence("quadratic_viscous", losses(-1.0, 0))
    again = evidence("quadratic_viscous", losses(-1.0, 0))
    elsewhere = replace(
        again, chosen=replace(again.chosen, candidate=replace(again.chosen.candidate, joint=1))
    )
    assert _is_same(own, again)
    assert not _is_same(own, elsewhere)
    assert not _is_same(own, evidence("joint_spring", losses(-1.0, 0)))
    assert not _is_same(own, replace(again, chosen=replace(again.chosen, subset=(1,))))


def test_an_effect_of_several_joints_is_compared_with_any_but_a_plain_joint_s_own():
    spread = evidence("payload_error", losses(-1.0, 1))
    assert spread.term.effect.spread
    for name, standard in (("quadratic_viscous", False), ("viscous", True)):
        own = evidence(name, losses(-1.0, 0))
        assert own.term.effect.standard is standard
        given, beside = named(own, spread)
        assert ("payload_error" in {given, *beside}) is not standard


def test_a_term_of_another_joint_is_no_name():
    own, here = evidence("quadratic_viscous", losses(-1.0, 0)), evidence("joint_spring", losses(-1.0, 1))
    there = replace(
        here, chosen=replace(here.chosen, candidate=replace(here.chosen.candidate, joint=1, joints=(1,)))
    )
    given, beside = named(own, here)
    assert "joint_spring" in {given, *beside}
    assert named(own, there) == ("quadratic_viscous", [])


def test_what_is_felt_at_several_joints_is_compared_with_what_is_at_any_of_them():
    wide, there = evidence("payload_error", losses(-1.0, 0)), evidence("joint_spring", losses(-1.0, 1))
    there = replace(
        there, chosen=replace(there.chosen, candidate=replace(there.chosen.candidate, joint=1, joints=(1,)))
    )
    felt = replace(wide, chosen=replace(wide.chosen, candidate=replace(wide.chosen.candidate, joints=(0, 1))))
    given, beside = named(felt, there)
    assert {given, *beside} == {"payload_error", "joint_spring"}
    assert named(wide, there) == ("payload_error", [])


def test_of_many_names_the_best_are_compared():
    names = (
        "viscous_asymmetry joint_spring torque_offset stribeck coulomb_asymmetry concave_viscous backlash "
        "load_dependent_friction temperature_dependent_friction warm_up_drift presliding_hysteresis "
        "torque_ripple rotor_inertia_error torque_constant_error"
    ).split()
    own = evidence("quadratic_viscous", losses(-1.0, 0))
    for best in (names[0], names[-1]):
        offered = [evidence(name, losses(-1.25 if name == best else -1.0, 0)) for name in names]
        assert len(offered) > 12 and named(own, *offered) == (best, [])
