"""A small study, packed; archives and manifests written by hand, sound or not."""

import hashlib
import io
import tarfile

import pandas as pd

from wearscope.archive import packing
from wearscope.storage import tables

#: Represents the code that made a study.
CODE = [__file__]


def make_study(folder, shift=0.0):
    table = pd.DataFrame({"point": [1, 2, 3], "fda": ["A", "A", "B"], "y": [1.0, 2.0 + shift, float("nan")]})
    tables.write_table(folder / "test_quantities.parquet", table, {"y": "1"})
    tables.write_text(folder / "report.html", "<p>report</p>")
    tables.write_text(folder / "logs" / "a.log", f"took {shift}")
    return sorted(file for file in folder.rglob("*") if file.is_file())


def pack(tmp_path, name, shift=0.0, config=None):
    folder = tmp_path / name
    files = make_study(folder, shift)
    path = tmp_path / f"{name}.tar"
    packing.pack_study(path, folder, files, config or {"study": "tiny", "seed": 0}, CODE)
    return path


def write(path, *members):
    with tarfile.open(path, "w") as tar:
        for member in members:
            name, content = member if isinstance(member, tuple) else (member, b"")
            if not isinstance(name, tarfile.TarInfo):
                name = tarfile.TarInfo(name)
                name.size = len(content)
            tar.addfile(name, io.BytesIO(content))


def make_manifest(**changes):
    fields = {
        "format": 1,
        "study": "tiny",
        "config": {},
        "python": "3.11.7",
        "packages": {},
        "code": {"wearscope": "0.1.0", "commit": None, "changed": False, "sha256": "0" * 64, "files": {}},
        "files": {"a": {"sha256": hashlib.sha256(b"x").hexdigest(), "bytes": 1}},
    }
    fields |= changes
    return {key: value for key, value in fields.items() if value is not Ellipsis}
