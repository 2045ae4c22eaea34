"""Columns that are not what they are said to be are refused with the right remedy; good data never are."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from changed_fields import changed_fields, write_fields
from folders import change_runs, check, find_real, plan, read_prepared, scale

from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Planted, Recipe
from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.closed_loop.intake.traits.rows import Rows
from wearscope.closed_loop.intake.traits.score import Weighing
from wearscope.errors import InputError

PLANS = plan(("fourier", 24.0), ("points", 31.0), ("sweep", 40.0))
GRAVITY, MASS, LENGTH, MOMENT, RATE = 9.81, 4.0, 0.5, 0.3, 200.0
PENDULUM = f"""<robot name="pendulum"><link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 {-LENGTH}"/><mass value="{MASS}"/>
    <inertia ixx="{MOMENT}" iyy="{MOMENT}" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>"""
LIMITS = '<limit lower="-9" upper="9" effort="900" velocity="90"/>'


def refuse(folder, pattern):
    with pytest.raises(InputError) as caught:
        check(folder)
    text = str(caught.value)
    assert text.startswith(str(folder)) and "\n" not in text and text.endswith(".")
    assert re.search(pattern, text), text


def change_fields(folder, change):
    with changed_fields(folder / "dataset.yaml") as fields:
        change(fields)


def swing(folder: Path, size: float, friction: float = 1.0, further=lambda q, v: 0.0, runs: int = 3) -> Path:
    """Recordings of a pendulum by its textbook equation: no URDF, no Pinocchio. The last is a test run."""
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(PENDULUM)
    listed = []
    for k in range(runs):
        rng = np.random.default_rng(k)
        t = np.arange(int(10 * RATE)) / RATE
        q, v, a = np.zeros((3, len(t)))
        for w, phase in zip(rng.uniform(1.0, 6.0, 4), rng.uniform(0, 6, 4), strict=True):
            q += size / 2 * np.sin(w * t + phase)
            v += size / 2 * w * np.cos(w * t + phase)
            a -= size / 2 * w**2 * np.sin(w * t + phase)
        tau = (MOMENT + MASS * LENGTH**2) * a + MASS * GRAVITY * LENGTH * np.sin(q)
        tau += friction * np.sign(v) + 0.5 * friction * v + further(q, v) + 0.05 * rng.normal(size=len(t))
        table = {"t": t, "q_pivot": q + 1e-6 * rng.normal(size=len(t)), "tau_pivot": tau}
        pd.DataFrame(table).to_parquet(folder / f"runs/{k}.parquet", index=False)
        listed.append({"file": f"runs/{k}.parquet", "use": "train" if k < runs - 1 else "test"})
    return write_fields(folder, ["pivot"], RATE, listed, ["rigid_body", "coulomb", "viscous"])


def slow(*case):
    """A case like another one here."""
    return pytest.param(*case, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("size", "friction"),
    [(0.1, 8.0), (0.5, 1.0), (2.0, 0.0), *(slow(a, b) for a, b in ((0.1, 0.0), (2.0, 8.0)))],
)
def test_a_pendulum_is_believed(tmp_path, size, friction):
    check(swing(tmp_path / "p", size, friction))


@pytest.mark.parametrize(("moment", "behind"), [(0.1, True), (0.004, False)])
def test_a_torque_behind_the_gear_has_no_rotor_in_it(tmp_path, moment, behind):
    """Body and rotor move alike: the torque is the body's alone, or of a unit that neither has."""
    folder = swing(tmp_path / "p", 1.0)
    upright = PENDULUM.replace('xyz="0 1 0"/></joint>', 'xyz="0 0 1"/></joint>')
    (folder / "robot.urdf").write_text(upright)

    def measure(table):
        a = table["q_pivot"].rolling(9, center=True, min_periods=1).mean().diff().diff().fillna(0.0) * RATE**2
        return table.assign(tau_pivot=moment * a.rolling(9, center=True, min_periods=1).mean())

    change_runs(folder, measure)
    change_fields(folder, lambda f: f["robot"].update(rotor_inertia=[5.0]))
    change_fields(folder, lambda f: f.update(declared_effects=["rotor_inertia", "coulomb", "viscous"]))
    if behind:
        check(folder)
    else:
        refuse(folder, "'tau_pivot' is 0.0[34].* times what the rigid body needs")


