import errno
import os
import signal
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pybullet
import pytest
from calls import call_python

from wearscope.cycles.base import Cycle, Reference, load_cycle
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.simulation import chunk, feasibility, study
from wearscope.simulation.feasibility import check_cycle, check_robot, check_start
from wearscope.simulation.recording import point_path, read_fingerprint, read_points, read_recording
from wearscope.storage import tables

ROOT = Path(__file__).parents[2]
KINDS = {"f": "wear", "w3": "temperature", "w4": "dwell", "w5": "payload_mass_error"}
RANGES = {"f": ("wear", 0.0, 50.0), "w3": ("temperature", 30.0, 70.0), "w4": ("dwell", 25.0, 75.0)}
PLAN = chunk.Plan("medium", "short_moves", KINDS, 0, 0.001)


@pytest.fixture(scope="module")
def model():
    return load_model("medium", ROOT / "config" / "robots")


@pytest.fixture(scope="module")
def cycle():
    return load_cycle(str(ROOT / "tests" / "workflow" / "tiny" / "short_moves.py"))


def make_row(point, f=0.0, w3=50.0, w4=50.0, w5=0.0):
    return {"point": point, "f_natural": f, "w3_natural": w3, "w4_natural": w4, "w5_natural": w5}


ROWS = [make_row(1), make_row(2, f=50.0), make_row(3, w4=75.0)]


def simulate(folder, rows, model, cycle, common="code", plan=PLAN, *more):
    return chunk.simulate_chunk(folder, "identification", rows, model, cycle, plan, common, *more)


def make_cycle(build):
    return Cycle("mine", "Mine.", build)


def go_too_far(cycle):
    """The test-cycle five radians further than it goes."""

    def build(model, dwell, step):
        good = cycle.build(model, dwell, step)
        return Reference(good.t, good.q + 5.0, good.v, good.a)

    return make_cycle(build)


def test_points_do_not_depend_on_how_they_are_chunked(tmp_path, model, cycle):
    simulate(tmp_path / "whole", ROWS, model, cycle)
    for row in reversed(ROWS):
        simulate(tmp_path / "parts", [row], model, cycle)
    for point in (1, 2, 3):
        whole, part = (point_path(tmp_path / name, "identification", point) for name in ("whole", "parts"))
        assert whole.read_bytes() == part.read_bytes()
    times = {
        point: one.t[-1] for point, one in read_points(tmp_path / "whole", "identification", [1, 3], model)
    }
    assert times[3] == pytest.approx(times[1] + 3 * 0.025, abs=0.006)  # three dwells, 25 ms longer


def test_finished_points_are_kept_and_stale_ones_made_again(tmp_path, model, cycle):
    prints = simulate(tmp_path, ROWS, model, cycle).fingerprints
    paths = {point: point_path(tmp_path, "identification", point) for point in prints}
    assert {point: read_fingerprint(path) for point, path in paths.items()} == prints
    paths[2].write_bytes(paths[2].read_bytes()[:100])
    moments = {point: path.stat().st_mtime_ns for point, path in paths.items()}
    assert simulate(tmp_path, ROWS, model, cycle).fingerprints == prints
    assert [point for point, path in paths.items() if path.stat().st_mtime_ns != moments[point]] == [2]
    read_recording(paths[2])
    moments = {point: path.stat().st_mtime_ns for point, path in paths.items()}
    changed = simulate(tmp_path, [ROWS[0], make_row(2, f=25.0), ROWS[2]], model, cycle).fingerprints
    assert [point for point in prints if changed[point] != prints[point]] == [2]
    assert [point for point, path in paths.items() if path.stat().st_mtime_ns != moments[point]] == [2]
    assert simulate(tmp_path, ROWS[:1], model, cycle, common="other code").fingerprints[1] != prints[1]


def test_recording_with_a_flipped_bit_is_made_again_though_its_fingerprint_holds(tmp_path, model, cycle):
    simulate(tmp_path, ROWS[:2], model, cycle)
    path = point_path(tmp_path, "identification", 2)
    good = path.read_bytes()
    place = good.index(b"fingerprint") - len(good) // 3  # within the pages, before the footer
    path.write_bytes(good[:place] + bytes([good[place] ^ 16]) + good[place + 1 :])
    assert pq.read_schema(path).metadata[b"fingerprint"]
    simulate(tmp_path, ROWS[:2], model, cycle)
    assert path.read_bytes() == good


