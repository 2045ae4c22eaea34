"""`diagnose`, `track`, `detect` and `evaluate`: each takes a folder, or data frames and the robot's URDF."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from wearscope.designs.factors import PAPER_FACTORS
from wearscope.detectors.questions import DetectorSpec
from wearscope.notebook.results import (
    DetectionResult,
    DiagnosisResult,
    EvaluationResult,
    TrackingResult,
    read_changes,
)
from wearscope.notebook.taken import Frames, take_recordings

Say = Callable[[str], None]


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
        return TrackingResult(content, read_changes(out))


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
