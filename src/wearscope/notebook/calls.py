"""Functions `diagnose`, `track`, `detect` and `evaluate` for notebooks, and their results.

Each function takes a data set's folder, or data frames and the robot's URDF. A result has a headline, a table
with units, and plots, which can be drawn on given axes.
"""

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pandas as pd

from wearscope.designs.factors import PAPER_FACTORS
from wearscope.detectors.questions import DetectorSpec
from wearscope.errors import InputError
from wearscope.reporting.labels import effect_name, parameter_name, unit_text
from wearscope.reporting.style import PALETTE, new_figure
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.dataset import write_dataset
from wearscope.starters.mapped import Mapped
from wearscope.storage.tables import read_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wearscope.closed_loop.diagnosis import Diagnosis
    from wearscope.detection.judgement import Detection
    from wearscope.notebook.model_errors import ModelErrors


#: Unit of a column whose rows have different units, which the column `unit` states.
OWN_UNIT = "as the column unit says"


def with_units(table: pd.DataFrame, units: Mapping[str, str]) -> pd.DataFrame:
    """Set ``attrs["units"]`` of a table to the units of its columns, and return the table."""
    table.attrs["units"] = {name: unit for name, unit in units.items() if name in table.columns}
    return table


def take_axes(ax: "Axes | None", width: float = 7.0, height: float = 4.0) -> "Axes":
    """Return the given axes, or new ones."""
    return new_figure(width, height).subplots() if ax is None else ax


def check_known(what: str, asked: str | None, known: Iterable[str]) -> None:
    """Refuse a plot of a joint or detector that does not exist; None passes."""
    known = list(known)
    if asked is not None and asked not in known:
        raise InputError(f"plot: there is no {what} '{asked}'; there are {', '.join(known)}.")


class Shown:
    """A result that a notebook shows by its headline and its summary."""

    def headline(self) -> str:
        """Return the answer in one sentence."""
        raise NotImplementedError

    def summary(self) -> pd.DataFrame:
        """Return the answer as a table with units."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self.headline()}"

    def _repr_html_(self) -> str:
        from markupsafe import escape

        return f"<p><strong>{escape(self.headline())}</strong></p>{self.summary().to_html(index=False)}"


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Shown):
    """Result of `wearscope.diagnose`.

    Attributes
    ----------
    outcome : Diagnosis
        The complete diagnosis; its attributes are attributes of the result too.
    """

    outcome: "Diagnosis"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "outcome":
            raise AttributeError(name)
        return getattr(self.outcome, name)

    def headline(self) -> str:
        """Return the effects that the model lacks, with their joints."""
        named = [f"{effect_name(one['effect'])} at {one['joint']}" for one in self.outcome.verdict["verdict"]]
        return f"the model lacks {', '.join(named)}" if named else "nothing is found that the model lacks"

    def summary(self) -> pd.DataFrame:
        """Return a row for each named effect: joint, effect, status, equivalents, share of error removed."""
        return with_units(self.outcome.summary(), {"error_reduction": "1"})

    def parameters(self) -> pd.DataFrame:
        """Return a row for each parameter of a named effect: value with its 95 % interval, and the unit."""
        rows = [
            (one["joint"], one["effect"], name, value["value"], *value["ci95"], value["unit"], one["status"])
            for one in self.outcome.verdict["verdict"]
            for name, value in one["parameters"].items()
        ]
        names = ["joint", "effect", "parameter", "value", "low", "high", "unit", "status"]
        return with_units(pd.DataFrame(rows, columns=names), dict.fromkeys(names[3:6], OWN_UNIT))

    def errors(self) -> pd.DataFrame:
        """Return a row for each joint: prediction error (RMS) before and after, noise floor, and state."""
        names = ["rms_before", "rms_after", "noise_floor", "unit", "state", "error"]
        joints = self.outcome.verdict["joints"]
        rows = [{"joint": joint, **{name: one.get(name) for name in names}} for joint, one in joints.items()]
        return with_units(pd.DataFrame(rows), dict.fromkeys(names[:3], OWN_UNIT))

    @cached_property
    def residuals(self) -> pd.DataFrame:
        """Table with a row for each sample: measured torque, and residuals of the models before and after."""
        from wearscope.closed_loop.model.prediction import residual_table

        table = residual_table(self.outcome.prepared, self.outcome.predicted)
        return with_units(table, {"t": "s"})

    def plot(self, kind: str = "errors", joint: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw the errors by joint, or a joint's residual over time.

        Parameters
        ----------
        kind : {"errors", "residual"}
        joint : str, optional
            Joint of the residual; by default the one whose error decreased most.
        ax : matplotlib axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib axes

        Raises
        ------
        InputError
            Where there is no such plot or joint.
        """
        if kind not in ("errors", "residual"):
            raise InputError(f"plot: there is no '{kind}'; choose errors or residual.")
        errors = self.errors()
        check_known("joint", joint, errors["joint"])
        ax = take_axes(ax)
        if kind == "errors":
            place = np.arange(len(errors))
            for k, (name, tint) in enumerate((("before", PALETTE[1]), ("after", PALETTE[0]))):
                ax.barh(place + 0.2 - 0.4 * k, errors[f"rms_{name}"], 0.4, label=name, color=tint)
            ax.set_yticks(place, errors["joint"])
            ax.set_xlabel(f"error of the torque, RMS [{errors['unit'].iloc[0]}]")
        else:
            gain = errors.set_index("joint")["rms_before"] - errors.set_index("joint")["rms_after"]
            joint = joint or str(gain.idxmax())
            rows = self.residuals[self.residuals["joint"] == joint]
            for name, tint in (("before", PALETTE[1]), ("after", PALETTE[0])):
                ax.plot(np.arange(len(rows)), rows[f"residual_{name}"], color=tint, lw=0.7, label=name)
            ax.set_xlabel("sample, all runs")
            ax.set_ylabel(f"residual at {joint} [{errors.set_index('joint').at[joint, 'unit']}]")
        ax.legend()
        return ax


