"""Detectors on recordings of a machine whose wear is planted, recorded without the simulator."""

from types import SimpleNamespace

import numpy as np
import pytest
from detection.worn_arm import make_duo, write_machine

from wearscope.detection.judgement import count_sessions, judge_recordings
from wearscope.detection.run import Setting, ask_recordings, check_recordings
from wearscope.detectors.questions import DetectorSpec
from wearscope.errors import InputError
from wearscope.home import example_dataset
from wearscope.reporting.detection_page import axis_tables, write_detection_page

C = DetectorSpec("C", "friction_fit")
D = DetectorSpec("D", "wear_temperature_fit")
B = DetectorSpec("B", "distribution_distance")
SAME = (1, 0.0, 8.0, 0.5)
#: As few simulated runs as a threshold takes.
FEW = {"p_f": 0.2, "runs": 4, "worn_runs": 3}


def detect(folder, model, detectors=(C, D), **setting):
    setting = Setting(**{"p_f": 0.05, "runs": 39, "worn_runs": 30} | setting)
    tested = ask_recordings(folder, model, detectors, setting=setting)
    return judge_recordings(tested, setting)


@pytest.fixture
def machine(tmp_path):
    """`write_machine` into a fresh folder."""
    return lambda judged, **options: write_machine(tmp_path / "duo", judged, **options)


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """A machine with wear 0, 20 and 40 in three judged recordings, and two of other motions."""
    folder = write_machine(
        tmp_path_factory.mktemp("worn") / "duo",
        [SAME, (1, 20.0, 8.0, 0.0), (1, 40.0, 8.0, 0.0), (2, 0.0, 8.0, 0.0), (1, 0.0, 6.0, 0.0)],
    )
    return detect(folder, make_duo(), p_f=0.1, runs=19, worn_runs=15)


def test_planted_wear_raises_an_alarm_with_its_size_and_none_does_not(worn):
    judged = worn.detection[worn.detection["kind"] == "judged"]
    for run, wear in (("runs/r6.parquet", 20.0), ("runs/r7.parquet", 40.0)):
        rows = judged[judged["run"] == run]
        assert (rows["verdict"] == "alarm").all()
        assert (rows["y"] > rows["threshold"]).all()
        # Four readings of each: one may miss its 95 % interval.
        assert ((rows["wear_low"] - 1 <= wear) & (wear <= rows["wear_high"] + 1)).all()
    healthy = judged[judged["run"] == "runs/r5.parquet"]
    assert set(healthy["verdict"]) == {"no alarm"}
    assert (healthy["p_value"] > 0.1).all()


def test_temperatures_are_told_from_those_of_the_nominal_recordings(worn):
    nominal = worn.detection[worn.detection["kind"] == "nominal"]
    assert nominal.drop_duplicates(["run", "joint"])["warmer"].mean() == pytest.approx(0.0, abs=1e-6)
    assert worn.detection["warmer"].abs().max() < 10.0 and worn.detection["warmer"].std() > 0.5


def test_other_motions_are_refused_in_one_sentence_each(worn):
    told = {one["run"]: one["reason"] for one in worn.summary["refused"]}
    assert set(told) == {"runs/r8.parquet", "runs/r9.parquet"}
    assert "of its range away" in told["runs/r8.parquet"] and "faster" in told["runs/r9.parquet"]
    assert not set(worn.detection["run"]) & set(told)


def test_threshold_has_its_unit_its_rate_and_what_it_detects(worn):
    cells = worn.thresholds.set_index(["joint", "fda"])
    assert cells.loc[("a", "C"), "unit"] == "N m" and cells.loc[("a", "D"), "unit"] == "1"
    assert (cells["p_f_low"] < 0.1).all() and (cells["p_f_high"] > 0.1).all()
    assert (cells["wear_detected"].between(0.0, 30.0)).all()
    assert (cells["nominal_runs"] == 5).all()
    assert worn.summary["motions"]["motion 1"]["factors_that_move_nothing"] == ["payload_mass_error"]


