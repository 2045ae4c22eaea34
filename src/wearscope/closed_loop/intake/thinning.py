"""Which stretches of the runs are used where there are more than memory and time allow.

Training runs are cut into stretches. Those are kept whose motion informs most on what a joint's torque may
depend on. The choice is greedy and maximises the determinant of each joint's information matrix, the
logarithms summed over the joints (D-optimal design; Wynn 1970). It uses positions, temperatures and time,
never the torque that is to be explained, since a choice by the outcome would bias the result. Test runs judge
the result, so they are thinned evenly.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.intake.dataset import Dataset, RunRecord
from wearscope.closed_loop.intake.filtering import REST_SHARE, low_pass
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.preprocessing import normalise_robot, prepare
from wearscope.closed_loop.intake.sources import Source, clean_record, widest_reach
from wearscope.closed_loop.intake.table_files import LEAST_ROWS

#: Cut-off and rate [Hz] of the motion on which the choice is based.
_CUTOFF, _RATE = 5.0, 25.0
#: Scales of temperature [deg C] and time [s] over which a machine warms up.
_WARM, _LONG = 30.0, 1000.0
#: Prior information, as a share of what a usual stretch adds.
_BEFORE = 1e-3
#: Largest share of the budget for one recording; share that goes first to one stretch of each session and
#: payload.
_OF_ONE, _OF_KINDS = 0.1, 0.5
#: Type of a stretch's information matrices (n, F, F): single precision, since there can be tens of thousands.
_KIND = np.float32


@dataclass(frozen=True)
class Budget:
    """Upper limits on how much of the runs is used.

    Memory and time of the loop grow with each of these. Seven joints with 35 training runs of 60 s at 1 kHz
    are used whole.

    Attributes
    ----------
    joint_seconds, joint_samples, joint_rows : float
        Seconds and samples of the training runs as recorded, and rows after the common filter, each times the
        number of joints.
    tested : float
        Limits of the test runs, as a share of those of the training runs.
    stretch : float
        Usual length of a stretch [s], longer where the rate is low.
    """

    joint_seconds: float = 16_000.0
    joint_samples: float = 16e6
    joint_rows: float = 600_000.0
    tested: float = 0.45
    stretch: float = 20.0

    def seconds(self, dataset: Dataset, use: str) -> float:
        """Total time [s] of the runs of one use, ``train`` or ``test``, that may be used."""
        n, share = len(dataset.joints), self.tested if use == "test" else 1.0
        return share * min(self.joint_seconds, self.joint_samples / dataset.fields.sample_rate) / n


@dataclass(frozen=True)
class Stretch:
    """A part of a recording.

    Attributes
    ----------
    record : int
        Number of the recording in the data set.
    start, stop : float
        Time since its first row [s].
    """

    record: int
    start: float
    stop: float

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.stop - self.start


def prepare_thinned(dataset: Dataset, budget: Budget | None = None) -> Prepared:
    """Prepare the thinned data set; thin again where the common filter keeps too many rows."""
    budget = budget or Budget()
    prepared = prepare(thin_dataset(dataset, budget))
    if prepared.n * sum(len(run.t) for run in prepared.runs_for("train")) <= budget.joint_rows:
        return prepared
    by_second = prepared.band.rate / prepared.band.stride
    fewer = replace(budget, joint_seconds=budget.joint_rows / by_second)
    return prepare(thin_dataset(dataset, fewer))


def thin_dataset(dataset: Dataset, budget: Budget | None = None) -> Dataset:
    """The data set, reduced to the stretches that are used where its runs exceed a budget.

    Parameters
    ----------
    dataset : Dataset
    budget : Budget, optional
        `Budget()` where None.

    Returns
    -------
    Dataset
        The same object where the budget is kept; else with a note on what is left out.
    """
    budget = budget or Budget()
    told: list[str] = []
    used: dict[int, tuple[tuple[float, float], ...] | None] = {}
    for use in ("train", "test"):
        most, records = budget.seconds(dataset, use), dataset.runs_for(use)
        whole = sum(record.seconds for record in records)
        if whole <= most:
            used |= {k: record.stretches for k, record in enumerate(dataset.runs) if record.use == use}
            continue
        length = max(budget.stretch, 2.0 * LEAST_ROWS / dataset.fields.sample_rate)
        stretches = [s for k, r in enumerate(dataset.runs) if r.use == use for s in _split(k, r, length)]
        if use == "train":
            chosen = _choose_informing(dataset, stretches, most)
            how = "stretches whose motion informs most, chosen without the torque,"
        else:
            count = max(1, int(most / max(s.seconds for s in stretches)))
            at = np.unique(np.linspace(0, len(stretches) - 1, count).round().astype(int))
            chosen, how = [stretches[k] for k in at], "evenly spaced stretches"
        files = {s.record for s in chosen}
        for k in files:
            used[k] = _join([s for s in chosen if s.record == k])
        seconds = sum(s.seconds for s in chosen)
        told.append(
            f"of {whole:.0f} s of {use} runs the {len(chosen)} {how} are used, {seconds:.0f} s of "
            f"{len(files)} of {len(records)} recordings"
        )
    if not told:
        return dataset
    runs = [replace(record, stretches=used[k]) for k, record in enumerate(dataset.runs) if k in used]
    note = f"more is recorded than memory and time allow: {'; '.join(told)}; the rest is left out."
    return replace(dataset, runs=runs, notes=[*dataset.notes, note])


def _split(number: int, record: RunRecord, length: float) -> list[Stretch]:
    """Cut a recording into stretches of about `length` [s] that span no gap."""
    stretches = []
    for start, stop in record.recorded:
        count = max(1, round((stop - start) / length))
        stretches += [
            Stretch(number, a, b) for a, b in pairwise(np.linspace(start, stop, count + 1).tolist())
        ]
    return stretches


def _join(stretches: list[Stretch]) -> tuple[tuple[float, float], ...]:
    """Times of one recording's stretches in order; stretches that touch are joined."""
    joined: list[tuple[float, float]] = []
    for s in sorted(stretches, key=lambda s: s.start):
        if joined and joined[-1][1] == s.start:
            joined[-1] = (joined[-1][0], s.stop)
        else:
            joined.append((s.start, s.stop))
    return tuple(joined)


