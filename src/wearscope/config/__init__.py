"""The validated configuration of a study; the text below each field is its entry in the reference manual."""

from wearscope.config.reading import drop_retired, list_breaches, load_config, make_schema
from wearscope.config.sections import TAKEN, CarryOverSettings, PartitionSettings, SimulationSettings
from wearscope.config.study import StudyConfig, label

__all__ = [
    "TAKEN",
    "CarryOverSettings",
    "PartitionSettings",
    "SimulationSettings",
    "StudyConfig",
    "drop_retired",
    "label",
    "list_breaches",
    "load_config",
    "make_schema",
]
