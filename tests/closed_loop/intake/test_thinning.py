"""More runs than may be used: what informs is kept, the torque has no say in it, and the notes say it."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
import yaml

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.intake.thinning import Budget, choose_stretches, prepare_thinned, thin_dataset
from wearscope.closed_loop.posing import find_prismatic
from wearscope.effects.signals import differentiate
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.urdf import normalise_urdf

RATE, DURATION, SPRING = 100.0, 60.0, 5.0
#: Recordings, and those in whose middle third the second joint swings wide.
TRAIN, TEST, WIDE = 7, 3, (1, 4, 7, 8)
SMALL = Budget(joint_seconds=2 * 160.0, tested=1.0)


@pytest.fixture(scope="module")
def rarely_wide(record_at, tmp_path_factory):
    """An arm with an undeclared spring at its second joint, which swings wide in a few stretches only."""
    folder = record_at(tmp_path_factory.mktemp("wide") / "duo", runs=3, duration=2.0)
    path = folder / "dataset.yaml"
    fields = yaml.safe_load(path.read_text())
    joints, first = fields["robot"]["joints"], fields["runs"][0]
    body = RigidBody(
        normalise_urdf((folder / "robot.urdf").read_text(), joints), joints, payload=Payload(3.0, (0.3, 0, 0))
    )
    t = np.arange(int(DURATION * RATE)) / RATE
    entries = []
    for r in range(TRAIN + TEST):
        rng = np.random.default_rng([5, r])
        swing = 0.12 * np.ones((len(t), 2))
        if r in WIDE:
            swing[:, 1] += 0.5 * (np.tanh((t - 23.0) / 1.5) - np.tanh((t - 37.0) / 1.5))
        w, phase = rng.uniform(1.5, 3.0, (2, 3)), rng.uniform(0, 6, (2, 3))
        q = swing * np.sin(t[:, None, None] * w + phase).sum(axis=2)
        v = differentiate(q, RATE)
        a = differentiate(v, RATE)
        tau = body.inverse_dynamics(q, v, a) + np.array(fields["robot"]["rotor_inertia"]) * a
        tau += np.array([6.0, 3.0]) * np.sign(v) + np.array([4.0, 2.0]) * v
        tau[:, 1] += SPRING * q[:, 1]
        tau += np.array([1.0, 0.5]) * rng.standard_normal(q.shape)
        table = {"t": t}
        for j, joint in enumerate(joints):
            table |= {f"q_{joint}": q[:, j] + 2e-6 * rng.standard_normal(len(t)), f"tau_{joint}": tau[:, j]}
        file = f"runs/m{r}.parquet"
        pd.DataFrame(table).to_parquet(folder / file)
        use = "train" if r < TRAIN else "test"
        entries.append(first | {"file": file, "use": use, "session": f"day {r // 4}"})
    path.write_text(yaml.safe_dump(fields | {"runs": entries, "sample_rate": RATE}))
    return folder


@pytest.fixture(scope="module")
def dataset(rarely_wide):
    return read_dataset(rarely_wide, find_prismatic)


def test_below_the_budget_the_data_set_is_the_same_object(dataset):
    assert thin_dataset(dataset) is dataset
    whole = Budget(joint_seconds=2 * TRAIN * DURATION, tested=1.0)
    assert thin_dataset(dataset, whole) is dataset


def test_stretches_that_inform_are_kept_and_the_budget_is(dataset):
    thinned = thin_dataset(dataset, SMALL)
    seconds = {use: sum(b - a for r in thinned.runs_for(use) for a, b in r.stretches) for use in
               ("train", "test")}  # fmt: skip
    assert 130.0 < seconds["train"] <= 160.0
    assert 100.0 < seconds["test"] <= 160.0
    for record in thinned.runs_for("train"):
        if record.file in [f"runs/m{r}.parquet" for r in WIDE]:
            assert any(a <= 25.0 and b >= 35.0 for a, b in record.stretches), record.file
    assert {f"runs/m{r}.parquet" for r in WIDE if r < TRAIN} <= {r.file for r in thinned.runs}
    (note,) = [note for note in thinned.notes if "more is recorded" in note]
    assert "of 420 s of train runs the 8 stretches whose motion informs most" in note
    assert "of 180 s of test runs the 8 evenly spaced stretches are used" in note
    # Every session is there, and no recording gives more than its part.
    assert {r.session for r in thinned.runs_for("train")} == {r.session for r in dataset.runs_for("train")}
    assert max(sum(b - a for a, b in r.stretches) for r in thinned.runs_for("train")) < 0.3 * 160.0


def test_the_torque_has_no_say_in_the_choice(dataset):
    def disturb(record, k):
        def load():
            run = record.load()
            return replace(run, tau=100.0 * np.random.default_rng(k).standard_normal(run.tau.shape))

        return replace(record, load=load)

    other = replace(dataset, runs=[disturb(r, k) for k, r in enumerate(dataset.runs)])
    chosen = [[(r.file, r.stretches) for r in thin_dataset(d, SMALL).runs] for d in (dataset, other)]
    assert chosen[0] == chosen[1]


def test_pieces_keep_their_file_and_their_time(dataset):
    thinned = thin_dataset(dataset, SMALL)
    prepared = prepare(thinned)
    assert len({run.label for run in prepared.runs}) == len(prepared.runs)
    for run in prepared.runs:
        record = next(r for r in thinned.runs if r.file == run.file)
        assert any(a <= run.t[0] and run.t[-1] <= b for a, b in record.stretches)
        whole = record.load()
        rows = np.searchsorted(whole.t, run.signals.t + 1e-6) - 1
        np.testing.assert_allclose(run.signals.q, whole.q[rows], atol=2e-3)
    used = sum(run.signals.t[-1] - run.signals.t[0] for run in prepared.runs)
    assert used == pytest.approx(sum(b - a for r in thinned.runs for a, b in r.stretches), rel=0.01)


def test_rows_of_the_common_filter_have_a_budget_too(dataset):
    whole = prepare_thinned(dataset)
    rows = 2 * sum(len(run.t) for run in whole.runs_for("train"))
    assert not [note for note in whole.notes if "more is recorded" in note]
    less = prepare_thinned(dataset, Budget(joint_rows=0.4 * rows))
    left = 2 * sum(len(run.t) for run in less.runs_for("train"))
    assert 0.25 * rows < left <= 0.4 * rows
    assert [note for note in less.notes if "more is recorded" in note]


@pytest.mark.slow
def test_an_effect_that_few_stretches_excite_is_named_and_the_notes_say_what_is_left_out(rarely_wide):
    diagnosis = diagnose(rarely_wide, budget=SMALL)
    assert [(entry["joint"], entry["effect"], entry["status"]) for entry in diagnosis.verdict["verdict"]] == [
        ("b", "joint_spring", "confirmed")
    ]
    assert [note for note in diagnosis.verdict["notes"] if "more is recorded" in note]


def measure(information, before=1e-3):
    """Logarithm of the determinant that stretches (S, F, F) add to what is known before."""
    f = information.shape[-1]
    return np.linalg.slogdet(before * np.eye(f) + information.sum(axis=0))[1] - f * np.log(before)


def test_greedy_choice_keeps_to_its_bound_and_finds_what_is_orthogonal():
    """Nemhauser, Wolsey and Fisher 1978: at least 1 - 1/e of the best of all choices."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        x = rng.normal(size=(8, 6, 4)) * rng.lognormal(0.0, 1.0, (8, 1, 4))
        information = np.einsum("stf,stg->sfg", x, x)
        chosen = choose_stretches(
            information[:, None], np.full(8, 20.0), np.arange(8), np.zeros(8, int), 60.0
        )
        scale = np.sqrt(np.einsum("sff->sf", information).mean(axis=0))
        scaled = information / np.outer(scale, scale)
        sizes = [measure(scaled[list(three)]) for three in combinations(range(8), 3)]
        reached = measure(scaled[chosen])
        assert len(set(chosen)) == 3
        assert max(sizes) + 1e-9 >= reached >= (1 - np.exp(-1)) * max(sizes)
        assert reached > np.median(sizes)
    axes = np.zeros((6, 1, 3, 3))
    for s in range(6):
        axes[s, 0, s % 3, s % 3] = 1.0 if s < 3 else 0.2
    chosen = choose_stretches(axes, np.full(6, 20.0), np.arange(6), np.zeros(6, dtype=int), 60.0)
    assert sorted(chosen) == [0, 1, 2]


def test_one_recording_and_one_session_do_not_take_all():
    information = np.tile(np.eye(2), (30, 1, 1, 1))
    information[:15] *= 100.0
    record, kind = np.repeat(np.arange(3), 10), np.repeat([0, 1], [29, 1])
    chosen = choose_stretches(information, np.full(30, 10.0), record, kind, 90.0)
    assert len(chosen) == 9
    assert 29 in chosen
    assert np.bincount(record[chosen]).max() <= 3
