"""Kinds of damaged recordings of a machine: a clear refusal, or the answer that the whole folder gets."""

import shutil

import numpy as np
import pytest
from folders import PLANS, change_runs, scale

from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Planted, Recipe
from wearscope.closed_loop.run import close_loop
from wearscope.errors import InputError

JOINT = "slide"
Q, TAU = f"q_{JOINT}", f"tau_{JOINT}"


def answer(folder, out):
    """Named effects, each with those that the runs cannot tell apart from it."""
    verdict = close_loop(folder, out, light=True)["verdict"]
    return [(entry["joint"], {entry["effect"], *entry["equivalent"]}) for entry in verdict]


def alike(found, wanted):
    return len(found) == len(wanted) and all(
        a[0] == b[0] and a[1] & b[1] for a, b in zip(found, wanted, strict=True)
    )


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    """A folder with a planted effect and one without, with what is to be answered."""
    made = {}
    for name, planted in (("planted", [Planted("stribeck", JOINT, 8.0)]), ("null", [])):
        folder = tmp_path_factory.mktemp(name) / "d"
        generate_dataset(folder, "stage", planted, 5, Recipe(duration=8.0, plans=PLANS))
        made[name] = folder, answer(folder, folder.parent / "out")
    assert alike(made["planted"][1], [(JOINT, {"stribeck"})]) and made["null"][1] == []
    return made


def at(rows, column, value):
    """Set rows of a column; a callable gets the column."""

    def change(table):
        table = table.copy()
        new = value(table[column]) if callable(value) else value
        table.loc[table.index[rows], column] = new if np.isscalar(new) else np.asarray(new)[rows]
        return table

    return change


def clip(share, noise):
    def change(table):
        limit = share * table[TAU].abs().max()
        rng = np.random.default_rng(0)
        return table.assign(**{TAU: table[TAU].clip(-limit, limit) + noise * rng.normal(size=len(table))})

    return change


def drop_rows(table):
    fastest = int(np.argmax(np.abs(np.diff(table[Q].to_numpy()[100:-100])))) + 100
    left = table.drop(index=range(fastest - 30, fastest + 30)).reset_index(drop=True)
    return left.assign(t=table["t"][: len(left)])


CORRECTED = {
    "position_spike": at(1100, Q, lambda q: q + 1.0),
    "small_position_spike": at(1100, Q, lambda q: q + 0.01),
    "position_spike_at_start": at(60, Q, 0.0),
    "encoder_zero_at_start": at(slice(0, 200), Q, 0.0),
    "encoder_offset_at_start": at(slice(0, 240), Q, lambda q: q + 0.3),
    "torque_spike": at(1100, TAU, lambda tau: tau + 10 * tau.abs().max()),
    "torque_burst_of_three": at(slice(1100, 1103), TAU, lambda tau: tau - 3 * tau.abs().max()),
    "torque_zero_at_start": at(slice(0, 250), TAU, 0.0),
    "torque_frozen_in_part": at(slice(800, 1100), TAU, lambda tau: np.full(len(tau), tau.iloc[800])),
    "torque_clipped": clip(0.7, 0.0),
    "torque_clipped_under_noise": clip(0.7, 0.2),
    "clock_of_the_epoch": lambda table: table.assign(t=table["t"] + 1.7e9),
    "single_precision": lambda table: table.astype({Q: "float32", TAU: "float32"}),
    "time_jump": lambda table: table.assign(t=table["t"] + 3.0 * (table.index >= len(table) // 2)),
    "columns_in_other_order": lambda table: table[table.columns[::-1]],
    "channels_held_for_four_samples": lambda table: table.assign(
        **{c: table[c].to_numpy()[np.arange(len(table)) // 4 * 4] for c in (Q, TAU)}
    ),
}


def assert_corrected(whole, tmp_path, kind):
    folder = shutil.copytree(whole[0], tmp_path / "d")
    change_runs(folder, CORRECTED[kind])
    assert alike(answer(folder, tmp_path / "out"), whole[1])


@pytest.mark.parametrize("kind", CORRECTED)
def test_what_can_be_corrected_gets_the_right_answer(wholes, tmp_path, kind):
    assert_corrected(wholes["planted"], tmp_path, kind)


@pytest.mark.parametrize("kind", ["encoder_zero_at_start", "torque_zero_at_start"])
def test_damage_is_never_named_as_an_effect(wholes, tmp_path, kind):
    assert_corrected(wholes["null"], tmp_path, kind)


REFUSE = {
    "position_step": (at(slice(900, None), Q, lambda q: q + 0.2), "steps by 0.2"),
    "rows_lost": (drop_rows, "steps by"),
    "swapped_columns": (lambda table: table.rename(columns={Q: TAU, TAU: Q}), "steps by"),
    "millimetres": (scale(Q, 1000.0), "positions look like mm"),
    "newton_millimetres": (scale(TAU, 1000.0), "times what the rigid body"),
    "motor_side": (scale(TAU, 1.0 / 628.0), "multiply it with the gear ratio"),
    "position_sign": (scale(Q, -1.0), "opposite sign"),
    "mostly_clipped": (clip(0.35, 0.0), r"'tau_slide' is clipped or frozen in \d\d % of the train runs"),
    "backwards": (
        lambda table: table.iloc[::-1].reset_index(drop=True).assign(t=table["t"]),
        "sort the rows by time",
    ),
    "late_torque": (
        lambda table: table.assign(**{TAU: np.roll(table[TAU], 25)})[30:].reset_index(drop=True),
        " ms late",
    ),
}


@pytest.mark.parametrize(("kind", "first"), [*((kind, False) for kind in REFUSE), ("motor_side", True)])
def test_what_cannot_be_corrected_is_refused(wholes, tmp_path, kind, first):
    change, told = REFUSE[kind]
    folder = shutil.copytree(wholes["planted"][0], tmp_path / "d")
    change_runs(folder, change, first=first)
    with pytest.raises(InputError, match=told) as caught:
        close_loop(folder, tmp_path / "out", light=True)
    assert not first or "r1.parquet: " in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_robot_that_stands_still_in_one_run_is_left_out(wholes, tmp_path):
    whole, wanted = wholes["planted"]
    folder = shutil.copytree(whole, tmp_path / "d")
    rng = np.random.default_rng(0)
    still = lambda t: {Q: 0.1 + 1e-6 * rng.normal(size=len(t)), TAU: 3 + rng.normal(size=len(t))}  # noqa: E731
    change_runs(folder, lambda t: t.assign(**still(t)), first=True)
    assert alike(answer(folder, tmp_path / "out"), wanted)


@pytest.mark.parametrize(
    ("mass", "told"),
    [("0", "no link that the joints move has a mass"), ("62000", "times what the rigid body needs")],
)
def test_masses_that_no_machine_has_are_refused(wholes, tmp_path, mass, told):
    """None, and grams for kilograms."""
    folder = shutil.copytree(wholes["planted"][0], tmp_path / "d")
    urdf = folder / "robot.urdf"
    urdf.write_text(urdf.read_text().replace('<mass value="62.0"/>', f'<mass value="{mass}"/>'))
    with pytest.raises(InputError, match=told):
        close_loop(folder, tmp_path / "out", light=True)