def test_seed_and_identity_change_the_noise(tmp_path, model, cycle):
    other = chunk.Plan("medium", "short_moves", KINDS, 1, 0.001)
    simulate(tmp_path / "a", [make_row(1), make_row(2)], model, cycle)
    simulate(tmp_path / "b", [make_row(1)], model, cycle, plan=other)
    one, two, three = (
        read_recording(point_path(tmp_path / name, "identification", point)).tau
        for name, point in (("a", 1), ("a", 2), ("b", 1))
    )
    assert not (one == two).all() and not (one == three).all()


def fail_at(monkeypatch, number, error):
    """Make the run with that number break off at its end."""
    genuine = study.run_motion

    def run(*arguments):
        trace = genuine(*arguments)
        run.count += 1
        if run.count == number:
            raise error
        return trace

    run.count = 0
    monkeypatch.setattr(study, "run_motion", run)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (study.SimulationError("the motor is lost."), "the motor is lost"),
        (ZeroDivisionError("no\nmass"), "ZeroDivisionError: no mass"),
        (np.linalg.LinAlgError("Singular matrix"), "LinAlgError: Singular matrix"),
        (pybullet.error("Not connected"), "error: Not connected"),
    ],
)
def test_failed_run_is_told_and_the_others_are_written(tmp_path, model, cycle, monkeypatch, error, reason):
    whole = simulate(tmp_path / "whole", ROWS, model, cycle)
    assert whole.failed == {}
    simulate(tmp_path / "part", [make_row(2, f=25.0)], model, cycle)  # an older recording of the point
    fail_at(monkeypatch, 2, error)
    outcome = simulate(tmp_path / "part", ROWS, model, cycle)
    assert outcome == chunk.ChunkOutcome(whole.fingerprints, {2: reason})
    paths = [point_path(tmp_path / "part", "identification", k) for k in (1, 2, 3)]
    assert [path.exists() for path in paths] == [True, False, True]
    # What broke off in the midst of a run leaves no trace in those after it.
    assert paths[2].read_bytes() == point_path(tmp_path / "whole", "identification", 3).read_bytes()


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), MemoryError(), TypeError("a defect")]
)
def test_what_is_none_of_the_point_s_doing_ends_the_job(tmp_path, model, cycle, monkeypatch, error):
    fail_at(monkeypatch, 2, error)
    with pytest.raises(type(error)):
        simulate(tmp_path, ROWS, model, cycle)
    assert [point_path(tmp_path, "identification", k).exists() for k in (1, 2, 3)] == [True, False, False]


def test_run_that_is_not_finite_or_loses_its_reference_fails(model, cycle, monkeypatch):
    rows = [study.Conditions(wear=(np.nan,)), study.Conditions(temperature=np.inf), study.Conditions()]
    reference = cycle.build(model, 0.05, 0.001)
    bad, hot, good = study.simulate_points(model, [(reference, one, 0) for one in rows])
    assert isinstance(bad, study.SimulationError) and isinstance(hot, study.SimulationError)
    assert np.isfinite(good.tau).all()
    genuine = study.record

    def lose(*arguments):
        recording = genuine(*arguments)
        recording.tau[100, 2] = np.nan
        return recording

    monkeypatch.setattr(study, "record", lose)
    (lost,) = study.simulate_points(model, [(reference, study.Conditions(), 0)])
    assert isinstance(lost, study.SimulationError)
    assert str(lost) == f"the recorded tau is not finite at t = {good.t[100]:.3f} s."
    # A motor that has no torque to speak of falls off its reference.
    monkeypatch.setattr(study, "record", genuine)
    monkeypatch.setattr(type(model), "torque_limit", property(lambda one: np.full(one.n, 1.0)))
    far = load_cycle("point_to_point").build(model, 0.05, 0.001)
    (fallen,) = study.simulate_points(model, [(far, study.Conditions(), 0)])
    assert "off its reference" in str(fallen)