def _choose_informing(dataset: Dataset, stretches: list[Stretch], most: float) -> list[Stretch]:
    """The stretches of training runs that inform most, at most `most` seconds in all."""
    information = np.array(list(_survey(dataset, stretches)), dtype=_KIND)
    runs = [dataset.runs[s.record] for s in stretches]
    kinds = [f"{run.session} {run.payload}" for run in runs]
    chosen = choose_stretches(
        information,
        np.array([s.seconds for s in stretches]),
        np.array([s.record for s in stretches]),
        np.unique(kinds, return_inverse=True)[1],
        most,
    )
    return [stretches[k] for k in sorted(chosen)]


def _survey(dataset: Dataset, stretches: list[Stretch]) -> Iterator[np.ndarray]:
    """Information matrices (n, F, F) of each stretch; recordings are read one at a time."""
    reach, (urdf, _) = widest_reach(dataset), normalise_robot(dataset.urdf, dataset)
    sources: list[tuple[Source, np.ndarray, np.ndarray]] = []
    last = -1
    for s in stretches:
        if s.record != last:
            made = clean_record(dataset, dataset.runs[s.record], urdf, reach, [])
            sources = [(one, *list_features(one, dataset.fields.sample_rate)) for one in made]
            last = s.record
        found = np.zeros((len(dataset.joints), FEATURES, FEATURES))
        for _, t, x in sources:
            inside = x[(t >= s.start) & (t < s.stop)]
            found += np.einsum("tjf,tjg->jfg", inside, inside)
        yield found.astype(_KIND)


FEATURES = 17
"""Number of features of a joint; see `list_features`."""


