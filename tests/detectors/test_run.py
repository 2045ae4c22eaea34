"""Test quantities of a robot and cycle: rows, joins, failures, user's detectors."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from wearscope import plugins
from wearscope.detectors.base import Batch, load_detector
from wearscope.detectors.questions import DetectorSpec
from wearscope.detectors.run import compute_test_quantities, count_failures, join_test_quantities
from wearscope.errors import InputError
from wearscope.storage import tables

DOCS = Path(__file__).parents[2] / "docs" / "detectors.md"
# Detectors that look at the torque alone need no more of a model than its joints.
MODEL = SimpleNamespace(joints=["j1", "j2", "j3", "j4"], axes=["j1", "j3", "j4", "j2"])
NAMES = ["f", "w1", "w2", "w3", "w4", "w5"]

MEAN_TORQUE = """
class MeanTorque:
    def __init__(self, gain=1.0, fail_at=()):
        self.gain, self.fail_at = gain, set(fail_at)

    def fit(self, nominal, axis, model):
        self.axis = axis
        self.nominal = nominal[0].tau[:, axis].mean()

    def test_quantity(self, batch):
        point = batch.tau[0, 1]  # planted by the test
        if point in self.fail_at:
            BREAK
        return self.gain * (batch.tau[:, self.axis].mean() - self.nominal)