def test_world_that_fails_its_self_test_ends_the_job(tmp_path, model, cycle, monkeypatch):
    monkeypatch.setattr("wearscope.simulation.world.SELF_TEST_TOLERANCE", 0.0)
    with pytest.raises(InputError, match=r"robot medium, cycle short_moves: self-test: .*correct the"):
        simulate(tmp_path, ROWS, model, cycle)
    assert not list(tmp_path.rglob("*.parquet"))


def test_full_disk_is_told_and_finished_points_stay(tmp_path, model, cycle, monkeypatch):
    genuine = pq.write_table

    def fill(table, name, **options):
        if "point=2" in str(name):
            raise OSError(errno.ENOSPC, "No space left on device")
        genuine(table, name, **options)

    monkeypatch.setattr(pq, "write_table", fill)
    with pytest.raises(InputError, match=r"point=2.*No space left on device.*free disk space"):
        simulate(tmp_path, ROWS, model, cycle)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["recording.parquet"]
    read_recording(point_path(tmp_path, "identification", 1))


@pytest.mark.parametrize(
    "ranges",
    [
        {"w3": ("temperature", 10.0, 70.0)},
        {"f": ("wear", -1.0, 50.0)},
        {"f": ("wear", -1e-9, 50.0)},
        {"w4": ("dwell", -5.0, 50.0)},
        {"w5": ("payload_mass_error", -100.0, 0.0)},
        {f"f{k}": ("wear", 0.0, 50.0) for k in range(4)},
    ],
)
def test_level_out_of_range_is_told(model, ranges, refuses):
    refuses(check_robot, model, ranges, 0.001)


def test_the_heaviest_payload_and_the_longest_dwell_are_those_of_the_ranges_ends(model, cycle, monkeypatch):
    """Of a declared mass 10 % below the true one, this is 1/0.9 of it; 10 % above, 1/1.1."""
    check_robot(model, {"f": ("wear", 0.0, 1.0), "w4": ("dwell", 0.0, 1.0)}, 0.001)
    check_robot(model, {"w5": ("payload_mass_error", -99.9, 0.0)}, 0.001)
    asked = []
    monkeypatch.setattr(feasibility, "check_reference", lambda *given: asked.append(given))
    for ranges, temperatures, wear, error in (
        ({"w5": ("payload_mass_error", -10.0, 10.0)}, (50.0,), 0.0, 1.0 / 9.0),
        ({"w5": ("payload_mass_error", 5.0, 25.0)}, (50.0,), 0.0, 0.2),
        ({"f": ("wear", 5.0, 40.0), "w3": ("temperature", 30.0, 70.0)}, (30.0, 70.0), 40.0, 0.0),
        ({"f": ("wear", 0.0, 50.0), "w1": ("wear", 0.0, 20.0)}, (50.0,), 50.0, 0.0),
    ):
        check_cycle(model, cycle, "c", ranges, 0.001)
        assert tuple(asked[-1][3]) == temperatures and asked[-1][4] == wear
        assert asked[-1][5] == pytest.approx(error)
    longest = check_cycle(model, cycle, "c", {"w4": ("dwell", 75.0, 25.0)}, 0.001)
    assert longest == pytest.approx(cycle.build(model, 0.075, 0.001).t[-1])
    assert asked[-1][0].t[-1] == longest and len(asked) == 6


def test_paper_ranges_are_feasible(model, cycle):
    check_robot(model, RANGES, 0.001)
    assert 1.0 < check_cycle(model, cycle, "short_moves", RANGES, 0.001) < 3.0


def test_step_that_does_not_fit_the_samples_is_told(model, refuses):
    refuses(check_robot, model, RANGES, 0.003)


def test_cycle_that_raises_or_goes_too_far_is_told(model, cycle, refuses):
    def explode(model, dwell, step):
        raise ZeroDivisionError("no moves")

    refuses(check_cycle, model, make_cycle(explode), "mine", RANGES, 0.001)
    refuses(check_cycle, model, go_too_far(cycle), "mine", RANGES, 0.001)