def test_noise_far_below_the_bodys_torque_is_not_explained(tmp_path):
    """The fit takes the body's torque away; what is left then is rounding errors of either sign."""
    rows = Rows.of(check(swing(tmp_path / "p", 1.0)))
    noise = np.random.default_rng(1).standard_normal(rows.tau.shape)
    for size in 10.0 ** -np.arange(5.0, 14.0):
        fit = Weighing(replace(rows, tau=size * noise)).fit(Reading.stated(1))
        assert fit.leave_plain()[0] > 0.9, size


@pytest.mark.parametrize("drag", [slow(5.0), 20.0, slow(60.0)])
def test_what_the_model_lacks_is_no_delay_of_the_recorder(tmp_path, drag):
    """A drag that grows with the square of the angle: along one of the runs it looks 140 ms late."""
    check(swing(tmp_path / "p", 2.0, further=lambda q, v: drag * q**2 * v, runs=6))


def rub_by_load(q, v, share=1.1, stiffness=1000.0):
    """Friction of a worm gear: a share of the load, which builds up over some way after a reversal (Dahl)."""
    load = (MOMENT + MASS * LENGTH**2) * np.gradient(v) * RATE + MASS * GRAVITY * LENGTH * np.sin(q)
    level, bent, torque = 1.0 + share * np.abs(load), 0.0, np.zeros_like(q)
    for k, step in enumerate(v / RATE):
        bent = (bent + step) / (1.0 + abs(step) * stiffness / level[k])
        torque[k] = stiffness * bent
    return torque


def test_friction_that_builds_up_with_the_load_is_no_delay(tmp_path):
    notes = check(swing(tmp_path / "p", 0.6, 0.2, further=rub_by_load)).notes
    assert not [note for note in notes if "late" in note or "follow the motion" in note]


@pytest.mark.parametrize(
    ("turned", "further"),
    [
        # In every run; in the first one; in the first one of a machine with an undeclared torque.
        (range(4), None),
        ([0], None),
        ([0], lambda q, v: 25.0 * np.cos(3.0 * q)),
    ],
)
def test_runs_whose_torque_has_the_opposite_sign_are_named(tmp_path, turned, further):
    folder = swing(tmp_path / "p", 1.0, further=further or (lambda q, v: 0.0), runs=4)
    for k in turned:
        file = folder / f"runs/{k}.parquet"
        scale("tau_pivot", -1.0)(pd.read_parquet(file)).to_parquet(file, index=False)
    every = len(turned) > 1
    refuse(folder, "opposite sign" if every else r"0\.parquet: .*'tau_pivot' has the opposite sign")


PENDULUM_FAULTS = {
    "degrees": (scale("q_pivot", 180 / np.pi), "positions look like degrees; convert q to rad"),
    "motor_side": (scale("tau_pivot", 1 / 80), "'tau_pivot' is 0.0125 times what the rigid body needs"),
    "newton_millimetres": (
        scale("tau_pivot", 1000.0),
        "'tau_pivot' is (999|1e\\+03) times what the rigid body",
    ),
    "opposite_sign": (scale("tau_pivot", -1.0), "opposite sign of what the motion needs"),
    "time_reversed": (
        lambda table: table.iloc[::-1].reset_index(drop=True).assign(t=table["t"]),
        "motion run backwards; sort the rows",
    ),
    "other_recording": (
        lambda table: table.assign(tau_pivot=np.random.default_rng(0).permutation(table["tau_pivot"])),
        "next to nothing of the torque",
    ),
    "late": (
        lambda table: table.assign(tau_pivot=np.roll(table["tau_pivot"], 16))[20:].reset_index(drop=True),
        "torque channels come (79|80|81) ms late",
    ),
    "speeds_in_degrees": (
        lambda table: table.assign(qd_pivot=np.gradient(table["q_pivot"], table["t"]) * 180 / np.pi),
        r"column 'qd_pivot' is 57\.\d times the slope of 'q_pivot'",
    ),
}


def wrap(table):
    return table.assign(q_pivot=table["q_pivot"] % (2.0 * np.pi))


def log_before_the_start(table):
    return table.assign(q_pivot=np.where(table.index < 2, 3.0, table["q_pivot"]))


@pytest.mark.parametrize("change", [wrap, log_before_the_start], ids=["turns", "first rows"])
def test_speeds_are_those_of_the_positions_as_cleaned(tmp_path, change):
    """A full turn, or first rows that are none, are no slope of the position."""
    folder = swing(tmp_path / "p", 2.0)
    change_runs(folder, lambda table: table.assign(qd_pivot=np.gradient(table["q_pivot"], table["t"])))
    change_runs(folder, change)
    check(folder)
    change_runs(folder, scale("qd_pivot", 60.0))
    refuse(folder, r"'qd_pivot' is (59|60)[.\d]* times the slope of 'q_pivot' \(correlation (0\.99|1\.00)")


