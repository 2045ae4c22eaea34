"""A data set that is read, changed and written again."""

import copy
from pathlib import Path

import numpy as np
import yaml

from wearscope.storage.tables import read_table


def find_datasets(folders):
    """Data sets in folders, and in all folders within them."""
    return [file.parent for folder in folders for file in sorted(folder.rglob("dataset.yaml"))]


class Recorded:
    """A data set: `fields` of its dataset.yaml, names of its `joints`, and `tables` by file."""

    def __init__(self, place):
        self.fields = yaml.safe_load((place / "dataset.yaml").read_text(encoding="utf-8"))
        self.place, self.joints = place, self.fields["robot"]["joints"]
        self.tables = {run["file"]: read_table(place / run["file"]) for run in self.fields["runs"]}

    def pool(self, name):
        """A column (N,) of all runs."""
        return np.concatenate([table[name] for table in self.tables.values()])

    def change(self, change):
        """Another with each table changed by `change(table)`, or in its place what that returns."""
        other = copy.copy(self)
        other.tables = {}
        for file, table in self.tables.items():
            new = table.copy()
            changed = change(new)
            other.tables[file] = new if changed is None else changed
        return other

    def write(self, place):
        """Write it with the runs that its fields list, and return the folder."""
        fields = copy.deepcopy(self.fields)
        urdf = (self.place / fields["robot"]["urdf"]).read_bytes()
        fields["robot"]["urdf"] = "robot.urdf"
        for run in fields["runs"]:
            file = Path(run["file"]).with_suffix(".parquet")
            (place / file).parent.mkdir(parents=True, exist_ok=True)
            self.tables[run["file"]].to_parquet(place / file, index=False)
            run["file"] = str(file)
        (place / "robot.urdf").write_bytes(urdf)
        (place / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False), encoding="utf-8")
        return place
