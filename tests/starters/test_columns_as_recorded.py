"""What a new user's recordings are, from CSV to the answer: each kind on machines of two sizes."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from recorded_chain import Bench, chain, rub, torque_of

from wearscope.closed_loop.intake.pushes import find_pushes
from wearscope.errors import InputError
from wearscope.starters.columns import find_groups, find_time
from wearscope.starters.mapped import Mapped, choose_groups

#: Torque of a chain with friction and noise.
LOAD = torque_of(1.2, 0.3, 0.4, noise=0.02)


@pytest.mark.parametrize(("n", "clock"), [(3, 0.5), pytest.param(2, 10.0, marks=pytest.mark.slow)])
def test_a_clock_that_is_wrong_is_told_first_and_taken(tmp_path, n, clock):
    """All speeds differ from the slopes of the positions by one factor, which no speed column's unit is."""
    bench = Bench(tmp_path, n, seconds=12.0).record(LOAD, speed=1.0, shown=clock)
    text = bench.refuse()
    assert f"the clock or the rate is wrong by a factor of {max(clock, 1 / clock):g}" in text
    said = re.search(r"give --time-scale (\S+),", text)
    assert said is not None and float(said[1]) == pytest.approx(1.0 / clock)
    notes = bench.accept("--time-scale", said[1])
    assert any("times those recorded, as 'time_scale' says" in note for note in notes)
    fields = yaml.safe_load((tmp_path / "d/dataset.yaml").read_text())
    assert fields["sample_rate"] == pytest.approx(bench.rate / clock, rel=1e-3)


@pytest.mark.parametrize(("n", "factor"), [(2, 57.2958), (1, 57.2958), (2, 9.5493)])
def test_speeds_of_another_unit_are_no_clock(tmp_path, n, factor):
    """Speeds in deg/s or rpm next to positions in rad; the torques fit the clock as it is."""
    bench = Bench(tmp_path, n, seconds=12.0).record(LOAD, speed=factor)
    text = bench.refuse()
    assert f"column 'qd_j1' is {factor:.3g} times the slope of 'q_j1'" in text and "clock" not in text
    assert "or leave the column out with --velocity none" in text
    bench.accept("--velocity", "none")


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_where_no_torque_tells_a_clock_from_a_unit_both_are_told(tmp_path, speed):
    """Friction alone is the same at any speed."""
    bench = Bench(tmp_path, 1, mass=1e-3, seconds=12.0)
    bench.record(lambda q, v, a, rng, t: np.tanh(v / 0.01) + rng.normal(0, 0.02, v.shape), speed=speed)
    text = bench.refuse()
    assert "the clock or the rate is wrong by a factor of 2" in text
    assert (
        "the speeds are in another unit: convert them, or leave the columns out with --velocity none" in text
    )


def test_one_speed_that_is_none_is_no_clock(tmp_path):
    bench = Bench(tmp_path, 2, seconds=12.0).record(LOAD, speed=np.array([1.0, 60.0]))
    assert "column 'qd_j2' is 60 times the slope of 'q_j2'" in bench.refuse()


@pytest.mark.parametrize("n", [3, 2])
def test_a_robot_that_stands_is_said_to_stand_with_its_pushes(tmp_path, n):
    bench = Bench(tmp_path, n, seconds=18.0, runs=2)

    def torque(q, v, a, rng, t):
        push = np.exp(-(((t - 6.0) / 0.4) ** 2)) + np.exp(-(((t - 12.0) / 0.4) ** 2))
        still = chain(0.0 * q + 0.3, 0.0 * q, 0.0 * q, 1.2, 0.3)
        return still - 3.0 * push[:, None] + rng.normal(0.0, 0.02, q.shape)

    text = bench.record(torque, position=lambda q, k: 0.3 + 1e-3 * q / np.abs(q).max()).refuse()
    assert "the robot stands still" in text and "pushed in" in text
    assert re.search(r"run0.* at 6\.0 s \(3 N m at j1", text) and "turn" not in text and "late" not in text


