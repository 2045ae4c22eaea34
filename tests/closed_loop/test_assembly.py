"""What the block sums answer is what dense least squares on the rows gives, refitted fold by fold."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wearscope.closed_loop.model.blocks import Block, hold_out_fifths, make_folds
from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection import assembly as assembly_module
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen, find_reach
from wearscope.closed_loop.selection.evidence import on_same_folds, shows_alone, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import load_effect

STRIBECK = [(0, "stribeck", {"level": 6.0, "speed": 0.3})]


@pytest.fixture(scope="module", params=["trusted", "approximate"])
def assembly(request, record_at, pose, tmp_path_factory):
    """Declared model of the small arm; with approximate inertials all joints are coupled, by a prior."""
    folder = tmp_path_factory.mktemp(request.param) / "duo"
    robot = {"inertials": request.param}
    problem = pose(record_at(folder, STRIBECK, seed=1, runs=4, duration=6.0, robot=robot))
    search = Search(problem, Policy(flips=99))
    made = search.assemble(())
    made.problem = problem
    return made


def dense(assembly, *more):
    """Weighted rows (M n, P), target (M n,), precision (P, P) and block of each row of a model."""
    layout = assembly.layout
    n = assembly.target.shape[1]
    chosen = [*assembly.chosen, *more]
    count = sum(len(c.subset) for c in chosen)
    x, precision = np.zeros((len(assembly.target), n, count)), np.zeros((count, count))
    start = 0
    for c in chosen:
        span = slice(start, start + len(c.subset))
        for j, rows in zip(c.candidate.joints, c.rows, strict=True):
            x[:, j, span] = rows
        if c.candidate.penalty is not None:
            precision[span, span] = c.candidate.penalty[np.ix_(c.subset, c.subset)]
        start += len(c.subset)
    w = layout.keep / assembly.sigma
    block = np.zeros(len(x), dtype=int)
    first = np.cumsum([0, *(len(run.t) for run in layout.prepared.runs_for("train"))])
    for b, own in enumerate(layout.blocks):
        block[first[own.run] + own.start : first[own.run] + own.stop] = b
    return (
        (x * w[:, :, None]).reshape(-1, count),
        (assembly.target * w).ravel(),
        precision,
        np.repeat(block, n),
    )


def fit(x, y, precision):
    """Penalised least squares by an orthogonal factorisation of the rows."""
    root = np.sqrt(np.diag(precision))
    assert np.allclose(precision, np.diag(root**2))
    a = np.concatenate([x, np.diag(root)])
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    return np.linalg.lstsq(a / scale, np.concatenate([y, np.zeros(len(root))]), rcond=1e-13)[0] / scale


@pytest.mark.parametrize("start", [(1.0, 1.0), (1.0, 1e4), (1e4, 1.0)])
def test_the_scale_that_weighs_a_model_is_the_one_it_leaves(assembly, start):
    """Wherever it starts from; where nothing couples the joints no weight matters."""
    counted, n = assembly.layout.keep, assembly.target.shape[1]
    target = assembly.target.copy()
    # What is missing at the second joint is a thousandth of what is missing at the first one.
    target[:, 0] += 50.0 * np.sin(7.0 * np.arange(len(target)) ** 1.3)
    model = Assembly(assembly.layout, target, assembly.chosen, assembly.sigma * np.array(start))
    settled = model.settle_scale()
    again = Assembly(assembly.layout, target, assembly.chosen, settled)
    left = np.sqrt((again.residual**2 * counted).sum(axis=0) / counted.sum(axis=0))
    assert settled == pytest.approx(left, rel=0.02)
    reference = Assembly(assembly.layout, target, assembly.chosen, assembly.sigma).settle_scale()
    assert settled == pytest.approx(reference, rel=0.02)
    # By hand, on the rows.
    sigma = np.ones(n)
    for _ in range(50):
        x, y, precision, _ = dense(Assembly(assembly.layout, target, assembly.chosen, sigma))
        off = (y - x @ fit(x, y, precision)).reshape(-1, n) * sigma
        sigma = np.sqrt((off**2).sum(axis=0) / counted.sum(axis=0))
    assert settled == pytest.approx(sigma, rel=0.02)


def losses_by_block(left, block):
    return np.bincount(block, left**2)


CANDIDATES = [
    ("quadratic_viscous", 0, (0,)),
    ("joint_spring", 1, (0, 1)),
    ("torque_ripple", 0, (0, 1)),
    ("payload_error", 1, (0, 1, 2, 3)),
]


def candidate_of(assembly, name, joint):
    effect = load_effect(name)
    if effect.periodic:
        return assembly.problem.periodic_candidate(effect, joint, assembly.residual[:, joint])
    return assembly.problem.candidate(effect, joint)


def test_the_model_is_penalised_least_squares(assembly):
    x, y, precision, block = dense(assembly)
    theta = fit(x, y, precision)
    left = y - x @ theta
    np.testing.assert_allclose(x @ assembly.theta, x @ theta, atol=2e-4 * np.abs(y).max())
    np.testing.assert_allclose(losses_by_block(y - x @ assembly.theta, block).sum(), left @ left, rtol=1e-5)
    kept = assembly.layout.keep
    own = (assembly.residual / assembly.sigma * kept).ravel()
    np.testing.assert_allclose(own, y - x @ assembly.theta, atol=1e-8)


def test_what_is_known_elsewhere_and_a_joints_own_rows_are_all_that_is_known(assembly):
    """Its information, with the parameters felt elsewhere alone left free, and the own rows give the fit."""
    x, _, precision, _ = dense(assembly)
    w = assembly.layout.keep / assembly.sigma
    for joint in range(assembly.target.shape[1]):
        k = assembly.at[joint]
        own = assembly.columns[joint] * w[:, [joint]]
        known = assembly.know_elsewhere(joint)
        np.testing.assert_allclose(known, known.T, rtol=1e-6, atol=1e-9 * np.abs(known).max())
        covariance = np.linalg.inv(x.T @ x + precision + 1e-10 * np.diag(np.diag(x.T @ x) + 1e-12))
        both = np.linalg.inv(known + own.T @ own)
        scale = np.sqrt(np.outer(np.diag(both), np.diag(both)))
        np.testing.assert_allclose(both / scale, covariance[np.ix_(k, k)] / scale, atol=1e-4)


def test_held_out_losses_are_those_of_refits(assembly):
    x, y, precision, block = dense(assembly)
    held = np.zeros_like(assembly.joint_losses)
    for train, test in zip(assembly.layout.folds.train, assembly.layout.folds.test, strict=True):
        inside = train[block]
        left = y - x @ fit(x[inside], y[inside], precision)
        square = (left**2).reshape(-1, held.shape[1])
        for j in range(held.shape[1]):
            held[test, j] = np.bincount(block[:: held.shape[1]], square[:, j])[test]
    np.testing.assert_allclose(assembly.joint_losses.sum(axis=0), held.sum(axis=0), rtol=1e-4)
    np.testing.assert_allclose(assembly.joint_losses, held, rtol=2e-2, atol=1e-3 * held.mean())


@pytest.mark.parametrize(("name", "joint", "subset"), CANDIDATES)
def test_a_candidate_beside_the_model_is_the_joint_fit(assembly, name, joint, subset):
    candidate = candidate_of(assembly, name, joint)
    sums = assembly.sum_products(candidate).select(subset)
    added = assembly.add(sums)
    base = dense(assembly)
    theta = fit(*base[:3])
    before = np.sum((base[1] - base[0] @ theta) ** 2) + theta @ base[2] @ theta
    for s in range(len(candidate.shapes)):
        x, y, precision, _ = dense(assembly, Chosen(candidate.at(s), subset))
        together = fit(x, y, precision)
        after = np.sum((y - x @ together) ** 2) + together @ precision @ together
        assert added.gain[s] == pytest.approx(before - after, rel=1e-3, abs=1e-6 * before)
        torque = x[:, -len(subset) :] @ together[-len(subset) :]
        np.testing.assert_allclose(
            x[:, -len(subset) :] @ added.beta[s], torque, atol=1e-3 * np.abs(torque).max()
        )


@pytest.mark.parametrize(("name", "joint", "subset"), CANDIDATES)
def test_hold_out_is_an_explicit_refit_of_every_fold(assembly, name, joint, subset):
    candidate = candidate_of(assembly, name, joint)
    sums = assembly.sum_products(candidate).select(subset)
    change = assembly.hold_out(sums).sum(axis=1)
    expected = np.full(len(change), np.nan)
    base = dense(assembly)
    for f, (train, test) in enumerate(
        zip(assembly.layout.folds.train, assembly.layout.folds.test, strict=True)
    ):
        best = int(np.argmax(assembly.add_by_fold(sums).gain[f]))
        x, y, precision, block = dense(assembly, Chosen(candidate.at(best), subset))
        inside = train[block]
        losses = [
            losses_by_block(y - a @ fit(a[inside], y[inside], p), block)
            for a, p in ((x, precision), (base[0], base[2]))
        ]
        expected[test] = (losses[0] - losses[1])[test]
    size = np.abs(expected).sum()
    np.testing.assert_allclose(change.sum(), expected.sum(), atol=1e-3 * size)
    np.testing.assert_allclose(change, expected, atol=1e-2 * np.abs(expected).max())


def test_scores_are_those_of_columns_with_the_model_projected_out(assembly):
    candidate = candidate_of(assembly, "quadratic_viscous", 0)
    sums = assembly.sum_products(candidate)
    scores = assembly.block_scores(sums)
    added = assembly.add(sums)
    # With all signs as they are, their sum is what the gain is made of.
    total = scores.sum(axis=0)
    np.testing.assert_allclose(total, np.einsum("smn,sn->sm", added.inner, added.beta), rtol=1e-3)
    x, y, precision, block = dense(assembly, Chosen(candidate.at(0), (0,)))
    own, model = x[:, -1], x[:, :-1]
    normal = model.T @ model + precision[:-1, :-1]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    turned = np.linalg.solve(
        normal * np.outer(scale, scale) + 1e-10 * np.eye(len(scale)), scale * (model.T @ own)
    )
    clean = own - model @ (scale * turned)
    left = y - model @ fit(model, y, precision[:-1, :-1])
    np.testing.assert_allclose(
        scores[:, 0, 0], np.bincount(block, clean * left), atol=1e-2 * np.abs(scores).max()
    )


def test_a_part_of_the_machine_gives_the_same_evidence_where_it_is_not_coupled(record, pose):
    problem = pose(record(STRIBECK, seed=1, runs=4, duration=6.0))
    search = Search(problem, Policy(flips=99))
    whole = search.assemble(())
    candidate = problem.candidate(load_effect("quadratic_viscous"), 0)
    assert find_reach(problem.base, candidate) == {0}
    part = Assembly(problem.layout, problem.target, problem.base, search.sigma, {0})
    assert part.p < whole.p
    one, other = (weigh(a, candidate, (0,), search.policy) for a in (whole, part))
    for name in ("gain", "share", "statistic", "sine", "agreement", "blocks"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9), name
    np.testing.assert_allclose(one.change, other.change, rtol=1e-7, atol=1e-10)


def test_coupled_joints_are_reached():
    class Term:
        def __init__(self, *joints):
            self.candidate = self
            self.joints = joints

    chain = [
        Term(0, 1),
        Term(1, 2),
        Term(
            4,
        ),
        Term(4, 5),
    ]
    assert find_reach(chain, Term(0)) == {0, 1, 2}
    assert find_reach(chain, Term(3)) == {3}
    assert find_reach(chain, Term(5, 3)) == {3, 4, 5}


def test_blocks_and_folds_do_not_grow_with_the_square_of_the_runs():
    """Each block is held out once, by at most ten folds, however many runs there are."""
    for runs in (3, 10, 11, 50):
        blocks = [Block(r, 100 * k, 100 * k + 100) for r in range(runs) for k in range(4)]
        folds = make_folds(blocks, [f"{r}.csv" for r in range(runs)])
        assert len(folds.test) == min(runs, 10)
        np.testing.assert_array_equal(folds.test.sum(axis=0), 1)
        np.testing.assert_array_equal(folds.train, ~folds.test)
        # Whole runs are held out, about as many in each fold.
        assert all(len(set(row[4 * r : 4 * r + 4])) == 1 for row in folds.test for r in range(runs))
        held = folds.test.sum(axis=1)
        assert held.max() - held.min() <= 4


def test_the_work_of_a_candidate_is_a_pass_over_the_rows_and_a_solution_a_fold(
    record_at, pose, tmp_path, monkeypatch
):
    """Calls are counted, not time: with eight times the runs, folds and not runs multiply."""
    counted = {}
    for runs in (4, 25):
        problem = pose(record_at(tmp_path / str(runs) / "duo", runs=runs, duration=4.0))
        search = Search(problem, Policy(flips=99))
        assembly = search.assemble(())
        calls = Counter()

        def count(name, own, calls=calls):
            def counting(self, *args):
                calls[name] += 1
                return own(self, *args)

            return counting

        with monkeypatch.context() as patch:
            for name in ("_solve", "_fit", "sum_products", "hold_out"):
                patch.setattr(Assembly, name, count(name, getattr(assembly_module.Assembly, name)))
            for name in ("quadratic_viscous", "stribeck"):
                weigh(assembly, problem.candidate(load_effect(name), 0), (0,), search.policy)
        counted[runs] = calls
        folds = len(problem.layout.folds.test)
        assert folds == min(runs - 1, 10)
        assert calls["sum_products"] == calls["hold_out"] == 2
        # All rows once, and each fold once for the model; all folds together for each candidate.
        assert calls["_solve"] == 1 + folds
        assert calls["_fit"] == 2 * 2


def test_folds_of_one_run_give_joints_that_move_in_turn_their_share():
    """Three joints, one after the other; where all move all the time, fifths are contiguous as ever."""
    blocks = [Block(0, 10 * k, 10 * k + 10) for k in range(60)]
    files = ["one.csv"]
    in_turn = np.zeros((60, 3))
    for j in range(3):
        in_turn[20 * j : 20 * j + 20, j] = 1.0
    together = make_folds(blocks, files, np.ones((60, 3)))
    for folds in (together, make_folds(blocks, files), make_folds(blocks, files, np.zeros((60, 3)))):
        np.testing.assert_array_equal(folds.parts, np.arange(60) // 12)
    folds = make_folds(blocks, files, in_turn)
    for j in range(3):
        assert len(set(folds.parts[in_turn[:, j] > 0])) >= 4
    assert sorted(np.bincount(folds.parts)) == [12] * 5
    for train, test in zip(folds.train, folds.test, strict=True):
        # A block's gap on either side, and every joint in what is fitted.
        assert not (train[1:] & test[:-1]).any() and not (train[:-1] & test[1:]).any()
        assert (in_turn[train].sum(axis=0) > 0).all()


def test_fifths_of_every_recording_are_held_out_together():
    """Two recordings, the second in two pieces: a block's gap within a piece, nothing else left out."""
    blocks = [Block(r, 10 * k, 10 * k + 10) for r, count in ((0, 20), (1, 8), (2, 12)) for k in range(count)]
    folds = make_folds(blocks, ["a.csv", "b.csv", "b.csv"])
    assert folds.by_run
    assert len(folds.test) == 2
    np.testing.assert_array_equal(folds.recording, [0] * 20 + [1] * 20)
    fifths = hold_out_fifths(blocks, folds)
    assert fifths.by_run
    np.testing.assert_array_equal(fifths.test.astype(int).sum(axis=0), 1)
    for k, test in enumerate(fifths.test):
        np.testing.assert_array_equal(
            np.flatnonzero(test), [*range(4 * k, 4 * k + 4), *range(20 + 4 * k, 24 + 4 * k)]
        )
    np.testing.assert_array_equal(fifths.parts, np.arange(40) // 4)
    # The second piece starts where a fifth of the second recording ends.
    gaps = [
        np.flatnonzero(~train & ~test).tolist() for train, test in zip(fifths.train, fifths.test, strict=True)
    ]
    assert gaps == [[4, 24], [3, 8, 23], [7, 12, 32], [11, 16, 31, 36], [15, 35]]


def test_what_one_of_two_recordings_shows_is_asked_of_its_parts(record, pose):
    """A joint that rests in one recording: held out whole, the other would be predicted by anything."""
    folder = record([(0, "stribeck", {"level": 6.0, "speed": 0.3})], seed=3, runs=3)
    search = Search(pose(folder), Policy(flips=199))
    assembly = search.assemble(())
    layout = assembly.layout
    candidate = search.problem.candidate(load_effect("stribeck"), 0)
    both = weigh(assembly, candidate, (0,), search.policy)
    assert not both.by_fifths
    rests = np.repeat(layout.run_of == 0, [block.stop - block.start for block in layout.blocks])
    still = Candidate(
        candidate.effect,
        0,
        candidate.shapes,
        candidate.joints,
        tuple(x * rests[:, None] for x in candidate.rows),
    )
    one = weigh(assembly, still, (0,), search.policy)
    assert one.by_fifths
    assert 3 <= one.informing <= 5
    assert one.share > 0.1
    assert (
        rule.is_beyond_chance(replace(one, share=0.6, fitted=0.6, agreement=1.0), search.policy, by_run=True)
        is False
    )
    assert (
        rule.is_beyond_chance(replace(both, share=0.6, fitted=0.6, agreement=1.0), search.policy, by_run=True)
        is True
    )
    assert weigh(assembly, still, (0,), search.policy, by_fifths=True).gain == one.gain
    # Terms are compared by what the same held-out parts gain: fifths, where one is judged by them.
    beside, (first, second) = on_same_folds(assembly, [both, one], search.policy)
    assert beside is assembly.by_fifths and second is one
    assert first.gain == pytest.approx(weigh(beside, candidate, (0,), search.policy).gain, rel=1e-9)
    assert abs(first.gain / both.gain - 1.0) > 1e-3
    assert (first.p_value, first.refusal, first.by_fifths) == (both.p_value, both.refusal, False)
    same, kept = on_same_folds(assembly, [both, both], search.policy)
    assert same is assembly and kept[0] is both
    scale = np.array([[2.0], [5.0]]) * search.sigma**2
    search.standard_losses = scale
    shares = [e.whole for e in search.compare_whole(assembly, [both, one])]
    assert shares == pytest.approx([both.gains[0] / 2.0, one.gains[0] / 5.0])
    drift = search.problem.candidate(load_effect("warm_up_drift"), 0)
    slow = Candidate(
        drift.effect, 0, drift.shapes, drift.joints, tuple(x * rests[:, None] for x in drift.rows)
    )
    assert not weigh(assembly, slow, (0,), search.policy).by_fifths


@pytest.mark.parametrize(
    ("shares", "alone"),
    [
        ((0.96, 0.04), True),
        ((0.94, 0.06), False),
        # Each of the others has too little to be asked, whatever they have together.
        ((0.88, 0.04, 0.04, 0.04), True),
        ((0.86, 0.06, 0.04, 0.04), False),
        ((1.0,), False),
    ],
)
def test_one_recording_shows_a_term_alone_where_no_other_one_informs(shares, alone):
    blocks = [Block(r, 10 * k, 10 * k + 10) for r in range(len(shares)) for k in range(10)]
    folds = make_folds(blocks, [f"{r}.csv" for r in range(len(shares))])
    information = np.repeat(shares, 10) / 10.0
    ripple, drift = (SimpleNamespace(effect=load_effect(x)) for x in ("torque_ripple", "warm_up_drift"))
    assert shows_alone(ripple, information, folds, Policy()) is alone
    assert not shows_alone(drift, information, folds, Policy())


@pytest.mark.parametrize(("runs", "folds"), [(1, 5), (2, 5), (3, 3)])
def test_standard_terms_are_asked_by_fifths_where_there_are_two_recordings(record, pose, runs, folds):
    layout = Search(pose(record(seed=1, runs=runs + 1, duration=6.0)), Policy(flips=99)).problem.layout
    assert len(layout.for_standard.folds.test) == folds
    assert (layout.for_standard is layout) is (runs != 2)


def test_share_of_the_fit_is_of_the_loss_though_columns_of_the_model_are_held_near_zero(record, pose):
    """What frees the reversal's own columns from a strain is no part of the loss that a term removes."""
    folder = record([(0, "stribeck", {"level": 6.0, "speed": 0.3})], seed=3, runs=3)
    search = Search(pose(folder), Policy(flips=199))
    before = search.assemble(())
    e = weigh(before, search.problem.candidate(load_effect("stribeck"), 0), (0,), search.policy)
    after = Assembly(before.layout, before.target, (*before.chosen, e.chosen), before.sigma)
    assert e.fitted == pytest.approx(1.0 - after.sample_losses[0] / before.sample_losses[0], rel=1e-6)


def test_what_a_term_removes_of_the_fit_is_said_of_its_own_joint(record, pose):
    """Refitted inertials carry what is missing at a joint to others, which gain by the term too."""
    planted = [(1, "gravity_counterbalance", {"sine1": 60.0, "cosine1": 30.0})]
    folder = record(planted, seed=4, runs=3, duration=6.0, robot={"inertials": "approximate"})
    search = Search(pose(folder), Policy(flips=99))
    own = search.assemble(())
    # Weighed as if all joints left as much of their torque, a body follows what is missing at one of them.
    before = Assembly(own.layout, own.target, own.chosen, np.sqrt(np.mean(own.target**2, axis=0)))
    balancer = search.problem.candidate(load_effect("gravity_counterbalance"), 1)
    e = weigh(before, balancer, (0, 1), search.policy)
    after = Assembly(before.layout, before.target, (*before.chosen, e.chosen), before.sigma)
    removed = before.sample_losses - after.sample_losses
    assert removed[0] > 0.05 * removed[1]
    assert e.fitted == pytest.approx(removed[1] / before.sample_losses[1], rel=1e-6)
    assert e.fitted <= 1.0
