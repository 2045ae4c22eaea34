"""A whole study of a wrist axis with factors by path: noise, a soft gear, a gain, a detector's option."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from calls import call_python

import wearscope
from wearscope.simulation.recording import point_path, read_recording
from wearscope.storage import tables

ROOT = Path(__file__).parents[2]
TINY = ROOT / "tests" / "workflow" / "tiny"
STUDY = {
    "study": "wrist",
    "robots": ["medium"],
    "cycles": [str(TINY / "short_moves.py")],
    "axes": [5],
    "detectors": {"C": "friction_fit", "own": str(TINY / "torque_change.py")},
    "factors": {
        "f": {"description": "wear of the wrist", "kind": "wear", "range": [0, 50], "unit": "1"},
        "noise": {
            "description": "torque noise", "kind": "sensors.torque_noise", "range": [-80, 80], "unit": "%",
        },
        "soft": {
            "description": "compliance of the wrist's gear", "unit": "rad/(N m)",
            "kind": "effects.joint_elasticity.5.compliance", "range": [0, 4e-5],
        },
        "gain": {
            "description": "bandwidth", "kind": "controller.bandwidth_hz", "range": [-20, 20], "unit": "%",
        },
    },
    "design": {"kind": "central_composite"},
    "simulation": {"chunk": 100},
    "snr": {"runs": 1000},
    "scope": {"factors": ["noise", "soft"], "grid": [4, 3], "runs": 1000},
    "audit": {"points": 3, "cycles": 1},
    "direct": {"runs": 10},
    "closed_loop": {"demonstration": False},
    "surrogates": {
        "filling": {
            "points": 14, "question_points": 2, "replicates": 2, "checking_points": 6,
            "checking_question_points": 1,
        }
    },
}  # fmt: skip


def run(folder, study, *options):
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    words = ("-m", "wearscope", "run", "study.yaml", "--cores", "2", *options)
    return call_python(*words, folder=folder, timeout=1800)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wrist")
    done = run(folder, STUDY)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder / "results" / "wrist"


@pytest.mark.slow
def test_every_stage_knows_the_factors_and_the_axis(finished):
    study = wearscope.Study(finished)
    found = {one.name: (one.low, one.high, one.unit) for one in study.factors()}
    assert found["noise"] == (-80.0, 80.0, "%") and found["gain"] == (-20.0, 20.0, "%")
    assert found["soft"][:2] == pytest.approx((0.0, 4e-5), abs=1e-11)
    assert found["soft"][2] == "rad/(N m)"
    for name in ("test_quantities", "surrogates", "chosen_surrogates", "snr", "scope"):
        assert set(study.table(name)["axis"]) == {5}, name
    assert set(study.scope()["factor"]) == {"noise", "soft"}
    screening = tables.read_table(finished / "screening" / "medium.parquet").set_index("factor")
    assert screening["moves"].all() and screening.loc["f", "joint"] == "axis_5"
    assert screening.loc["soft", "kind"] == "effects.joint_elasticity.5.compliance"


@pytest.mark.slow
def test_noise_raises_what_a_plain_difference_sees(finished):
    """RMS of the torque's change: noise of both recordings adds to it, whatever else varies."""
    rows = wearscope.Study(finished).test_quantities(fda="own", robot="medium")
    rows = rows[(rows["status"] == "ok") & (rows["f"] < -1)]
    quiet, loud = (rows.loc[keep, "y"].min() for keep in (rows["noise"] < 0, rows["noise"] > 0.9))
    assert loud > quiet > 0
    assert np.isfinite(wearscope.Study(finished).snr()["snr"]).all()


@pytest.mark.slow
def test_the_report_names_factors_in_their_units(finished):
    text = (finished / "report.html").read_text()
    for words in ("torque noise", "compliance of the wrist", "rad/(N m)", "bandwidth"):
        assert words in text, words


@pytest.mark.slow
def test_detectors_judge_recordings_of_a_heavier_link_at_any_rate(tmp_path):
    factors = {
        "f": STUDY["factors"]["f"],
        "load": {"description": "mass of link 3", "kind": "links.3.mass", "range": [-20, 20], "unit": "%"},
        "rate": {
            "description": "sample rate", "kind": "sensors.sample_rate", "range": [80, 250], "unit": "Hz",
        },
    }  # fmt: skip
    detectors = {
        "A": "residual_energy", "B": "distribution_distance", "C": "friction_fit",
        "D": "wear_temperature_fit", "E": "friction_change",
    }  # fmt: skip
    study = {**STUDY, "factors": factors, "detectors": detectors, "scope": {"factors": ["rate"]}}
    done = run(tmp_path, study, "--stage", "test_quantities")
    assert done.returncode == 0, done.stderr[-3000:]
    results = tmp_path / "results" / "wrist"
    found = wearscope.Study(results).table("test_quantities")
    assert set(found["status"]) == {"ok"} and set(found["fda"]) == set(detectors)
    design = tables.read_table(results / "design" / "identification.parquet")
    assert design["rate_natural"].nunique() > 2
    lengths = set()
    for row in design.itertuples():
        path = point_path(results / "traces" / "medium" / "short_moves", "identification", row.point)
        t = read_recording(path).t
        assert np.diff(t) == pytest.approx(1.0 / row.rate_natural)
        lengths.add(round(t[-1], 1))
    assert len(lengths) == 1, "the motion is the same"
    # The signature's energy follows the weight that nobody declared.
    energy = found[(found["fda"] == "A") & (found["set"] == "identification")]
    off, right = (energy.loc[keep, "y"].min() for keep in (energy["load"].abs() > 1.9, energy["load"] == 0))
    assert off > 3.0 * right


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("drive.gear_ratio", "drive.gear_ratio moves no recorded torque of robot 'medium'"),
        ("links.9.mass", "its joints are axis_1"),
        ("sensors.torque_nose", "sensors has encoder_resolution, torque_noise, sample_rate"),
        ("detectors.own.colour", "has no option 'colour'; it has fail_above"),
    ],
)
def test_a_factor_that_cannot_be_is_refused_before_anything_is_simulated(tmp_path, kind, told):
    factors = {**STUDY["factors"], "gain": {**STUDY["factors"]["gain"], "kind": kind}}
    done = run(tmp_path, {**STUDY, "factors": factors})
    assert done.returncode != 0 and told in done.stderr.splitlines()[-1]
    assert not list(tmp_path.glob("results/*/traces/*/*/*/*.parquet"))
