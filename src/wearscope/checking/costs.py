"""What a study would take, roughly, so that a slip of some zeros is told before anything is computed."""

from collections.abc import Iterator
from math import prod

from wearscope import limits
from wearscope.config import StudyConfig

#: Taken by a Monte Carlo run of a surrogate [s], by the recording of a simulated second and axis [bytes a
#: sample], and by a value of a table [bytes]; a test-cycle lasts this long [s]. Orders of magnitude.
RUN_SECONDS, SAMPLE_BYTES, VALUE_BYTES, CYCLE_SECONDS = 1e-7, 24, 8, 20.0
#: Step for which `simulation.point_seconds` is stated [s].
USUAL_STEP = 0.001


def list_excesses(study: StudyConfig) -> Iterator[str]:
    """Settings that would take over a year of one core or a terabyte, a sentence with the figure each."""
    pairs = len(study.robots) * len(study.cycles)
    cells = pairs * len(study.axes) * len(study.detectors)
    points = 2 * study.design.count_points(study.factors) + sum(study.count_filling_points())
    points += study.simulation.nominal_runs + study.count_audit_points()
    direct = study.direct.runs + bool(study.direct.mismatch) * study.direct.mismatch_runs
    runs = pairs * points + 2 * direct * study.direct.enabled
    slower = max(1.0, USUAL_STEP / study.simulation.step)
    grid = prod(study.scope.grid) * len(study.scope.factors)
    rate = study.simulation.sample_rate or 250.0
    seconds = {
        "simulation": runs * study.simulation.point_seconds * slower,
        "snr.runs": 2.0 * cells * study.snr.runs * RUN_SECONDS,
        "scope.grid and scope.runs": 2.0 * cells * grid * study.scope.runs * RUN_SECONDS,
    }
    room = {
        "simulation": runs * CYCLE_SECONDS * rate * SAMPLE_BYTES * 6.0,
        "snr.runs": 2.0 * study.snr.runs * len(study.factors) * VALUE_BYTES,
        "scope.grid": cells * grid * 4.0 * VALUE_BYTES,
    }
    for name, taken in seconds.items():
        if taken > limits.YEAR:
            years = taken / limits.YEAR
            yield f"{name}: takes about {years:.2g} years of one core as it is set; make it smaller."
    for name, taken in room.items():
        if taken > limits.TERABYTE:
            yield f"{name}: takes about {taken / 1e12:.2g} TB as it is set; make it smaller."