def test_pushes_have_their_times_and_sizes():
    t = np.arange(0.0, 20.0, 0.01)
    noise = np.random.default_rng(0).normal(0.0, 0.02, (len(t), 2))
    tau = noise + [1.0, -2.0] + np.exp(-(((t - 7.0) / 0.3) ** 2))[:, None] * [0.0, 4.0]
    ((when, sizes),) = find_pushes(t, tau)
    assert when == pytest.approx(7.0, abs=0.1) and sizes == pytest.approx([0.0, 4.0], abs=0.1)
    assert find_pushes(t, noise) == []


def test_files_without_names_are_taken_by_the_columns_that_are_given(tmp_path):
    bench = Bench(tmp_path, 2, seconds=9.0).record(LOAD)
    names = (tmp_path / "run0.csv").read_text().split("\n", 1)[0]
    for k in range(bench.runs):
        file = tmp_path / f"run{k}.csv"
        file.write_text(file.read_text().split("\n", 1)[1])
    assert f"--columns {names.split(',')[0]}" in bench.refuse()
    assert "has 5 columns, and --columns names 2" in bench.refuse("--columns", "time,q1")
    bench.accept("--columns", names)


def test_reference_gain_and_scale_of_time_stand_in_the_data_set(tmp_path):
    bench = Bench(tmp_path, 2, seconds=9.0).record(torque_of(1.2, 0.3, 0.4, 0.02, times=0.5))
    sessions = [f"run{k}.csv={'new' if k == 2 else 'old'}" for k in range(3)]
    options = [word for one in sessions for word in ("--session", one)]
    notes = bench.accept("--torque-gain", "j1=2,j2=2", "--reference", "old", *options)
    fields = yaml.safe_load((tmp_path / "d/dataset.yaml").read_text())
    assert fields["torque_gain"] == {"j1": 2.0, "j2": 2.0} and fields["reference"] == ["old"]
    assert any("tau_j1 times 2, tau_j2 times 2, as 'torque_gain' says" in note for note in notes)
    assert not any("times what the stated bodies need" in note for note in notes)


