"""The study's detectors at every moving joint, fitted once and asked for each batch."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from wearscope import plugins
from wearscope.detectors.base import Batch, Detector, make_detector
from wearscope.detectors.questions import OK, Answer, DetectorSpec, ask_detector, tell_error
from wearscope.robots.model import RobotModel

#: Joint and name of a detector.
Cell = tuple[str, str]


@dataclass
class Panel:
    """Detectors fitted to the same nominal batches.

    Attributes
    ----------
    fitted : dict
        Detector by joint and name.
    unfitted : dict
        Why a detector could not be fitted, by joint and name.
    """

    fitted: dict[Cell, Detector] = field(default_factory=dict)
    unfitted: dict[Cell, str] = field(default_factory=dict)

    def ask(self, batch: Batch) -> dict[Cell, Answer]:
        """Test quantity and status by joint and detector; NaN where a detector fails."""
        answers = {cell: (math.nan, f"cannot be fitted: {told}") for cell, told in self.unfitted.items()}
        for (joint, name), detector in self.fitted.items():
            answers[joint, name] = ask_detector(detector, batch, f"fda '{name}', joint '{joint}'")
        return answers


def fit_panel(
    specs: Sequence[DetectorSpec],
    joints: Mapping[str, int],
    nominal: Sequence[Batch],
    model: RobotModel,
) -> Panel:
    """Fit every detector at every joint.

    Parameters
    ----------
    specs : sequence of DetectorSpec
    joints : mapping of str to int
        Column of each joint to test.
    nominal : sequence of Batch
    model : RobotModel

    Raises
    ------
    InputError
        Where a detector cannot be made; one that cannot be fitted is left out, with its reason.
    """
    panel = Panel()
    factories = [plugins.load(spec.reference, "detectors", "DETECTOR") for spec in specs]
    for joint, column in joints.items():
        for spec, factory in zip(specs, factories, strict=True):
            detector = make_detector(factory, spec.reference, spec.options)
            try:
                detector.fit(nominal, column, model)
            except (Exception, SystemExit) as error:
                panel.unfitted[joint, spec.name] = tell_error(error)
            else:
                panel.fitted[joint, spec.name] = detector
    return panel


def read_units(panel: Panel, torque_units: Mapping[str, str]) -> dict[Cell, str]:
    """Unit of each test quantity: the detector's own `unit`, with ``torque`` for the joint's; else empty."""
    units = {}
    for (joint, name), detector in panel.fitted.items():
        unit = str(getattr(detector, "unit", ""))
        units[joint, name] = torque_units[joint] if unit == "torque" else unit
    return units


__all__ = ["OK", "Cell", "Panel", "fit_panel", "read_units"]
