"""A user's own detector: RMS change of the torque of the tested axis against the first nominal batch."""

import numpy as np


class TorqueChange:
    def __init__(self, fail_above: float = np.inf) -> None:
        self.fail_above = fail_above

    def fit(self, nominal, axis, model):
        self.axis, self.nominal = axis, nominal[0].tau[:, axis]

    def test_quantity(self, batch):
        n = min(len(self.nominal), len(batch.tau))
        y = float(np.sqrt(np.mean((batch.tau[:n, self.axis] - self.nominal[:n]) ** 2)))
        return y if y <= self.fail_above else float("nan")


DETECTOR = TorqueChange