def test_a_lone_recording_is_cut_where_both_parts_move(tmp_path):
    """The robot stands in its last half."""
    bench = Bench(tmp_path, 2, seconds=30.0, runs=1)

    def stop(x):
        return np.where(np.arange(len(x))[:, None] < len(x) // 2, x, x[len(x) // 2])

    def torque(q, v, a, rng, t):
        moves = np.arange(len(t))[:, None] < len(t) // 2
        still = chain(stop(q), moves * v, moves * a, 1.2, 0.3)
        return still + rub(moves * v, 0.3, 0.4) + rng.normal(0.0, 0.02, q.shape)

    done = bench.record(torque, position=lambda q, k: stop(q)).take()
    assert done.exit_code == 0, done.output + str(done.exception)
    seconds = re.search(r"the one recording's last (\d+) s", done.output)
    assert seconds is not None and 15 < int(seconds[1]) < 25


def test_a_recording_that_is_too_short_says_how_long_it_must_be(tmp_path):
    bench = Bench(tmp_path, 1, seconds=3.0, runs=1).record(LOAD)
    assert re.search(r"run0\.csv: 3 s are too short to be cut .* record 13 s or more", bench.refuse())


@pytest.mark.parametrize(
    ("joints", "columns", "commanded"),
    [
        (["d1", "d2"], ["tau_d1", "tau_d2"], False),
        (["ref", "goal"], ["tau_ref", "tau_goal"], False),
        (["j1", "j2"], ["tau_d_j1", "tau_d_j2"], True),
        (["j1", "j2"], ["tau_d1", "tau_d2"], True),
    ],
)
def test_a_joint_s_name_does_not_say_that_a_torque_was_commanded(joints, columns, commanded):
    """A word "d" means desired torques, and may also be a joint's name."""
    (group,) = find_groups(columns, joints, "torque")
    assert list(group.columns) == columns and group.is_commanded == commanded


def test_counts_of_one_joint_are_told_and_taken(tmp_path):
    """The others are in rad, so that no option for all joints fits."""
    bench, counts = Bench(tmp_path, 2), np.array([4e4, 1.0])
    bench.record(LOAD, position=lambda q, k: np.where(counts > 1.0, np.round(counts * q), q))
    said = bench.refuse()
    assert "column 'q1' alone has whole numbers" in said and "--scale q_j1=X" in said
    bench.accept("--position-unit", "rad", "--scale", "q_j1=0.000025")


def test_a_slide_may_have_words_of_its_own():
    columns = ["Zeit [s]", "Winkel_A1 [°]", "Weg_Z [mm]", "Moment_A1 [Nm]", "Kraft_Z [N]"]
    found = [find_groups(columns, ["A1", "Z"], kind)[0].columns for kind in ("position", "torque")]
    assert found == [tuple(columns[1:3]), tuple(columns[3:])]


def test_a_unit_may_tell_the_kind_at_one_joint_and_a_word_at_another():
    columns = ["us", "Slew angle (deg)", "Boom angle (deg)", "Extension (m)", "Slew moment (kNm)"]
    columns += ["Boom moment (kNm)", "Extension force (kN)"]
    joints = ["slew", "boom", "extension"]
    found = [find_groups(columns, joints, kind) for kind in ("position", "torque")]
    assert [[group.columns for group in one] for one in found] == [
        [tuple(columns[1:4])],
        [tuple(columns[4:])],
    ]
    assert find_groups(columns, joints, "position")[0].factors.tolist() == [np.pi / 180, np.pi / 180, 1.0]
    assert find_time(columns) == ("us",)


def test_a_file_that_names_every_joint_is_not_taken_for_one_joint_s():
    """The two names differ in words that tell nothing, so that they make no set."""
    columns = ["t", "slew lower angle", "boom upper angle"]
    with pytest.raises(
        InputError, match=r"no column of positions is found for each of slew, boom; name them"
    ):
        choose_groups(Path("log.csv"), columns, ["slew", "boom"], Mapped())


@pytest.mark.parametrize(("place", "told"), [(0.7, True), (0.0, False)])
def test_a_joint_that_is_left_out_away_from_zero_is_told(tmp_path, place, told):
    bench = Bench(tmp_path, 2).record(LOAD, position=lambda q, k: q * [1.0, 0.0] + [0.0, place])
    said = " ".join(bench.take("--joints", "j1").output.split())
    assert (f"j2: locked at 0, but column 'q2' goes from {place:g} to {place:g} in run0.csv" in said) == told


@pytest.mark.parametrize(("delay", "refused"), [(0.08, False), (0.15, True)])
def test_a_delay_of_less_than_half_a_row_is_not_refused(tmp_path, delay, refused):
    """A slow recorder's row may hold what happened since the row before it."""

    def torque(q, v, a, rng, t):
        return LOAD(q - v * delay + 0.5 * a * delay**2, v - a * delay, a, rng, t)

    bench = Bench(tmp_path, 2, size=0.8, rate=5.0, seconds=150.0, frequencies=(0.05, 0.11, 0.23))
    bench.record(torque)
    if refused:
        told = re.search(r"(?:come|smoothed over about) (\d+) ms", bench.refuse())
        assert float(told[1]) == pytest.approx(1000.0 * delay, abs=30.0)
    else:
        bench.accept()


@pytest.mark.parametrize(("step", "told"), [(1.0, True), (0.5, False)])
def test_whole_numbers_without_a_unit_may_be_shares_of_a_rated_torque(tmp_path, step, told):
    bench = Bench(tmp_path, 2, mass=40.0)
    heavy = torque_of(40.0, 9.0, 12.0, noise=0.6)
    notes = bench.record(lambda *at: step * np.round(heavy(*at) / step)).accept()
    assert (
        any("whole numbers may be per mille or counts (then --torque-constant)" in n for n in notes) == told
    )


def test_a_joint_that_has_another_name_in_the_file_is_guessed(tmp_path):
    """A telescope's axis RA is recorded as HA; without it, gravity acts along another direction."""
    bench = Bench(tmp_path, 2, size=0.8).record(LOAD)
    for file in tmp_path.glob("run*.csv"):
        file.write_text(file.read_text().replace("q1", "HA_rad").replace("q2", "j2_rad"))
    told = bench.refuse("--torque", "tau1,tau2")
    assert "and none that name j1" in told and "give --position 'HA_rad,j2_rad'" in told
    bench.accept("--torque", "tau1,tau2", "--position", "HA_rad,j2_rad")
