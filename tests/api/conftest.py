"""A small finished study on disk: planted test quantities, everything after them by the real evaluation."""

import numpy as np
import pytest

from benchmarks.planted import PAPER_OPTIONS, planted_test_quantities
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import make_design
from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.scope import scope_table
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.evaluation.snr import snr_table
from wearscope.storage import tables
from wearscope.surrogates.fitting import fit_surrogates
from wearscope.surrogates.validation import validate_surrogates


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    """A folder with ``results/paper`` in it."""
    points = planted_test_quantities(cycles=("a",), axes=(1, 2), fdas=("A", "C"), seed=3)[0]
    points["status"] = "ok"
    surrogates = fit_surrogates(points, ["full", "simplified"])
    validation = validate_surrogates(points, surrogates)
    snr = snr_table(surrogates, runs=500, draws=50)
    deltas, sigmas = np.linspace(0, 4, 5), np.linspace(0.1, 1, 4)
    folder = tmp_path_factory.mktemp("study")
    design = make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)
    units = {f"{one.name}_natural": one.unit for one in PAPER_FACTORS}
    found = {
        "test_quantities": points,
        "surrogates": surrogates,
        "validation": validation,
        "sensitivity": sensitivity_of([surrogates]),
        "snr": snr,
        "ranking": rank_by_median(snr, draws=50),
        "scope": scope_table(surrogates, deltas=deltas, sigmas=sigmas, runs=500, draws=20),
    }
    for name, table in found.items():
        tables.write_table(folder / f"results/paper/{name}.parquet", table, {"fit": "%"})
    tables.write_table(folder / "results/paper/design/identification.parquet", design, units)
    (folder / "config").mkdir()
    (folder / "config" / "config.yaml").write_text("study: paper\n")
    return folder