def test_written_and_shown(worn, tmp_path):
    worn.write(tmp_path)
    write_detection_page(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "runs/r6.parquet (day 6): alarm." in page
    assert "is of another motion" in page and 'id="axis-chart"' in page
    assert "The reason may be a temperature other than in the nominal recordings: a (" in page
    # Each row of the tables follows the page's filters.
    rows = page.count("<tr data-cell=")
    assert rows == page.count("<tr ") and rows >= (worn.detection["kind"] == "judged").sum()


def test_on_the_common_axis_the_threshold_is_one_and_the_simulated_median_zero(worn):
    drawn = axis_tables(worn)
    points = drawn["points"].merge(worn.thresholds[["joint", "fda", "threshold"]], on=["joint", "fda"])
    assert len(points) == len(worn.detection)
    assert ((points["place"] > 1) == (points["y"] > points["threshold"])).all()
    healthy = drawn["spans"][drawn["spans"]["kind"] == "simulated, no wear"]
    assert len(healthy) == 4 and ((healthy["first"] < 0) & (healthy["third"] > 0)).all()
    worn_out = drawn["spans"][drawn["spans"]["kind"] == "simulated, worn"]
    assert (worn_out["high"] > healthy["high"].max()).all()


def test_a_machine_that_scatters_more_than_the_model_gets_wider_thresholds(machine):
    """Sessions without wear give no alarm, and large wear still does."""
    folder = machine([SAME, SAME, (1, 40.0, 8.0, 0.0)], nominal=6, disturbance=0.1)
    found = detect(folder, make_duo(), [C], runs=19, worn_runs=3)
    cells = found.thresholds
    assert (cells["scatter_ratio"] > 1.2).all() and (cells["widening"] > cells["scatter_ratio"]).all()
    judged = found.detection[found.detection["kind"] == "judged"].groupby("run")["verdict"].agg(set)
    assert judged.tolist() == [{"no alarm"}, {"no alarm"}, {"alarm"}]


def test_too_few_nominal_sessions_do_not_tell_how_the_machine_scatters(machine):
    found = detect(machine([(1, 40.0, 8.0, 0.0)], nominal=1), make_duo(), [C], **FEW)
    assert found.thresholds["widening"].isna().all()
    assert set(found.detection["verdict"]) == {"unchecked"}


def test_recordings_of_one_session_scatter_together():
    def count(*sessions):
        return count_sessions([(0.0, SimpleNamespace(session=one)) for one in sessions])

    assert count("one", "one", "other", "other") == 2
    # Where sessions are not told apart, each recording is taken for one.
    assert count("one", "one", "one") == 3 and count(None, None) == 2 and count() == 0


def test_a_model_without_wear_says_so_and_reads_none(machine):
    found = detect(machine([(1, 40.0, 8.0, 0.0)], nominal=3), make_duo(worn=False), [B])
    idle = found.summary["motions"]["motion 1"]["factors_that_move_nothing"]
    assert idle == ["wear", "temperature", "payload_mass_error"]
    assert found.detection["wear"].isna().all() and found.thresholds["wear_detected"].isna().all()
    assert "simulated_worn" not in set(found.simulated["kind"])


def test_detectors_may_be_fitted_to_simulated_runs(machine):
    found = detect(machine([(1, 30.0, 8.0, 0.0)], nominal=3), make_duo(), [D], nominal="simulated", **FEW)
    nominal = found.detection[found.detection["kind"] == "nominal"]
    assert np.abs(nominal["y"]).max() < 6.0
    judged = found.detection[found.detection["kind"] == "judged"]
    np.testing.assert_allclose(judged["y"], 30.0, atol=4.0)


def test_reference_sessions_are_nominal_rather_than_training_runs(machine):
    folder = machine([(1, 0.0, 8.0, 0.0)], nominal=3, fields={"reference": ["day 3"]})
    found = detect(folder, make_duo(), [C], **FEW)
    assert found.summary["motions"]["motion 1"]["nominal"] == ["runs/r3.parquet"]
    assert len(found.summary["motions"]["motion 1"]["judged"]) == 3


@pytest.mark.parametrize(
    ("judged", "fields", "told"),
    [
        ([(2, 0.0, 8.0, 0.0)], {}, "nothing can be judged: runs/r3.parquet is of another motion"),
        ([SAME], {"reference": ["never"]}, "no run has 'session: never'"),
        ([SAME], {"reference": ["new", "day 3"]}, "every run is nominal"),
    ],
)
def test_what_cannot_be_judged_is_refused_in_one_sentence(machine, judged, fields, told):
    with pytest.raises(InputError, match=told):
        detect(machine(judged, nominal=3, fields=fields), make_duo())


def test_a_rate_that_the_runs_cannot_give_is_refused_before_anything_is_read(refuses):
    refuses(detect, "nowhere", make_duo(), p_f=0.001)


def test_a_detector_that_hangs_or_cannot_be_fitted_is_named(machine, tmp_path):
    folder = machine([SAME], nominal=2)
    slow = tmp_path / "slow.py"
    slow.write_text(
        "import time\nclass S:\n    def fit(self, nominal, axis, model):\n        time.sleep(60)\n"
        "    def test_quantity(self, batch):\n        return 0.0\nDETECTOR = S\n"
    )
    with pytest.raises(InputError, match="the fit of the detectors took longer than 5 s"):
        detect(folder, make_duo(), [DetectorSpec("S", str(slow))], time_limit=5.0)
    broken = tmp_path / "broken.py"
    broken.write_text(
        "class S:\n    def fit(self, nominal, axis, model):\n        raise ValueError('no')\n"
        "    def test_quantity(self, batch):\n        return 0.0\nDETECTOR = S\n"
    )
    found = detect(folder, make_duo(), [C, DetectorSpec("S", str(broken))], **FEW)
    rows = found.detection[found.detection["fda"] == "S"]
    assert set(rows["verdict"]) == {"failed"} and rows["status"].str.contains("ValueError: no").all()
    assert set(found.detection.loc[found.detection["fda"] == "C", "verdict"]) <= {"no alarm", "unchecked"}


def test_what_cannot_be_judged_is_told_before_the_loop_is_closed(refuses):
    refuses(check_recordings, example_dataset())
