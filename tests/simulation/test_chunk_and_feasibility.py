import errno
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from wearscope.cycles.base import Cycle, Reference, load_cycle
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.simulation import chunk, recording
from wearscope.simulation.feasibility import check_cycle, check_robot
from wearscope.simulation.recording import read_fingerprint, read_recording
from wearscope.simulation.traces import point_path, read_points

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


def simulate(folder, rows, model, cycle, common="code", plan=PLAN):
    return chunk.simulate_chunk(folder, "identification", rows, model, cycle, plan, common)


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
    prints = simulate(tmp_path, ROWS, model, cycle)
    paths = {point: point_path(tmp_path, "identification", point) for point in prints}
    assert {point: read_fingerprint(path) for point, path in paths.items()} == prints
    paths[2].write_bytes(paths[2].read_bytes()[:100])
    moments = {point: path.stat().st_mtime_ns for point, path in paths.items()}
    assert simulate(tmp_path, ROWS, model, cycle) == prints
    assert [point for point, path in paths.items() if path.stat().st_mtime_ns != moments[point]] == [2]
    read_recording(paths[2])
    moments = {point: path.stat().st_mtime_ns for point, path in paths.items()}
    changed = simulate(tmp_path, [ROWS[0], make_row(2, f=25.0), ROWS[2]], model, cycle)
    assert [point for point in prints if changed[point] != prints[point]] == [2]
    assert [point for point, path in paths.items() if path.stat().st_mtime_ns != moments[point]] == [2]
    assert simulate(tmp_path, ROWS[:1], model, cycle, common="other code")[1] != prints[1]


def test_seed_and_identity_change_the_noise(tmp_path, model, cycle):
    other = chunk.Plan("medium", "short_moves", KINDS, 1, 0.001)
    simulate(tmp_path / "a", [make_row(1), make_row(2)], model, cycle)
    simulate(tmp_path / "b", [make_row(1)], model, cycle, plan=other)
    one, two, three = (
        read_recording(point_path(tmp_path / name, "identification", point)).tau
        for name, point in (("a", 1), ("a", 2), ("b", 1))
    )
    assert not (one == two).all() and not (one == three).all()


def test_failed_run_is_told_after_the_others_are_written(tmp_path, model, cycle, monkeypatch):
    genuine = chunk.simulate_points

    def fail_second(*arguments):
        for number, result in enumerate(genuine(*arguments)):
            yield chunk.SimulationError("the motor is lost.") if number == 1 else result

    monkeypatch.setattr(chunk, "simulate_points", fail_second)
    with pytest.raises(InputError, match=r"identification point 2: the motor is lost; correct the robot"):
        simulate(tmp_path, ROWS, model, cycle)
    assert [point_path(tmp_path, "identification", k).exists() for k in (1, 2, 3)] == [True, False, True]


def test_full_disk_is_told_and_finished_points_stay(tmp_path, model, cycle, monkeypatch):
    genuine = pq.write_table

    def fill(table, name, **options):
        if "point=2" in str(name):
            raise OSError(errno.ENOSPC, "No space left on device")
        genuine(table, name, **options)

    monkeypatch.setattr(recording.pq, "write_table", fill)
    with pytest.raises(InputError, match=r"point=2.*No space left on device.*free disk space"):
        simulate(tmp_path, ROWS, model, cycle)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["recording.parquet"]
    read_recording(point_path(tmp_path, "identification", 1))


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        (
            {"w3": ("temperature", 10.0, 70.0)},
            r"factors.w3: 10 degC is below the validity of the friction law",
        ),
        ({"f": ("wear", -1.0, 50.0)}, r"factors.f: a wear of -1"),
        ({"w4": ("dwell", -5.0, 50.0)}, r"factors.w4: a delay of -5 ms"),
        ({"w5": ("payload_mass_error", -100.0, 0.0)}, r"factors.w5: -100 % leaves no mass"),
        (
            {f"f{k}": ("wear", 0.0, 50.0) for k in range(4)},
            r"factors.f3: robot 'medium' has 3 joints that wear",
        ),
    ],
)
def test_level_out_of_range_is_told(model, ranges, words):
    with pytest.raises(InputError, match=words):
        check_robot(model, ranges, 0.001)


def test_paper_ranges_are_feasible(model, cycle):
    check_robot(model, RANGES, 0.001)
    assert 1.0 < check_cycle(model, cycle, "short_moves", RANGES, 0.001) < 3.0


def test_step_that_does_not_fit_the_samples_is_told(model):
    with pytest.raises(InputError, match="no whole number of steps"):
        check_robot(model, RANGES, 0.003)


def test_cycle_that_raises_or_goes_too_far_is_told(model, cycle):
    def explode(model, dwell, step):
        raise ZeroDivisionError("no moves")

    with pytest.raises(InputError, match=r"build raised ZeroDivisionError: no moves; mend the test-cycle"):
        check_cycle(model, Cycle("mine", "Mine.", explode), "mine", RANGES, 0.001)

    def far(model, dwell, step):
        good = cycle.build(model, dwell, step)
        return Reference(good.t, good.q + 5.0, good.v, good.a)

    with pytest.raises(InputError, match=r"test-cycle 'mine' on robot 'medium'.* beyond its limit"):
        check_cycle(model, Cycle("mine", "Mine.", far), "mine", RANGES, 0.001)
