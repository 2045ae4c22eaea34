"""What every rival reads: one joint's regression in the common band, with blocks as the units of inference.

It is made by the board's own features from the data set's folder alone. Torque and columns are smoothed and
thinned alike, rows at rest are left out, the declared effects are projected out of both, and of a family's
variants the one that fits best alone is kept.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from wearscope.attribution_board.features import CUTOFF_HZ, KEPT_RATE_HZ, Families, Track, make_track
from wearscope.attribution_board.machines import Body
from wearscope.attribution_board.truth import BLOCK_SECONDS, orthonormal
from wearscope.tables import read_table

Array = NDArray[np.float64]

MOST_ROWS = 6000


@dataclass(frozen=True)
class RivalTable:
    """One joint's regression.

    Attributes
    ----------
    joint : str
    columns : array (rows, p)
        Of unit RMS, without what the declared effects explain.
    target : array (rows,)
        The measured torque in the same way.
    blocks : array of int (rows,)
        Number of each row's block, from 0.
    labels : tuple of str, (p,)
        The effect that a column belongs to; an effect may have several.
    signals : array (rows, k)
        What a black box may look at: positions, speeds, accelerations and the rest.
    """

    joint: str
    columns: Array
    target: Array
    blocks: NDArray[np.int64]
    labels: tuple[str, ...]
    signals: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Effects in the order of their columns."""
        return tuple(dict.fromkeys(self.labels))

    def find_columns(self, name: str) -> NDArray[np.int64]:
        """Positions of an effect's columns."""
        return np.flatnonzero(np.array(self.labels) == name)


def _read_track(folder: Path, document: dict[str, Any], run: dict[str, Any]) -> tuple[Track, Array]:
    robot, rate = document["robot"], float(document["sample_rate"])
    urdf = (folder / robot["urdf"]).read_text(encoding="utf-8")
    table, joints = read_table(folder / run["file"]), robot["joints"]
    sos = butter(3, min(CUTOFF_HZ, 0.4 * rate), fs=rate, output="sos")
    q = sosfiltfilt(sos, table[[f"q_{joint}" for joint in joints]].to_numpy(), axis=0)
    v = np.gradient(q, 1 / rate, axis=0, edge_order=2)
    a = np.gradient(v, 1 / rate, axis=0, edge_order=2)
    warm = None
    if f"temp_{joints[0]}" in table:
        warm = table[[f"temp_{joint}" for joint in joints]].to_numpy()
    load = run.get("payload", {"mass": 0.0, "com": (0.0, 0.0, 0.0)})
    body = Body(urdf, tuple(robot["gravity"]), float(load["mass"]), tuple(load["com"]))
    track = make_track(body, urdf, table["t"].to_numpy(), q, v, a, warm, float(load["mass"]) > 0)
    return track, table[[f"tau_{joint}" for joint in joints]].to_numpy()


def make_tables(dataset: str | Path) -> list[RivalTable]:
    """Tables of a measured-data folder's training runs, by joint.

    Parameters
    ----------
    dataset : path-like
        The folder.
    """
    folder = Path(dataset)
    document = yaml.safe_load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    rate, robot = float(document["sample_rate"]), document["robot"]
    runs = [_read_track(folder, document, run) for run in document["runs"] if run["use"] == "train"]
    tracks = [track for track, _ in runs]
    units = document["units"]["q"]
    declared = list(document["declared_effects"])
    rigid = "rigid_body" in declared
    known = np.array(robot.get("rotor_inertia") or np.zeros(len(robot["joints"])))
    refitted = declared
    if "rotor_inertia" in declared and "rotor_inertia" in robot:
        refitted = ["rotor_inertia_given" if name == "rotor_inertia" else name for name in declared]
    else:
        known = np.zeros_like(known)
    out = []
    for j, joint in enumerate(robot["joints"]):
        slides = (units if isinstance(units, str) else units[j]) == "m"
        families = Families(tracks, j, rate, slides, refitted)
        torque = [
            tau[:, j] - (track.rigid[:, j] if rigid else 0.0) - known[j] * track.a[:, j]
            for track, tau in runs
        ]
        out.append(_make_table(joint, families, torque, tracks, j, rate))
    return out


def _make_table(
    joint: str, families: Families, torque: list[Array], tracks: list[Track], j: int, rate: float
) -> RivalTable:
    moving = np.flatnonzero(families.moving())
    rows = moving[:: max(1, -(-len(moving) // MOST_ROWS))]
    pieces, start = [], 0
    for length in families.lengths():
        pieces.append(start + np.arange(length) // max(1, round(BLOCK_SECONDS * KEPT_RATE_HZ)))
        start = int(pieces[-1][-1]) + 1
    _, blocks = np.unique(np.concatenate(pieces)[rows], return_inverse=True)
    basis = orthonormal(families.declared[rows])
    target = families.pool(torque)[rows]
    target = target - basis @ (basis.T @ target)
    columns, labels = [], []
    for name in families.names():
        best, share = np.zeros((len(rows), 0)), -1.0
        for variant in families.variants(name):
            free = variant[rows] - basis @ (basis.T @ variant[rows])
            whole = np.sqrt(np.mean(variant[rows] ** 2, axis=0)) + 1e-300
            free = free[:, np.sqrt(np.mean(free**2, axis=0)) > 1e-3 * whole]
            own = orthonormal(free) if free.shape[1] else free
            explained = float(np.sum((own.T @ target) ** 2))
            if free.shape[1] and explained > share:
                best, share = free / np.sqrt(np.mean(free**2, axis=0)), explained
        columns.append(best)
        labels += [name] * best.shape[1]
    thin = max(1, round(rate / KEPT_RATE_HZ))
    seen = [
        np.column_stack([track.q, track.v, track.a, np.tanh(track.v / families.grain), track.load, track.t])[
            thin:-thin:thin
        ]
        for track in tracks
    ]
    signals = np.vstack(seen)[rows]
    return RivalTable(joint, np.hstack(columns), target, blocks, tuple(labels), signals)