DETECTOR = MeanTorque
"""


def make_design(rows, seed=0):
    z = np.random.default_rng(seed).normal(size=(rows, 6)).round(3)
    return pd.DataFrame(z, columns=NAMES).assign(point=np.arange(rows), f_natural=1.0)


def make_batch(wear, point):
    t = np.arange(50) / 100
    tau = np.zeros((50, 4))
    tau[:, [0, 2, 3]] = wear
    tau[:, 1] = point
    return Batch(t, np.zeros((50, 4)), np.zeros((50, 4)), tau)


def make_batches(designs):
    for set_name, design in designs.items():
        for row in design.itertuples():
            yield set_name, row.point, make_batch([row.f, row.w1, row.w2], row.point)


@pytest.fixture
def user_file(tmp_path):
    def write(breaks="raise RuntimeError('no\\nluck')"):
        path = tmp_path / "mean_torque.py"
        path.write_text(MEAN_TORQUE.replace("BREAK", breaks), encoding="utf-8")
        return str(path)

    return write


DESIGNS = {"identification": make_design(20), "validation": make_design(10, 1)}


def run(reference, options=None, designs=DESIGNS, batches=None, axes=(1, 2, 3), **more):
    return compute_test_quantities(
        make_batches(designs) if batches is None else batches,
        [DetectorSpec("mine", reference, options or {})],
        axes,
        MODEL,
        [make_batch([0, 0, 0], -1)],
        robot="medium",
        cycle="sweep",
        designs=designs,
        **more,
    )


def test_each_axis_gets_its_own_view_and_joint(user_file):
    table = run(user_file(), {"gain": 2.0})
    assert list(table.columns) == ["robot", "cycle", "axis", "fda", "set", "point", *NAMES, "y", "status"]
    assert len(table) == 3 * 30
    assert (table["status"] == "ok").all()
    assert set(table["robot"]) == {"medium"} and set(table["fda"]) == {"mine"}
    # The torque of the k-th wearing joint is its planted wear, which its own axis sees as f.
    assert table["y"].to_numpy() == pytest.approx(2 * table["f"].to_numpy())
    second = table[(table["axis"] == 2) & (table["set"] == "identification")]
    assert np.array_equal(second["w1"], DESIGNS["identification"]["f"])


def test_the_order_of_the_batches_does_not_matter(user_file):
    straight = run(user_file())
    turned = run(user_file(), batches=reversed(list(make_batches(DESIGNS))))
    pd.testing.assert_frame_equal(straight, turned)


def test_batches_are_read_as_a_stream_and_reported(user_file):
    seen, live = [], []

    def stream():
        for item in make_batches(DESIGNS):
            live.append(len(seen))
            yield item

    run(user_file(), batches=stream(), report=seen.append)
    assert seen == list(range(1, 31))
    assert live == list(range(30))


@pytest.mark.parametrize(
    ("breaks", "status"),
    [
        ("raise RuntimeError('no\\nluck')", "RuntimeError: no luck"),
        ("return float('nan')", "returned nan"),
        ("return -np.inf", "returned -inf"),
    ],
)
def test_failed_points_are_counted_and_never_zero(user_file, breaks, status):
    path = user_file(breaks)
    Path(path).write_text("import numpy as np\n" + Path(path).read_text(), encoding="utf-8")
    table = run(path, {"fail_at": [3]}, max_failed_share=0.1)
    failed = table[table["point"] == 3]
    assert len(failed) == 6
    assert failed["y"].isna().all()
    assert (failed["status"] == status).all()
    assert table[table["point"] != 3]["y"].notna().all()
    counts = count_failures(table)
    assert list(counts["failed"]) == [1] * 6
    assert list(counts["points"]) == [20, 10] * 3
    assert set(counts["first_reason"]) == {f"point 3: {status}"}


def test_points_simulated_in_vain_have_no_value_and_are_none_of_the_detector_s(user_file, refuses):
    vain = {("identification", 4): "the motor is lost", ("audit", 1): "not in this design"}
    batches = [item for item in make_batches(DESIGNS) if item[:2] != ("identification", 4)]
    path = user_file()
    table = run(path, {"fail_at": [3]}, batches=batches, max_failed_share=0.1, failed_simulations=vain)
    lost = table[(table["set"] == "identification") & (table["point"] == 4)]
    assert len(lost) == 3 and lost["y"].isna().all()
    assert set(lost["status"]) == {"simulation failed: the motor is lost"}
    assert len(table) == 3 * 30 and table["y"].isna().sum() == 3 * 3
    counts = count_failures(table)
    assert list(counts["failed"]) == [1] * 6 and set(counts["first_reason"]) == {
        "point 3: RuntimeError: no luck"
    }
    refuses(run, path, {"fail_at": [3]}, batches=batches, max_failed_share=0.09, failed_simulations=vain)
    refuses(run, path, failed_simulations=vain)


def test_too_many_failed_points_are_refused(user_file, refuses):
    path = user_file("raise RuntimeError('no luck')")
    refuses(run, path, {"fail_at": [11, 12, 13]})
    assert run(path, {"fail_at": [11, 12, 13]}, max_failed_share=0.15)["y"].isna().sum() == 9


@pytest.mark.parametrize(
    ("value", "kind"),
    [("batch.tau[0]", r"an array of shape \(4,\)"), ("None", "NoneType"), ("'1.0'", "str"), ("True", "bool")],
)
def test_what_is_no_number_is_refused(user_file, value, kind):
    with pytest.raises(
        InputError, match=rf"identification point 2: test_quantity returned {kind}, not a number"
    ):
        run(user_file(f"return {value}"), {"fail_at": [2]})


def test_whole_numbers_and_zero_dimensional_arrays_are_numbers(user_file):
    assert (run(user_file("return 3"), {"fail_at": [2]}).query("point == 2")["y"] == 3).all()
    path = user_file("return batch.tau[:, 1].mean(keepdims=True)[0]")
    assert (run(path, {"fail_at": [2]}).query("point == 2")["y"] == 2).all()


def test_a_detector_that_cannot_be_fitted_is_refused_before_any_batch_is_read(tmp_path, refuses):
    path = tmp_path / "bad.py"
    path.write_text("class DETECTOR:\n def fit(self, *_): 1 / 0\n def test_quantity(self, b): return 1.0\n")

    def unread():
        raise AssertionError("read")
        yield

    refuses(run, str(path), batches=unread())


def test_batches_and_designs_must_match(user_file, refuses):
    items = list(make_batches(DESIGNS))
    refuses(run, user_file(), batches=items[:-1])
    refuses(run, user_file(), batches=[items[0], items[0]])
    refuses(run, user_file(), batches=[("validation", 99, items[0][2])])


def test_axes_and_names_are_checked(user_file, refuses):
    refuses(run, user_file(), axes=(1, 5))
    refuses(run, user_file(), axes=(1, 1))


def test_load_detector_explains_what_is_wrong(tmp_path, user_file, refuses):
    with pytest.raises(InputError, match=r"there is no 'nonsense'; choose one of .*friction_fit"):
        load_detector("nonsense")
    refuses(load_detector, str(tmp_path / "gone.py"))
    refuses(load_detector, user_file(), {"volume": 11})
    refuses(load_detector, "distribution_distance", {"floor": 2})
    for name in plugins.list_names("detectors", "DETECTOR"):
        with pytest.raises(InputError, match=rf"{name}: the detector refuses its options .*volume"):
            load_detector(name, {"volume": 11})
    half = tmp_path / "half.py"
    half.write_text("class DETECTOR:\n def fit(self, nominal, axis, model): ...\n", encoding="utf-8")
    refuses(load_detector, str(half))


def test_the_example_of_the_documentation_works(tmp_path):
    block = re.search(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    path = tmp_path / "peak_torque.py"
    path.write_text(block.group(1), encoding="utf-8")
    table = run(str(path), {"quantile": 0.9})
    expected = np.abs(table["f"].to_numpy())
    assert table["y"].to_numpy() == pytest.approx(expected)


@pytest.mark.parametrize(
    ("breaks", "status"),
    [
        ("while True: pass", "took longer than 0.5 s"),
        (
            "while True:\n                try: time.sleep(9)\n                except: pass",
            "took longer than 0.5 s",
        ),
        ("sys.exit(3)", "SystemExit: 3"),
        ("os._exit(3)", "ended its process (exit code 3)"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed its process (SIGSEGV)"),
    ],
)
def test_detector_that_hangs_ends_or_crashes_its_process_is_a_failed_point(user_file, breaks, status):
    path = user_file(breaks)
    Path(path).write_text("import os, signal, sys, time\n" + Path(path).read_text(), encoding="utf-8")
    seen = []
    table = run(path, {"fail_at": [3]}, axes=(1,), max_failed_share=0.1, time_limit=0.5, report=seen.append)
    healthy = run(path, axes=(1,))
    failed = table["point"] == 3
    assert failed.sum() == 2 and (table[failed]["status"] == status).all() and table[failed]["y"].isna().all()
    pd.testing.assert_frame_equal(table[~failed], healthy[~failed])
    assert seen[-1] == 30


def test_detector_that_is_lost_too_often_is_refused_without_asking_on(user_file, refuses):
    path = user_file("while True: pass")
    refuses(run, path, {"fail_at": range(20)}, axes=(1,), max_failed_share=0.05, time_limit=0.2)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("while True: pass", "axis 1: fit took longer than 0.3 s"),
        ("sys.exit(0)", "cannot be fitted.*SystemExit: 0"),
    ],
)
def test_fit_that_hangs_or_exits_is_refused(user_file, body, words):
    path = user_file()
    text = Path(path).read_text().replace("        self.axis = axis\n", f"        {body}\n")
    Path(path).write_text("import sys\n" + text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        run(path, time_limit=0.3)


def test_module_that_exits_is_refused(tmp_path, refuses):
    (tmp_path / "gone.py").write_text("import sys; sys.exit(0)")
    refuses(load_detector, str(tmp_path / "gone.py"))


def test_answers_in_a_process_of_their_own_are_the_same(user_file, refuses):
    pd.testing.assert_frame_equal(run(user_file(), time_limit=60), run(user_file()))
    refuses(run, user_file(), batches=[*make_batches(DESIGNS), *make_batches(DESIGNS)], time_limit=60)


# Chunks of a robot and test-cycle's points, computed one by one.
FAILING = {"fail_at": [3, 17]}
VAIN = {("identification", 4): "the motor is lost"}


def run_chunks(path, size, share):
    """What each chunk's job gives, as it is read back."""
    found = []
    for name in sorted(DESIGNS):
        design = DESIGNS[name]
        for first in range(0, len(design), size):
            part = {name: design[first : first + size]}
            batches = (item for item in make_batches(part) if item[:2] not in VAIN)
            found.append(
                tables.to_arrow(
                    run(
                        path, FAILING, designs=part, batches=batches, max_failed_share=share,
                        failed_simulations=VAIN, sizes={name: len(design)},
                    )
                )
            )  # fmt: skip
    return found