def test_simulation_that_does_not_start_is_told(model, cycle, monkeypatch):
    check_start(model, cycle, "mine", 0.001)
    with pytest.raises(InputError, match=r"'mine' on robot 'medium': the simulation fails at its start, j"):
        check_start(model, go_too_far(cycle), "mine", 0.001)
    monkeypatch.setattr("wearscope.simulation.world.SELF_TEST_TOLERANCE", 0.0)
    with pytest.raises(InputError, match=r"fails at its start, self-test: .*; correct the robot"):
        check_start(model, cycle, "mine", 0.001)


def test_point_that_hangs_or_crashes_has_failed_and_the_others_are_the_same(
    tmp_path, model, cycle, monkeypatch
):
    whole = simulate(tmp_path / "whole", ROWS, model, cycle)

    def stuck(model, dwell, step):
        while dwell > 0.06:
            pass
        return cycle.build(model, dwell, step)

    def crash(model, dwell, step):
        if dwell > 0.06:
            os.kill(os.getpid(), signal.SIGSEGV)
        return cycle.build(model, dwell, step)

    rows = [ROWS[0], ROWS[2], ROWS[1]]
    for build, reason in ((stuck, "took longer than 5 s"), (crash, "crashed its process (SIGSEGV)")):
        folder, done = tmp_path / build.__name__, []
        outcome = simulate(folder, rows, model, make_cycle(build), "code", PLAN, done.append, 5.0)
        assert outcome == chunk.ChunkOutcome(whole.fingerprints, {3: f"the simulation {reason}"})
        paths = {k: point_path(folder, "identification", k) for k in (1, 2, 3)}
        assert not paths[3].exists()
        for k in (1, 2):
            assert paths[k].read_bytes() == point_path(tmp_path / "whole", "identification", k).read_bytes()


@pytest.mark.parametrize("kills", [1, 2])
def test_a_kill_that_nobody_ordered_is_no_failed_point(tmp_path, model, cycle, kills, refuses):
    """As the kernel's where memory is short: tried once more, then the job fails, and leaves no result."""
    whole = simulate(tmp_path / "whole", ROWS, model, cycle)
    count = tmp_path / "kills"

    def killed(model, dwell, step):
        with count.open("a+") as file:
            if file.tell() < kills:
                file.write("x")
                file.flush()
                os.kill(os.getpid(), signal.SIGKILL)
        return cycle.build(model, dwell, step)

    folder, done = tmp_path / "killed", []

    def attempt():
        return simulate(folder, ROWS, model, make_cycle(killed), "code", PLAN, done.append, 60.0)

    if kills == 2:
        refuses(attempt)
    assert attempt() == whole
    assert done == [1, 2, 3]


def test_friction_law_without_its_speed_is_told(model, refuses):
    effects = model.to_mapping()["effects"]
    del effects[0]["parameters"]["eta3"]
    refuses(check_robot, model.replace(effects=effects), RANGES, 0.001)


def test_a_simulating_process_imports_nothing_that_it_does_not_need(tmp_path):
    """Imports are a fifth to a half of what a short job costs."""
    tables.write_table(tmp_path / "design.parquet", {"point": np.array([1]), "f_natural": np.zeros(1)})
    program = f"""
import sys
from pathlib import Path
from wearscope.storage import tables
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import Plan, simulate_chunk
rows = tables.read_arrow({str(tmp_path / "design.parquet")!r}).to_pylist()
model = load_model("medium", Path({str(ROOT / "config" / "robots")!r}))
cycle = load_cycle({str(ROOT / "tests" / "workflow" / "tiny" / "short_moves.py")!r})
plan = Plan("medium", "short", dict(f="wear"), 0, 0.004)
assert not simulate_chunk({str(tmp_path)!r}, "identification", rows, model, cycle, plan, "code").failed
heavy = ("pandas", "matplotlib", "statsmodels", "seaborn", "SALib", "snakemake", "scipy.optimize")
print([name for name in heavy if name in sys.modules])
"""
    assert call_python("-c", program).stdout == "[]\n"