@pytest.mark.parametrize("fault", PENDULUM_FAULTS)
def test_small_motions_tell_what_is_wrong(tmp_path, fault):
    """Ten degrees of swing, no limits in the URDF, no gear ratio: only the torque can tell."""
    change, pattern = PENDULUM_FAULTS[fault]
    folder = swing(tmp_path / "p", 0.17)
    change_runs(folder, change)
    refuse(folder, pattern)


def move_torque(starts, drift=0.0):
    """Torques of recorders that start late by other times [s] and count time by another clock."""
    late = iter(starts)

    def change(table):
        t = table["t"] - table["t"][0]
        return table.assign(tau_pivot=np.interp(t - next(late) - drift * t, t, table["tau_pivot"]))

    return change


@pytest.mark.parametrize(("start", "drift"), [(0.0, 0.006), (0.03, -0.008)])
def test_a_torque_with_a_clock_of_its_own_is_told_with_both_numbers(tmp_path, start, drift):
    """One delay does not align it, and a filter does not either."""
    folder = swing(tmp_path / "p", 1.0)
    change_runs(folder, move_torque([start] * 3, drift))
    change_fields(folder, lambda fields: fields["declared_effects"].append("time_delay"))
    with pytest.raises(InputError) as caught:
        check(folder)
    told = re.search(r"clock that differs by ([\d.]+) %.* t - \((\S+) (\S+) t\)", str(caught.value)).groups()
    assert float(told[0]) == pytest.approx(100 * abs(drift), abs=0.05)
    assert [float(one) for one in told[1:]] == pytest.approx([start, drift], abs=0.002)


def test_recorders_that_start_by_hand_are_told_with_the_time_of_each_run(tmp_path):
    starts = [0.0, 0.06, 0.13, 0.035]
    folder = swing(tmp_path / "p", 1.0, runs=4)
    change_runs(folder, move_torque(starts))
    with pytest.raises(InputError, match="another time in each run") as caught:
        check(folder)
    told = re.findall(r"(-?\d+) ms in runs/\d.parquet", str(caught.value))
    assert [int(one) for one in told] == pytest.approx([1000 * one for one in starts], abs=4)
    change_fields(folder, lambda fields: fields.update(accept=["clock tau"]))
    check(folder)


def test_gear_ratio_names_the_remedy(tmp_path):
    folder = swing(tmp_path / "p", 1.0)
    change_runs(folder, scale("tau_pivot", 1 / 80))
    change_fields(folder, lambda d: d["robot"].update(gear_ratio=[80.0]))
    refuse(folder, "looks like motor-side torque: multiply it with the gear ratio")


def test_gravity_must_be_that_of_the_recording(tmp_path):
    folder = swing(tmp_path / "p", 1.0)
    change_fields(folder, lambda d: d["robot"].update(gravity=[0, 0, 9.81]))
    refuse(folder, r"gravity acts along \[0, 0, -9.81\] in the base frame")
    change_fields(folder, lambda d: d["robot"].update(gravity=[0, 0, -1.0]))
    refuse(folder, r"gravity is not 1 m/s\^2 strong")


def test_limits_of_the_urdf_tell_degrees(tmp_path):
    folder = swing(tmp_path / "p", 2.0)
    limit = 'type="revolute"><limit lower="-2.9" upper="2.9" effort="50" velocity="9"/>'
    (folder / "robot.urdf").write_text(PENDULUM.replace('type="continuous">', limit))
    check(folder)
    change_runs(folder, scale("q_pivot", 180 / np.pi), use="test")
    refuse(folder, r"2\.parquet: positions look like degrees")


@pytest.mark.parametrize("count", [2.0, slow(6.0)])
def test_a_coarse_torque_is_not_frozen(tmp_path, count):
    folder = swing(tmp_path / "p", 0.3, friction=3.0)
    change_runs(folder, lambda table: table.assign(tau_pivot=count * np.round(table["tau_pivot"] / count)))
    assert not [note for note in check(folder).notes if "does not change" in note]


def test_a_run_with_the_drive_off_does_not_spoil_the_others(tmp_path):
    folder = swing(tmp_path / "p", 0.5, runs=4)
    change_runs(
        folder, lambda table: table.assign(tau_pivot=0.01 * np.round(table.index % 7 == 0)), "train", True
    )
    prepared = check(folder)
    assert not prepared.runs[0].keep.any() and prepared.runs[1].keep.mean() > 0.8


