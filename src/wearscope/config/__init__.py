"""The configuration of a study, validated; the text under each field is its reference manual."""

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
