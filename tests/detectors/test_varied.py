"""Options of detectors as factors: each design point is asked of the detector as it is there."""

import numpy as np
import pandas as pd
import pytest

from wearscope.designs.factors import Factor
from wearscope.designs.kinds import make_design
from wearscope.detectors.base import Batch
from wearscope.detectors.questions import DetectorSpec
from wearscope.detectors.run import compute_test_quantities, set_option, vary_options
from wearscope.errors import InputError
from wearscope.robots.model import load_model

FACTORS = [
    Factor("f", "wear", "fault", "wear", 0, 50, "1", axis=5),
    Factor("q", "quantile", "nuisance", "detectors.P.quantile", 0.2, 0.8, "1"),
]
DETECTOR = """
import numpy as np


class Peak:
    fits = []

    def __init__(self, quantile=0.5, bins=10):
        assert isinstance(bins, int)
        self.quantile = quantile

    def fit(self, nominal, axis, model):
        self.fits.append(self.quantile)
        self.axis = axis

    def test_quantity(self, batch):
        return float(np.quantile(np.abs(batch.tau[:, self.axis]), self.quantile))


DETECTOR = Peak
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "peak.py"
    path.write_text(DETECTOR)
    return str(path)


def test_each_point_is_asked_with_its_own_option(file):
    model = load_model("medium")
    design = make_design("central_composite", FACTORS)
    t = np.arange(100) / 100.0
    batch = Batch(t, *(np.outer(t, np.ones(6)) for _ in range(3)))
    batches = [("identification", int(point), batch) for point in design["point"]]
    table = compute_test_quantities(
        batches, [DetectorSpec("P", file), DetectorSpec("Q", file)], [5], model, [batch], robot="medium",
        cycle="c", designs={"identification": design}, factors=FACTORS,
    )  # fmt: skip
    natural = FACTORS[1].to_natural(table["q"])
    varied, plain = table["fda"] == "P", table["fda"] == "Q"
    expected = [np.quantile(t, level) for level in natural[varied]]
    assert table.loc[varied, "y"].to_numpy() == pytest.approx(expected)
    assert set(table.loc[plain, "y"]) == {np.quantile(t, 0.5)}
    assert set(table["axis"]) == {5}


def test_levels_are_whole_where_the_option_is(file):
    bins = Factor("b", "bins", "nuisance", "detectors.P.bins", 4, 9, "1")
    assert set_option(file, {}, "bins", bins, 6.4) == 6
    percent = Factor("b", "bins", "nuisance", "detectors.P.bins %", -50, 50, "%")
    assert set_option(file, {"bins": 20}, "bins", percent, 50.0) == 30
    design = pd.DataFrame({"point": [1, 2], "b": [-2.0, 2.0]})
    found = vary_options([DetectorSpec("P", file)], {"filling": design}, [FACTORS[0], bins])
    assert found == {("P", ("filling", 1)): {"bins": 4}, ("P", ("filling", 2)): {"bins": 9}}


def test_an_option_that_is_not_there_is_refused(file):
    with pytest.raises(
        InputError, match=r"factors\.b: detector .*has no option 'colour'; it has quantile, bins"
    ):
        set_option(file, {}, "colour", Factor("b", "", "nuisance", "detectors.P.colour", 0, 1), 0.5)