def test_a_few_rows_do_not_say_that_a_drive_is_off(tmp_path):
    prepared = check(swing(tmp_path / "p", 1.0))
    first, *others = prepared.runs
    at = np.flatnonzero(first.keep[:, 0])[10:16]
    few = replace(first, keep=np.isin(np.arange(len(first.keep)), at)[:, None])
    some = replace(prepared, runs=[few, *others], notes=[])
    Rows.of(some)
    assert some.notes == []


def test_a_lag_may_be_declared(tmp_path):
    folder = swing(tmp_path / "p", 1.0)
    change_runs(folder, PENDULUM_FAULTS["late"][0])
    change_fields(folder, lambda d: d["declared_effects"].append("time_delay"))
    check(folder)


def test_a_body_without_mass_is_refused(tmp_path):
    folder = swing(tmp_path / "p", 1.0)
    (folder / "robot.urdf").write_text(re.sub(r"<inertial>.*</inertial>", "", PENDULUM, flags=re.S))
    refuse(folder, "robot.urdf: no link that the joints move has a mass")


@pytest.fixture(scope="module")
def arm(record_at, tmp_path_factory):
    planted = [(0, "stribeck", {"level": 8.0, "speed": 0.3, "exponent": 1.0})]
    return record_at(tmp_path_factory.mktemp("arm") / "d", planted, runs=3, duration=8.0, seed=3, rate=100.0)


def test_speed_columns_of_zeros_are_refused(arm, tmp_path):
    """Zeros in the place of most speeds are neither another unit nor a wrong clock."""
    folder = shutil.copytree(arm, tmp_path / "d")
    change_runs(folder, lambda table: table.assign(qd_a=0.0, qd_b=0.0))
    change_runs(folder, lambda table: table.assign(qd_a=np.gradient(table["q_a"], table["t"])), first=True)
    refuse(folder, r"column 'qd_[ab]' is 0 times the slope of 'q_[ab]'")


def exchange(*kinds):
    pairs = {f"{kind}_{x}": f"{kind}_{y}" for kind in kinds for x, y in ("ab", "ba")}
    return lambda table: table.rename(columns=pairs)


def turn(*columns):
    return lambda table: table.assign(**{c: -table[c] for c in columns})


def hold(table):
    return table.assign(q_b=table["q_b"].iloc[0])


ARM_FAULTS = {
    "torques_exchanged": (exchange("tau"), "exchange 'tau_a' with 'tau_b'"),
    "positions_exchanged": (exchange("q"), "exchange 'q_a' with 'q_b'"),
    "joints_exchanged": (
        exchange("q", "tau"),
        "exchange 'q_a' with 'q_b' and 'tau_a' with 'tau_b'",
    ),
    "one_sign": (turn("tau_b"), "column 'tau_b' has the opposite sign of what the motion"),
    "one_axis": (
        turn("tau_b", "q_b"),
        "'q_b' and 'tau_b' have the opposite sign of the URDF",
    ),
    "one_position": (turn("q_b"), "column 'q_b' has the opposite sign of the URDF"),
    "one_motor_side": (
        scale("tau_b", 1 / 80),
        "'tau_b' is 0.01[23]\\d times what the rigid body needs",
    ),
    "one_in_degrees": (
        scale("q_b", 180 / np.pi),
        "column 'q_b' (looks like degrees|reaches .* if it is in degrees)",
    ),
    "dead_encoder": (hold, "'q_b' never changes while 'tau_b' swings"),
}


@pytest.mark.parametrize(
    ("fault", "where"),
    [*((fault, "all") for fault in ARM_FAULTS), slow("torques_exchanged", "one"), ("one_axis", "one")],
)
def test_faults_of_an_arm_are_told_in_all_runs_and_in_one(arm, tmp_path, fault, where):
    change, pattern = ARM_FAULTS[fault]
    folder = shutil.copytree(arm, tmp_path / "d")
    change_runs(folder, change, first=where == "one")
    refuse(folder, pattern)


def lighten_last_link(folder, share):
    text = (folder / "robot.urdf").read_text()
    start = text.rindex("<inertial>")
    own = re.sub(
        r'((?:value|i[xyz][xyz])=")([^"]*)"', lambda m: f'{m[1]}{share * float(m[2]):.9g}"', text[start:]
    )
    (folder / "robot.urdf").write_text(text[:start] + own)


