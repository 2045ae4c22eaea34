"""What tracking left in its folder, as a page asks for it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from wearscope import tables
from wearscope.errors import InputError


@dataclass(frozen=True)
class Tracking:
    """Outcome of tracking one machine: ``tracking.json`` and ``changes.parquet``."""

    outcome: Mapping[str, Any]
    changes: pd.DataFrame

    @property
    def joints(self) -> list[str]:
        """Joint names, in the data set's order."""
        return list(self.outcome["healthy"]["temperatures"])

    @property
    def sessions(self) -> list[str]:
        """Healthy sessions, held out, then the later ones."""
        healthy = self.changes.loc[self.changes["healthy"], "session"]
        return [*dict.fromkeys(healthy), *(one["session"] for one in self.outcome["sessions"])]

    def entries(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Session and entry of every change."""
        return [(one["session"], entry) for one in self.outcome["sessions"] for entry in one["changes"]]

    def rows(self, joint: str, effect: str, parameter: str) -> pd.DataFrame:
        """Rows of one parameter of a joint, a session each, in order."""
        table = self.changes
        own = table[
            (table["joint"] == joint) & (table["effect"] == effect) & (table["parameter"] == parameter)
        ]
        return own.drop_duplicates("session").set_index("session").reindex(self.sessions)


def read_tracking(folder: str | Path) -> Tracking:
    """Read what tracking wrote.

    Raises
    ------
    InputError
        Where ``tracking.json`` or ``changes.parquet`` is missing or damaged.
    """
    path = Path(folder) / "tracking.json"
    try:
        outcome = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: is missing or no JSON; track the machine first.") from error
    return Tracking(outcome, tables.read_table(Path(folder) / "changes.parquet"))