@pytest.mark.parametrize("size", [1, 7, 20, 40])
def test_the_table_of_chunks_is_that_of_one_go_to_the_byte(user_file, tmp_path, size):
    path = user_file()
    batches = [item for item in make_batches(DESIGNS) if item[:2] not in VAIN]
    whole = run(path, FAILING, batches=batches, max_failed_share=0.15, failed_simulations=VAIN)
    tables.write_table(tmp_path / "whole", whole)
    for number, part in enumerate(run_chunks(path, size, 0.15)):
        tables.write_arrow(tmp_path / f"{number:03d}.part", part)
    parts = [tables.read_arrow(file) for file in sorted(tmp_path.glob("*.part"))]
    tables.write_arrow(tmp_path / "joined", join_test_quantities(parts, ["mine"], (1, 2, 3), 0.15))
    assert (tmp_path / "joined").read_bytes() == (tmp_path / "whole").read_bytes()
    assert whole["y"].isna().sum() == 3 * 4


def test_the_share_that_may_fail_is_of_the_whole_set(user_file, refuses):
    """A chunk of one point that fails is no failure of all; too many in all chunks are."""
    path = user_file()
    parts = run_chunks(path, 1, 0.15)
    assert join_test_quantities(parts, ["mine"], (1, 2, 3), 0.15).num_rows == 90
    refuses(join_test_quantities, parts, ["mine"], (1, 2, 3), 0.1)
    refuses(run_chunks, path, 1, 0.04)


def test_a_chunk_of_other_cells_is_refused(user_file, refuses):
    parts = run_chunks(user_file(), 10, 1.0)
    refuses(join_test_quantities, parts, ["other"], (1, 2, 3), 1.0)
    refuses(join_test_quantities, parts, ["mine"], (2, 1, 3), 1.0)


def test_long_columns_are_paged_as_in_one_go(tmp_path):
    """A page of a Parquet file holds some 20,000 values: chunks must not end pages."""
    design = np.arange(30_000)
    whole = tables.to_arrow(
        {
            "robot": ["r"] * 60_000, "cycle": ["c"] * 60_000, "axis": np.repeat([1, 2], 30_000),
            "fda": ["A"] * 60_000, "set": ["direct"] * 60_000, "point": np.tile(design, 2),
            "y": np.random.default_rng(0).normal(size=60_000), "status": ["ok"] * 60_000,
        }
    )  # fmt: skip
    parts = []
    for first in range(0, 30_000, 7_000):
        rows = np.flatnonzero((np.tile(design, 2) >= first) & (np.tile(design, 2) < first + 7_000))
        parts.append(whole.take(rows))
    tables.write_arrow(tmp_path / "whole", whole)
    tables.write_arrow(tmp_path / "joined", join_test_quantities(parts, ["A"], [1, 2], 0.0))
    assert (tmp_path / "joined").read_bytes() == (tmp_path / "whole").read_bytes()