@pytest.mark.parametrize(("off", "known"), [(0.0, True), (0.1, False)])
def test_gravity_that_a_controllers_own_model_took_out_is_told(tmp_path, off, known):
    """Its masses are off, or it knows no payload: the weight of the rest stays in the torque."""
    recipe = Recipe(duration=8.0, plans=PLANS, inertia_error=off)
    folder = tmp_path / "d"
    generate_dataset(folder, "arm3", [Planted("stribeck", "waist", 8.0)], 3, recipe)
    joints = yaml.safe_load((folder / "dataset.yaml").read_text())["robot"]["joints"]
    body = read_prepared(folder).runs[0].signals.rigid_body
    body = body if known else body.with_payload(None)

    def take_out(table):
        q = table[[f"q_{joint}" for joint in joints]].to_numpy()
        gravity = body.inverse_dynamics(q, 0.0 * q, 0.0 * q)
        return table.assign(
            **{f"tau_{j}": table[f"tau_{j}"] - g for j, g in zip(joints, gravity.T, strict=True)}
        )

    change_runs(folder, take_out)
    refuse(
        folder, 'no gravity in it; write "torque: without_gravity"' if known else "has the payload's gravity"
    )


@pytest.mark.parametrize("angle", [0.06, 0.2])
def test_a_slope_under_the_base_is_told_where_it_is_steep(tmp_path, angle):
    """The stated gravity is turned against that of the recordings, by 3 and 11 degrees."""
    folder = tmp_path / "d"
    generate_dataset(folder, "arm3", [], 3, Recipe(duration=8.0, plans=PLANS))
    along = [float(9.81 * np.sin(angle)), 0.0, float(-9.81 * np.cos(angle))]
    change_fields(folder, lambda d: d["robot"].update(gravity=along, inertials="approximate"))
    if angle > 0.1:
        refuse(folder, r"gravity acts along \[-?0(\.[01]\d*)?, -?0(\.[01]\d*)?, -9\.8\d*\] in the base frame")
    else:
        check(folder)


def raise_slide(folder, weight, mass=MASS):
    """Turn the recordings into those of a vertical slide that carries a weight [N], with a link of a mass."""
    slide = PENDULUM.replace("continuous", "prismatic").replace('xyz="0 1 0"/>', 'xyz="0 0 1"/>' + LIMITS)
    (folder / "robot.urdf").write_text(slide.replace(f'mass value="{MASS}"', f'mass value="{mass}"'))

    def lift(table):
        v = np.gradient(table["q_pivot"], 1.0 / RATE)
        return table.assign(tau_pivot=MASS * np.gradient(v, 1.0 / RATE) + 3.0 * np.sign(v) + weight)

    change_runs(folder, lift)
    change_fields(folder, lambda fields: fields.update(units={"q": "m", "tau": "N"}))


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_a_constant_weight_that_is_missing_is_told(tmp_path, share):
    """On a vertical slide it is an offset, which a fit has at any size; what is there of it is said."""
    weight = share * MASS * GRAVITY
    folder = swing(tmp_path / "p", 1.0)
    raise_slide(folder, weight)
    told = [note for note in check(folder).notes if "of the weight that the stated bodies have" in note]
    assert bool(told) == (share < 0.5)
    if told:
        stated, has = re.search(r"there, (\S+) N on average, this torque has (\S+) N", told[0]).groups()
        assert float(stated) == pytest.approx(MASS * GRAVITY, rel=0.01)
        assert float(has) == pytest.approx(weight, abs=0.02 * MASS * GRAVITY)


def test_a_slide_that_counts_downwards_is_named_next_to_gravity(tmp_path):
    """Its torque is that of gravity upwards."""
    folder = swing(tmp_path / "p", 0.1)
    raise_slide(folder, -MASS * GRAVITY)
    refuse(folder, r"'q_pivot' and 'tau_pivot' have the opposite sign .* gravity acts along \[0, 0, 9\.81\]")


def test_a_light_link_s_weight_is_not_missed_next_to_its_payload_s(tmp_path):
    """Less than the link's own weight is missing, of a torque that the payload's makes."""
    folder = swing(tmp_path / "p", 1.0)
    raise_slide(folder, 0.985 * MASS * GRAVITY, 0.02 * MASS)
    with changed_fields(folder / "dataset.yaml") as fields:
        for run in fields["runs"]:
            run["payload"] = {"mass": 0.98 * MASS, "com": [0.0, 0.0, 0.0]}
    assert not [note for note in check(folder).notes if "of the weight that" in note]


