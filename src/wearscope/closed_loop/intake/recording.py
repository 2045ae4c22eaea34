"""One recording of a data set, as arrays in joint order."""

from dataclasses import dataclass, field, replace

import numpy as np

from wearscope.closed_loop.intake.dataset_fields import PayloadFields

#: Fewest changes of a position that show the step of its encoder.
LEAST_CHANGES = 3
#: Differences are whole steps where this share of them at most deviates from one by more than this share of a
#: step.
_WHOLE = 0.02


@dataclass
class Run:
    """One recording, or a piece of one between gaps.

    Attributes
    ----------
    file : str
    use : str
        ``train`` or ``test``.
    t : ndarray (N,)
        Time [s] since the recording's first row.
    q, tau : ndarray (N, n)
        Joint position and joint-side torque.
    qd, temperature : ndarray (N, n) or None
        Joint speed and temperature [deg C]: None where no joint has any, NaN for joints that have none.
    payload : PayloadFields or None
    session : str or None
    channels : dict of str to ndarray (N,)
        Further columns that `dataset.yaml` names.
    start : float
        Time of the recording's first row on its own clock [s].
    piece : int
        Number of the piece from 1; 0 where the recording is whole.
    losses : ndarray (G, 2)
        Start and end of each loss of a few samples [s].
    off : ndarray (N, n) of bool or None
        Rows in which a servo's torque was switched off.
    notes : tuple of str
        Remarks on how its torque was read.
    quantum : ndarray (n,) or None
        Smallest step of each position as recorded; 0 where it is too fine to tell.
    """

    file: str
    use: str
    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    qd: np.ndarray | None
    temperature: np.ndarray | None
    payload: PayloadFields | None
    session: str | None = None
    channels: dict[str, np.ndarray] = field(default_factory=dict)
    start: float = 0.0
    piece: int = 0
    losses: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    quantum: np.ndarray | None = None
    off: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name of the piece: the file, and the number of the piece where there are several."""
        return f"{self.file}#{self.piece}" if self.piece else self.file

    def cut(self, start: int, stop: int) -> "Run":
        """Rows from `start` to before `stop`."""
        part = slice(start, stop)
        return replace(
            self,
            t=self.t[part],
            q=self.q[part],
            tau=self.tau[part],
            qd=None if self.qd is None else self.qd[part],
            temperature=None if self.temperature is None else self.temperature[part],
            off=None if self.off is None else self.off[part],
            channels={name: x[part] for name, x in self.channels.items()},
        )


def estimate_quantum(q: np.ndarray) -> np.ndarray:
    """Smallest step (n,) of recorded positions (N, n); 0 where nearly all values differ.

    Values on a grid come back again and again, or lie whole steps apart; the smallest difference of two of
    them is the grid's step. A position that hardly ever changes shows none.
    """
    quantum = np.zeros(q.shape[1])
    for j, x in enumerate(q.T):
        values = np.unique(x)
        if len(values) > 1 and np.count_nonzero(np.diff(x)) >= LEAST_CHANGES:
            apart = np.diff(values)
            apart = apart[apart > 1e-9 * max(float(np.abs(values).max()), 1e-300)]
            steps = apart / apart.min() if len(apart) else np.zeros(1)
            whole = np.mean(np.abs(steps - np.round(steps)) < _WHOLE) > 1.0 - _WHOLE
            if len(apart) and (len(values) < 0.5 * len(x) or whole):
                quantum[j] = apart.min()
    return quantum