def list_features(source: Source, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (M,) of a cleaned recording, and features (M, n, FEATURES) that a joint's torque may depend on.

    The motion is filtered at 5 Hz; the torque is not used.
    """
    run = source.run
    step = max(1, round(rate / _RATE))
    q = low_pass(run.q, _CUTOFF, rate)
    v = np.gradient(q, 1.0 / rate, axis=0)
    a = np.gradient(v, 1.0 / rate, axis=0)
    t, q, v, a = run.t[::step], q[::step], v[::step], a[::step]
    load = source.body.inverse_dynamics(q, v, a)
    sign = np.where(np.abs(v) > REST_SHARE * np.abs(v).max(axis=0), np.sign(v), 0.0)
    warm = np.zeros_like(q) if run.temperature is None else np.nan_to_num(run.temperature[::step] - _WARM)
    time = np.broadcast_to((t / _LONG)[:, None], q.shape)
    one = np.ones_like(q)
    features = (
        one, sign, v, v * np.abs(v), v**2, q, q**2, q * sign, a, load, np.abs(load) * sign, load * v,
        warm, warm * sign, warm * v, time, time * sign,
    )  # fmt: skip
    return t, np.stack(features, axis=2)


def choose_stretches(
    information: np.ndarray, seconds: np.ndarray, record: np.ndarray, kind: np.ndarray, most: float
) -> list[int]:
    """Stretches that make the information largest, in the order of their choice.

    The best stretch of each kind comes first. Each next one is that which adds most to the log-determinant
    per second of its length. One recording supplies a tenth of the time at most (more where there are fewer
    than ten recordings), as long as others have stretches left.

    Parameters
    ----------
    information : ndarray (S, n, F, F)
    seconds : ndarray (S,)
    record, kind : ndarray (S,) of int
        Numbers of each stretch's recording, and of its combination of session and payload.
    most : float
        Seconds that may be chosen.
    """
    choice = _Choice(information, seconds, record, most)
    for one in np.unique(kind):
        own = np.flatnonzero(kind == one)
        best = own[np.argmax([choice.gain(int(k)) for k in own])]
        if choice.used + seconds[best] <= _OF_KINDS * most:
            choice.take(int(best))
    of_one = max(_OF_ONE, 1.0 / len(np.unique(record))) * most
    for share in (max(of_one, float(seconds.max())), np.inf):
        choice.fill(share)
    return choice.taken


class _Choice:
    """Stretches taken so far, and the information that they give."""

    def __init__(self, information: np.ndarray, seconds: np.ndarray, record: np.ndarray, most: float) -> None:
        usual = np.mean(np.einsum("sjff->sjf", information), axis=0, dtype=float)
        self.scale = 1.0 / np.sqrt(np.where(usual > 0.0, usual, 1.0))
        self.information, self.seconds, self.record, self.most = information, seconds, record, most
        self.known = np.tile(_BEFORE * np.eye(information.shape[2]), (information.shape[1], 1, 1))
        self.size = self._measure(self.known)
        self.taken: list[int] = []
        self.used = 0.0
        self._of = dict.fromkeys(record.tolist(), 0.0)

    @staticmethod
    def _measure(known: np.ndarray) -> float:
        return float(np.linalg.slogdet(known)[1].sum())

    def _scaled(self, k: int) -> np.ndarray:
        return self.information[k] * self.scale[:, :, None] * self.scale[:, None, :]

    def gain(self, k: int) -> float:
        """Increase of the log-determinant per second of a stretch."""
        return (self._measure(self.known + self._scaled(k)) - self.size) / float(self.seconds[k])

    def take(self, k: int) -> None:
        """Use a stretch."""
        self.known = self.known + self._scaled(k)
        self.size = self._measure(self.known)
        self.taken.append(k)
        self.used += float(self.seconds[k])
        self._of[int(self.record[k])] += float(self.seconds[k])

    def fill(self, share: float) -> None:
        """Take the best remaining stretches, at most `share` seconds of a recording.

        A stretch's gain only falls as others are taken, so an earlier gain is an upper bound (Minoux 1978).
        """
        taken = set(self.taken)
        left = [k for k in range(len(self.seconds)) if k not in taken]
        queue = [(-self.gain(k), k) for k in left]
        heapq.heapify(queue)
        while queue:
            _, k = heapq.heappop(queue)
            length = float(self.seconds[k])
            if self.used + length > self.most or self._of[int(self.record[k])] + length > share:
                continue
            now = -self.gain(k)
            if queue and now > queue[0][0]:
                heapq.heappush(queue, (now, k))
                continue
            self.take(k)