@pytest.mark.parametrize("share", [0.03, slow(0.1)])
def test_a_load_that_nobody_declared_is_no_other_unit(arm, tmp_path, share):
    """A last link of which the URDF knows a small share: its joint needs many times that, the others more."""
    folder = shutil.copytree(arm, tmp_path / "d")
    lighten_last_link(folder, share)
    check(folder)


@pytest.mark.parametrize("factor", [8.0, slow(20.0), slow(1000.0)])
def test_another_unit_is_no_load(arm, tmp_path, factor):
    folder = shutil.copytree(arm, tmp_path / "d")
    change_runs(folder, scale("tau_b", factor))
    refuse(folder, "'tau_b' is .* times what the rigid body needs")


@pytest.mark.slow
def test_faults_of_a_test_run_are_told(arm, tmp_path):
    folder = shutil.copytree(arm, tmp_path / "d")
    change_runs(folder, exchange("tau"), use="test")
    refuse(folder, r"r2\.parquet: columns look swapped")


def test_a_joint_that_is_really_held_is_believed(tmp_path):
    """A brake takes the load: the motor of the joint idles."""
    folder = swing(tmp_path / "p", 1.0)
    text = (folder / "robot.urdf").read_text()
    link = text[text.index('<link name="rod">') : text.index("</link>") + 7].replace("rod", "tool")
    joint = '<joint name="held" type="continuous"><parent link="rod"/><child link="tool"/></joint>'
    light = re.sub(rf'"({MASS}|{MOMENT}|0\.1)"', '"1e-4"', link)
    (folder / "robot.urdf").write_text(text.replace("</robot>", f"{light}{joint}</robot>"))
    rng = np.random.default_rng(1)
    change_runs(folder, lambda t: t.assign(q_held=0.0, tau_held=0.3 * rng.normal(size=len(t))))
    change_fields(folder, lambda d: d["robot"].update(joints=["pivot", "held"]))
    assert check(folder).moving.tolist() == [True, False]


@pytest.mark.parametrize(("robot", "seed"), [("arm3", 0), ("arm6", 1), ("stage", 0)])
def test_good_data_are_never_refused(tmp_path, robot, seed):
    plants = {
        "arm3": [("gravity_counterbalance", "shoulder"), ("joint_elasticity", "waist")],
        "arm6": [("backlash", "j4"), ("cross_coupling", "j6")],
        "stage": [("time_delay", "slide"), ("torque_ripple", "slide")],
    }[robot]
    for k, (effect, joint) in enumerate([*plants, (None, None)]):
        planted = [Planted(effect, joint, 8.0)] if effect else []
        noise = ("plain", "heavy", "jitter")[k]
        recipe = Recipe(duration=6.0, plans=PLANS, noise=noise, noise_level=0.02, inertia_error=0.05 * seed)
        generate_dataset(tmp_path / f"d{k}", robot, planted, seed, recipe)
        check(tmp_path / f"d{k}")


@pytest.mark.parametrize(("name", "more"), [("emps", "|times what"), ("kr300", "")], ids=["emps", "kr300"])
def test_real_machines_are_believed(name, more):
    """Bodies that are off may be noted: on KR300 a diagnosis names and confirms a payload error."""
    prepared = check(find_real(name))
    assert prepared.moving.all()
    assert not any(re.search(f"at a limit|cut off|times as large{more}", note) for note in prepared.notes)


@pytest.mark.slow
def test_a_factor_of_a_real_machine_s_torques_is_told_next_to_a_payload(tmp_path):
    folder = shutil.copytree(find_real("kr300"), tmp_path / "kr300")
    change_runs(folder, lambda x: x.assign(**{k: 3.0 * x[k] for k in x if k.startswith("tau")}))
    notes = check(folder).notes
    assert any("kg heavier than stated" in note for note in notes)
    (told,) = [note for note in notes if "times what the stated bodies need" in note]
    assert told.startswith("or, which these motions do not tell from a payload, ")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_real_machine_with_positions_of_another_scale_is_told(tmp_path, factor):
    """Its balancer is not in the model."""
    folder = shutil.copytree(find_real("kr300"), tmp_path / "kr300")
    change_runs(folder, lambda table: table.assign(**factor * table.filter(regex="^q")))
    with pytest.raises(InputError, match="fit the URDF where multiplied by") as caught:
        check(folder)
    told = re.search(r"multiplied by (\S+), as turns", str(caught.value))
    assert told is not None and float(told[1]) == pytest.approx(1.0 / factor, rel=0.05)
