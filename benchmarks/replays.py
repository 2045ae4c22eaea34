"""How far a joint with falling friction is from its motion when the torque is given alone, by simulator.

    .venv/bin/python -m benchmarks.replays

Each motion starts anew every half second; the model's own simulator is asked as MuJoCo is. So what no torque
alone can tell (when a joint leaves a rest) stands next to what the export adds.
"""

import numpy as np
import pandas as pd
from single_axis import COULOMB, make_axis

from benchmarks.command import start_parser
from wearscope.cycles.base import Reference, required_torque
from wearscope.cycles.planned import PlannedMotion
from wearscope.export.comparison import HORIZONS, replay
from wearscope.export.formats import make_spec
from wearscope.export.holdings import take_holdings, without_motors
from wearscope.robots.model import RobotModel
from wearscope.simulation.study import trace_forward

STEP, FIRST, EVERY = 0.004, 0.3, 0.5


def replay_own(model: RobotModel, motion: Reference, torque: np.ndarray) -> np.ndarray:
    """Median position error (3, n) of the model's own simulator, started as `replay` starts MuJoCo."""
    ends = [round(one / STEP) for one in HORIZONS]
    errors = []
    for start in range(round(FIRST / STEP), len(motion.t) - ends[-1] - 1, round(EVERY / STEP)):
        part = slice(start, start + ends[-1] + 1)
        asked = Reference(STEP * np.arange(ends[-1] + 1), motion.q[part], motion.v[part], motion.a[part])
        trace, dt = trace_forward(model, asked, feedforward=torque[part], feedback=False)
        errors.append([np.abs(trace.q[end * round(STEP / dt)] - asked.q[end]) for end in ends])
    return np.asarray(np.median(np.array(errors), axis=0))


def main() -> None:
    """Print the median over motions of each simulator's median error."""
    parser = start_parser(__doc__)
    parser.add_argument("--motions", type=int, default=8)
    parser.add_argument("--exponents", type=float, nargs="+", default=[0.7, 1.0, 1.5, 2.0])
    given = parser.parse_args()
    rows = []
    for exponent in given.exponents:
        fall = {"level": 4.0, "speed": 0.2, "exponent": exponent}
        model = make_axis(("coulomb", COULOMB), ("viscous", {"slope": 1.0}), ("stribeck", fall))
        held = take_holdings(model, 50.0)
        for seed in range(given.motions):
            motion = PlannedMotion("points", seed=seed, pace=0.7, size=0.8, seconds=16.0)
            path = motion.build(model, 0.05, STEP)
            torque = required_torque(path, model, 50.0, 0.0, 1.0)
            found = {"own simulator": replay_own(model, path, torque)}
            for name, one in (("MJCF", held), ("without passive motors", without_motors(held))):
                found[name] = replay(make_spec(model, one), model.joints, path, torque)
            for name, error in found.items():
                after = {f"{s:g} s": error[k, 0] for k, s in enumerate(HORIZONS)}
                rows.append({"exponent": exponent, "by": name, **after})
    print(pd.DataFrame(rows).groupby(["exponent", "by"]).median().to_string(float_format="%.5f"))


if __name__ == "__main__":
    main()
