"""`diagnose`, `track`, `detect` and `evaluate`: each takes a folder, or data frames and the robot's URDF."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from wearscope.designs.factors import PAPER_FACTORS
from wearscope.detectors.questions import DetectorSpec
from wearscope.errors import InputError
from wearscope.notebook.results import DetectionResult, DiagnosisResult, EvaluationResult, TrackingResult
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.dataset import write_dataset
from wearscope.starters.mapped import Mapped
from wearscope.storage.tables import read_table

Say = Callable[[str], None]
#: Data frames by the names that their runs get.
Frames: TypeAlias = pd.DataFrame | Sequence[pd.DataFrame] | Mapping[str, pd.DataFrame]


def _quiet(line: str) -> None:
    """Say nothing."""


def diagnose(
    recordings: str | Path | Frames,
    urdf: str | Path | None = None,
    *,
    progress: Say = _quiet,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
    **stated: Any,
) -> DiagnosisResult:
    """Name what the model of a measured robot lacks, correct it, and say how sure that is.

    Parameters
    ----------
    recordings : path-like, DataFrame, or sequence or mapping of DataFrame
        A data set's folder, or recordings with time, positions [rad] and torques [N m] of the joints.
    urdf : path-like, optional
        Of the robot; needed with data frames.
    progress : callable
        Called with a line of text at each step, e.g. ``print``.
    effects : sequence of path-like
        Files of own effects.
    allow_code : bool
        Whether effect files that the data set itself names may run.
    **stated
        With data frames: what ``wearscope new dataset`` takes, such as ``position_units=["deg"]``,
        ``torque_constant=[0.1]`` or ``test=["run2"]``.

    Returns
    -------
    DiagnosisResult

    Raises
    ------
    InputError
        Where the recordings break the format, in one sentence.

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
    """Say what changed on a robot since the sessions in which it was healthy.

    Parameters
    ----------
    recordings, urdf, progress, allow_code, **stated
        As of `diagnose`.
    reference : sequence of str
        With data frames: names of the healthy sessions. A run is a session of its name, unless ``sessions``
        gives labels by file name.
    folder : path-like, optional
        Where the files of the tracking are written; nowhere where left out.

    Returns
    -------
    TrackingResult

    Raises
    ------
    InputError
        Where there is no reference, or the recordings break the format.
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
    """Judge recordings by detectors, whose thresholds come from the robot's own simulated model.

    Parameters
    ----------
    recordings, urdf, progress, allow_code, **stated
        As of `diagnose`.
    model : path-like
        The robot's model, such as ``model_after.yaml`` of a diagnosis.
    detectors : mapping of str to str, optional
        Module of `wearscope.detectors`, or path of a .py file, by letter; ``friction_fit`` where left out.
    runs : int
        Simulated runs a motion.

    Returns
    -------
    DetectionResult

    Raises
    ------
    InputError
        Where the recordings, the model or a detector do not fit.
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
    """Say how well a model predicts recordings; nothing is fitted to them.

    Parameters
    ----------
    model : path-like
        A robot by name or path, or a model that a diagnosis wrote.
    recordings, urdf, progress, allow_code, **stated
        As of `diagnose`.
    temperature : float
        Of the joints where it was not recorded [deg C].

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
    """Refuse an option that a call does not have.

    Raises
    ------
    InputError
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
    """Folder of a data set: the named one, or a temporary folder made from data frames.

    Parameters
    ----------
    recordings : path-like, DataFrame, or sequence or mapping of DataFrame
        Columns are guessed as by ``wearscope new dataset``. Of several runs the last is only scored, unless
        ``test`` names others; runs of a sequence are called ``run1``, ``run2``, ...
    urdf : path-like or None
        Of the robot; needed with data frames.
    reference : sequence of str
        Sessions in which the machine was healthy; each run is a session of its name where ``sessions`` does
        not say otherwise.
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
    """Data frames by name.

    Raises
    ------
    InputError
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