@dataclass(frozen=True, repr=False)
class TrackingResult(Shown):
    """Result of `wearscope.track`.

    Attributes
    ----------
    content : dict
        Content of ``tracking.json``.
    changes : DataFrame
        Content of ``changes.parquet``.
    """

    content: Mapping[str, Any]
    changes: pd.DataFrame

    def headline(self) -> str:
        """Return the changes in the last session that shows any."""
        rows = self.summary()
        if rows.empty:
            return f"no change in {', '.join(one['session'] for one in self.content['sessions'])}"
        last = rows[rows["session"] == rows["session"].iloc[-1]]
        told = [f"{effect_name(one.effect)} at {one.joint} by {one.change:+.3g} {unit_text(one.unit)}"
                for one in last.itertuples()]  # fmt: skip
        return f"session {last['session'].iloc[0]}: {', '.join(one.strip() for one in told)}"

    def summary(self) -> pd.DataFrame:
        """Return a row for each session and change: 95 % interval, and session since which it is present."""
        names = ["session", "joint", "effect", "parameter", "change", "low", "high", "unit", "since"]
        rows = [
            (session["session"], *(one[name] for name in names[1:5]), *one["ci95"], one["unit"], one["since"])
            for session in self.content["sessions"]
            for one in session["changes"]
        ]
        return with_units(pd.DataFrame(rows, columns=names), dict.fromkeys(names[4:7], OWN_UNIT))

    def plot(self, joint: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw the changes of a joint over the sessions, with their 95 % intervals.

        Parameters
        ----------
        joint : str, optional
            By default the joint that changed last, or the first joint.
        ax : matplotlib axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib axes

        Raises
        ------
        InputError
            Where there is no such joint.
        """
        known = list(dict.fromkeys(self.changes["joint"]))
        changed = list(self.summary()["joint"])
        joint = joint or (changed or known)[-1 if changed else 0]
        check_known("joint", joint, known)
        rows = self.changes[self.changes["joint"] == joint]
        sessions = list(dict.fromkeys(self.changes["session"]))
        ax = take_axes(ax)
        groups = rows.groupby(["effect", "parameter", "unit"], sort=False)
        for k, ((effect, name, unit), own) in enumerate(groups):
            place = [sessions.index(one) for one in own["session"]]
            sides = np.abs(own[["change_low", "change_high"]].to_numpy().T - own["change"].to_numpy())
            label = f"{effect_name(effect)}, {parameter_name(name)} [{unit_text(unit)}]"
            ax.errorbar(place, own["change"], sides, fmt="o-", color=PALETTE[k % len(PALETTE)], label=label)
        ax.axhline(0.0, color="0.6", lw=0.8)
        ax.set_xticks(range(len(sessions)), sessions, rotation=30)
        ax.set_ylabel(f"change at {joint}")
        ax.legend(fontsize="small")
        return ax


@dataclass(frozen=True, repr=False)
class DetectionResult(Shown):
    """Result of `wearscope.detect`; ``outcome`` is the complete result."""

    outcome: "Detection"

    def headline(self) -> str:
        """Return the number of judgements by verdict."""
        counts = self.outcome.detection["verdict"].value_counts()
        return ", ".join(f"{verdict}: {count}" for verdict, count in counts.items()) or "nothing was judged"

    def summary(self) -> pd.DataFrame:
        """Return a row for each judged recording, joint and detector: value, threshold, verdict, wear."""
        names = [
            *("run", "session", "joint", "fda", "y", "threshold", "unit", "verdict"),
            *("wear", "wear_low", "wear_high"),
        ]
        table = self.outcome.detection
        table = table.loc[table["kind"] == "judged", names].reset_index(drop=True)
        return with_units(table, {"y": OWN_UNIT, "threshold": OWN_UNIT})

    def plot(self, detector: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw each recording's test quantity divided by its threshold; a value above 1 is an alarm.

        Raises
        ------
        InputError
            Where there is no such detector.
        """
        rows = self.summary()
        known = list(dict.fromkeys(rows["fda"]))
        check_known("detector", detector, known)
        rows = rows[rows["fda"] == (detector or known[0])] if known else rows
        ax = take_axes(ax)
        for k, (joint, own) in enumerate(rows.groupby("joint", sort=False)):
            ax.plot(
                own["run"], own["y"] / own["threshold"], "o", color=PALETTE[k % len(PALETTE)], label=joint
            )
        ax.axhline(1.0, color="0.3", ls="--")
        ax.set_ylabel("test quantity over threshold")
        ax.tick_params(axis="x", rotation=30)
        ax.legend(fontsize="small")
        return ax


@dataclass(frozen=True, repr=False)
class EvaluationResult(Shown):
    """Result of `wearscope.evaluate`.

    Attributes
    ----------
    outcome : ModelErrors
        The complete tables ``torque`` and ``rollouts``.
    """

    outcome: "ModelErrors"

    def headline(self) -> str:
        """Return the largest error, its joint, and what was judged."""
        rows = self.summary().dropna(subset=["error_percent"])
        if rows.empty:
            return "nothing could be simulated"
        worst = rows.loc[rows["error_percent"].idxmax()]
        size, judged = f"{worst['error_percent']:.2g} %", self.outcome.judged
        where = f"; judged at {judged['joints']} of {judged['of']} joints over {judged['seconds']:.3g} s"
        return f"up to {size} of the torque is not predicted, most at {worst['joint']}{where}"

    def summary(self) -> pd.DataFrame:
        """Return a row for each joint: torque and error (RMS over the judged time), and their ratio."""
        table, names = self.outcome.torque, ["torque_rms", "error_rms"]
        seconds = table["seconds"].where(table["error_rms"].notna())
        sums = table[names].pow(2).mul(seconds, axis=0).assign(seconds=seconds)
        sums = sums.groupby([table["joint"], table["unit"]], sort=False).sum()
        means = sums[names].div(sums["seconds"], axis=0) ** 0.5
        means["error_percent"] = 100.0 * means["error_rms"] / means["torque_rms"]
        return with_units(means.reset_index(), {"error_percent": "%"})

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the error of each joint in per cent of its torque."""
        rows, ax = self.summary(), take_axes(ax)
        ax.barh(rows["joint"], rows["error_percent"], color=PALETTE[0])
        ax.set_xlabel("torque that is not predicted [%]")
        return ax


Say = Callable[[str], None]
#: One recording, or several; the keys of a mapping are the names of the runs.
Frames: TypeAlias = pd.DataFrame | Sequence[pd.DataFrame] | Mapping[str, pd.DataFrame]


def _quiet(line: str) -> None:
    """Print nothing."""


def diagnose(
    recordings: str | Path | Frames,
    urdf: str | Path | None = None,
    *,
    progress: Say = _quiet,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
    **stated: Any,
) -> DiagnosisResult:
    """Name the effects that the model of a measured robot lacks, correct the model, and state the certainty.

    Parameters
    ----------
    recordings : path-like, DataFrame, or sequence or mapping of DataFrame
        A data set's folder, or recordings with time, positions [rad] and torques [N m] of the joints.
    urdf : path-like, optional
        URDF of the robot; needed with data frames.
    progress : callable
        Called with a line of text at each step, e.g. ``print``.
    effects : sequence of path-like
        Files of own effects.
    allow_code : bool
        Whether effect files that the data set itself names may run.
    **stated
        With data frames: options as of ``wearscope new dataset``, such as ``position_units=["deg"]``,
        ``torque_constant=[0.1]`` or ``test=["run2"]``.

    Returns
    -------
    DiagnosisResult

    Raises
    ------
    InputError
        Where the recordings do not have the required format.

    Examples
    --------
    >>> import wearscope
    >>> result = wearscope.diagnose(wearscope.example_dataset())  # doctest: +SKIP
    >>> result.summary()  # doctest: +SKIP
    >>> axes = result.plot("errors")  # doctest: +SKIP
    """
    from wearscope.closed_loop.diagnosis import diagnose as close_loop

    with take_recordings(recordings, urdf, **stated) as folder:
        return DiagnosisResult(close_loop(folder, progress=progress, effects=effects, allow_code=allow_code))


def track(
    recordings: str | Path | Frames,
    urdf: str | Path | None = None,
    *,
    reference: Sequence[str] = (),
    folder: str | Path | None = None,
    progress: Say = _quiet,
    allow_code: bool = False,
    **stated: Any,
) -> TrackingResult:
    """Find what changed on a robot since the sessions in which it was healthy.

    Parameters
    ----------
    recordings, urdf, progress, allow_code, **stated
        As for `diagnose`.
    reference : sequence of str
        With data frames: names of the healthy sessions. Each run is a session named after it, unless
        ``sessions`` gives labels by file name.
    folder : path-like, optional
        Folder for the files of the tracking; by default they are not kept.

    Returns
    -------
    TrackingResult

    Raises
    ------
    InputError
        Where there is no reference, or the recordings do not have the required format.
    """
    from wearscope.tracking.run import track as follow

    with (
        take_recordings(recordings, urdf, reference, **stated) as data,
        tempfile.TemporaryDirectory() as place,
    ):
        out = Path(folder) if folder is not None else Path(place)
        content = follow(data, out, progress=progress, allow_code=allow_code)
        return TrackingResult(content, read_table(out / "changes.parquet"))


def detect(
    recordings: str | Path | Frames,
    urdf: str | Path | None = None,
    *,
    model: str | Path,
    detectors: Mapping[str, str] | None = None,
    runs: int = 400,
    progress: Say = _quiet,
    allow_code: bool = False,
    **stated: Any,
) -> DetectionResult:
    """Judge recordings by detectors, whose thresholds come from simulations of the robot's model.

    Parameters
    ----------
    recordings, urdf, progress, allow_code, **stated
        As for `diagnose`.
    model : path-like
        The robot's model, such as ``model_after.yaml`` of a diagnosis.
    detectors : mapping of str to str, optional
        Module of `wearscope.detectors`, or path of a .py file, by the detector's name; by default
        ``friction_fit``.
    runs : int
        Number of simulated runs for each motion.

    Returns
    -------
    DetectionResult

    Raises
    ------
    InputError
        Where recordings, model and detectors do not fit together.
    """
    from wearscope.detection.judgement import judge_recordings
    from wearscope.detection.run import Setting, ask_recordings

    named = detectors or {"C": "friction_fit"}
    specs = [DetectorSpec(name, use, {}) for name, use in named.items()]
    setting = Setting(runs=runs)
    with take_recordings(recordings, urdf, **stated) as folder:
        tested = ask_recordings(folder, model, specs, PAPER_FACTORS, setting, progress, allow_code)
        return DetectionResult(judge_recordings(tested, setting))


def evaluate(
    model: str | Path,
    recordings: str | Path | Frames,
    urdf: str | Path | None = None,
    *,
    temperature: float = float("nan"),
    progress: Say = _quiet,
    allow_code: bool = False,
    **stated: Any,
) -> EvaluationResult:
    """Compute how well a model predicts recordings; nothing is fitted to them.

    Parameters
    ----------
    model : path-like
        A robot by name or path, or a model that a diagnosis wrote.
    recordings, urdf, progress, allow_code, **stated
        As for `diagnose`.
    temperature : float
        Joint temperature where it was not recorded [deg C].

    Returns
    -------
    EvaluationResult

    Raises
    ------
    InputError
        Where the recordings are of other joints, or nothing can be simulated.
    """
    from wearscope.notebook.model_errors import evaluate_model
    from wearscope.robots.model import load_model

    loaded = load_model(model, strict=False, allow_code=allow_code)
    with take_recordings(recordings, urdf, **stated) as folder:
        return EvaluationResult(evaluate_model(loaded, folder, progress, temperature))


def check_options(call: str, given: Mapping[str, Any], known: Sequence[str]) -> None:
    """Refuse an option that a function does not have.

    Raises
    ------
    InputError
        Names the option and those that exist.
    """
    for name in given:
        if name not in known:
            raise InputError(f"{call}: has no option '{name}'; it has {', '.join(sorted(known))}.")


@contextmanager
def take_recordings(
    recordings: str | Path | Frames,
    urdf: str | Path | None,
    reference: Sequence[str] = (),
    **stated: Any,
) -> Iterator[Path]:
    """Yield the folder of a data set: the given one, or a temporary folder made from data frames.

    Parameters
    ----------
    recordings : path-like, DataFrame, or sequence or mapping of DataFrame
        Columns are guessed as by ``wearscope new dataset``. Of several runs the last only tests the model,
        unless ``test`` names others. The runs of a sequence are called ``run1``, ``run2``, ...
    urdf : path-like or None
        URDF of the robot; needed with data frames.
    reference : sequence of str
        Sessions in which the machine was healthy; each run is a session named after it, unless ``sessions``
        gives labels.
    **stated
        Fields of `wearscope.starters.mapped.Mapped`.

    Raises
    ------
    InputError
        Where there is nothing to read, or the data frames cannot be understood.
    """
    if isinstance(recordings, str | Path):
        if urdf is not None or stated or reference:
            raise InputError(f"{recordings}: a folder says all of that itself; give data frames with a URDF.")
        yield Path(recordings)
        return
    frames = _name_frames(recordings)
    if urdf is None:
        raise InputError("recordings: data frames need the robot's URDF; give urdf='arm.urdf'.")
    check_options("recordings", stated, [field.name for field in fields(Mapped)])
    with tempfile.TemporaryDirectory() as place:
        files = []
        for name, frame in frames.items():
            files.append(Path(place) / f"{name}.parquet")
            frame.to_parquet(files[-1], index=False)
        mapped = Mapped(**stated, reference=reference)
        folder = Path(place) / "recordings"
        folder.mkdir()
        write_dataset(folder, "recordings", Path(urdf), convert_recordings(files, Path(urdf), mapped), mapped)
        yield folder


def _name_frames(recordings: Frames) -> dict[str, pd.DataFrame]:
    """Return data frames by the names of their runs.

    Raises
    ------
    InputError
        Where there are none, or something else is given.
    """
    if isinstance(recordings, pd.DataFrame):
        recordings = [recordings]
    if not isinstance(recordings, Mapping):
        if not isinstance(recordings, Sequence):
            kind = type(recordings).__name__
            raise InputError(f"recordings: a {kind} is none; give a folder, or data frames and a URDF.")
        recordings = {f"run{k}": frame for k, frame in enumerate(recordings, start=1)}
    for name, frame in recordings.items():
        if not isinstance(frame, pd.DataFrame):
            raise InputError(f"recordings: '{name}' is a {type(frame).__name__}; give a data frame.")
    if not recordings:
        raise InputError("recordings: there is none; give a folder, or data frames and a URDF.")
    return {str(name): frame for name, frame in recordings.items()}
