"""Surrogate runs per second, and seconds for the SNRs of all cells, against the paper's.

python -m benchmarks.surrogates [--runs 100000] [--cells 144]
"""

import argparse
import statistics
import time

import numpy as np

from benchmarks.planted import planted_test_quantities
from wearscope.evaluation.snr import sample_output, snr_table
from wearscope.surrogates.fitting import fit_surrogates, surrogates_of

PAPER_RUNS_PER_SECOND = 9e5
PAPER_SNR_SECONDS = 12.0
PAPER_SNR_RUNS = 1.08e7


def time_call(call, repeats):
    """Median seconds of a call."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100_000, help="Monte Carlo runs under each hypothesis")
    parser.add_argument("--cells", type=int, default=144, help="a multiple of 36")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()

    fdas = [f"fda{k}" for k in range(max(1, arguments.cells // 36))]
    quantities, _ = planted_test_quantities(cycles=list("abcdef"), fdas=fdas)
    start = time.perf_counter()
    fit_surrogates(quantities, ["main"])
    print(f"first fit (imports statsmodels): {time.perf_counter() - start:.2f} s")
    start = time.perf_counter()
    surrogates = fit_surrogates(quantities)
    cells = surrogates.groupby(["robot", "cycle", "axis", "fda"]).ngroups
    print(f"least squares, {cells} cells x 3 models: {time.perf_counter() - start:.2f} s")

    _, surrogate = next(surrogates_of(surrogates, "full"))
    rng = np.random.default_rng(0)
    z = rng.standard_normal((arguments.runs, 6))
    evaluate = time_call(lambda: surrogate.predict(z), arguments.repeats)
    draw = time_call(lambda: sample_output(surrogate, rng, arguments.runs, 0.5, 0.25), arguments.repeats)
    total = time_call(lambda: snr_table(surrogates, runs=arguments.runs), 1)
    runs = 2 * arguments.runs * cells
    print(f"{'':34}{'runs/s':>12}{'of the paper':>14}")
    for name, rate in (
        ("evaluation alone", arguments.runs / evaluate),
        ("drawing and evaluation", arguments.runs / draw),
        ("SNRs with errors and intervals", runs / total),
    ):
        print(f"{name:34}{rate:12.3g}{rate / PAPER_RUNS_PER_SECOND:13.1f}x")
    print(
        f"SNRs of {cells} cells, {runs:.3g} runs: {total:.2f} s "
        f"(paper: {PAPER_SNR_RUNS:.3g} runs in {PAPER_SNR_SECONDS:g} s)"
    )


if __name__ == "__main__":
    main()
