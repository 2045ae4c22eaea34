"""Seconds for all scope matrices by each method, against the paper's 3 h 15 min for 108 cells x 2 factors.

python -m benchmarks.scope [--cells 144] [--runs 100000] [--sample 12]
"""

import argparse
import time

import numpy as np

from benchmarks.planted import planted_test_quantities
from wearscope.evaluation.scope import paper_grid, scope_quadratics, scope_table
from wearscope.evaluation.scope_kde import bandwidth_factor
from wearscope.surrogates.fitting import fit_surrogates, surrogates_of

PAPER_SECONDS = 3.25 * 3600
PAPER_MATRICES = 216


def time_plain(surrogate, runs, points=3):
    """Seconds a grid cell of drawing all runs anew and binning them in y, as a plain program would."""
    null, alternatives = scope_quadratics(surrogate, "w3", *paper_grid())
    rng = np.random.default_rng(0)
    start = time.perf_counter()
    for k in range(points):
        for a, b, c in (null[k], alternatives[k, k]):
            x = rng.standard_normal(runs)
            y = a + x * (b + c * x)
            counts, edges = np.histogram(y, 2048)
            centres = 0.5 * (edges[1:] + edges[:-1])
            width = bandwidth_factor(runs) * y.std()
            assert width > 0 and counts.sum() == runs and centres.size == 2048
    return (time.perf_counter() - start) / points


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=144, help="a multiple of 36")
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--sample", type=int, default=0, help="measure this many cells and scale up; 0: all")
    arguments = parser.parse_args()

    fdas = [f"fda{k}" for k in range(max(1, arguments.cells // 36))]
    quantities, _ = planted_test_quantities(cycles=list("abcdef"), fdas=fdas)
    surrogates = fit_surrogates(quantities, ["full"])
    keys = ["robot", "cycle", "axis", "fda"]
    cells = surrogates[keys].drop_duplicates()
    measured = cells.head(arguments.sample) if arguments.sample else cells
    rows = surrogates.merge(measured, on=keys)
    scope_table(rows.head(28), methods=["kde"], deltas=[1.0], sigmas=[0.5], runs=1000)  # compile

    matrices = 2 * len(measured)
    scale = len(cells) / len(measured)
    print(f"{len(cells)} cells x 2 factors x 900 grid cells, measured on {len(measured)}; one process")
    print(f"{'method':12}{'all [s]':>10}{'grid cell [ms]':>16}{'against the paper':>19}")
    for name, setting in (
        ("exact", {"methods": ["exact"], "draws": 0}),
        ("+ 200 draws", {"methods": ["exact"]}),
        ("kde", {"methods": ["kde"]}),
    ):
        start = time.perf_counter()
        scope_table(rows, runs=arguments.runs, **setting)
        seconds = time.perf_counter() - start
        ratio = (PAPER_SECONDS / PAPER_MATRICES) / (seconds / matrices)
        each = 1e3 * seconds / matrices / 900
        print(f"{name:12}{seconds * scale:10.2f}{each:16.4f}{ratio:18.0f}x")
    _, surrogate = next(surrogates_of(surrogates, "full"))
    plain = time_plain(surrogate, arguments.runs)
    print(
        f"{'plain':12}{plain * 1800 * len(cells):10.0f}{1e3 * plain:16.4f}  (runs drawn anew for each grid "
        "cell, histogram only; scaled up)"
    )
    both = scope_table(rows.head(28 * 4), runs=arguments.runs)
    exact, kde = (both.loc[both["method"] == method, "passes"].to_numpy() for method in ("exact", "kde"))
    print(f"the methods disagree in {(exact != kde).sum()} of {len(exact)} grid cells (4 planted cells)")


if __name__ == "__main__":
    main()
