"""False alarms of `wearscope detect` on a machine whose healthy sessions differ, and alarms where it is worn.

    .venv/bin/python -m benchmarks.session_scatter [--machines 6] [--scatter 0.0 0.1 0.3]

Each machine has two joints, five nominal sessions, four unchanged ones and a worn one. In each session the
Coulomb friction of each joint differs by a normal value. A threshold that knows the simulator's scatter alone
stands next to the one that is used.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from worn_arm import make_duo, write_machine

from benchmarks.command import start_parser
from wearscope.detection.judgement import judge_recordings
from wearscope.detection.run import Setting, ask_recordings
from wearscope.detection.thresholds import find_threshold
from wearscope.detectors.questions import DetectorSpec

DETECTORS = [
    DetectorSpec("A", "residual_energy", {"align": "path"}),
    DetectorSpec("B", "distribution_distance"),
    DetectorSpec("C", "friction_fit"),
]
UNCHANGED, WORN = (1, 0.0, 8.0, 0.5), (1, 40.0, 8.0, 0.5)


def count_alarms(seed: int, scatter: float, setting: Setting) -> pd.DataFrame:
    """Whether each recording and cell reaches either threshold."""
    with tempfile.TemporaryDirectory() as folder:
        judged = [UNCHANGED] * 4 + [WORN]
        data = write_machine(Path(folder) / "duo", judged, nominal=5, seed=seed, disturbance=scatter)
        found = judge_recordings(ask_recordings(data, make_duo(), DETECTORS, setting=setting), setting)
    unworn = found.simulated[found.simulated["kind"] == "simulated"]
    plain = unworn.groupby(["joint", "fda"])["y"].apply(
        lambda y: find_threshold(np.asarray(y), setting.p_f).value
    )
    own = found.detection[found.detection["kind"] == "judged"]
    own = own.merge(plain.rename("plain").reset_index(), on=["joint", "fda"])
    return pd.DataFrame(
        {
            "scatter": scatter,
            "fda": own["fda"],
            "worn": own["run"] == own["run"].max(),
            "simulator's scatter": own["y"] >= own["plain"],
            "machine's scatter": own["verdict"] == "alarm",
        }
    )


def main() -> None:
    """Print the share of cells (recording and joint) with an alarm, by detector."""
    parser = start_parser(__doc__)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--scatter", type=float, nargs="+", default=[0.0, 0.1, 0.3], help="[N m]")
    given = parser.parse_args()
    setting = Setting(p_f=0.02, runs=99, worn_runs=1)
    tables = [
        count_alarms(seed, scatter, setting) for scatter in given.scatter for seed in range(given.machines)
    ]
    counted = pd.concat(tables).groupby(["scatter", "worn", "fda"])
    print(counted.sum().assign(of=counted.size()).to_string())


if __name__ == "__main__":
    main()
