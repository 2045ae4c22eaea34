"""What the workflow's jobs do not load: each import is paid by every process that makes it."""

import importlib.metadata
import json
import subprocess
import sys

import pytest

from wearscope.provenance import describe_provenance


@pytest.mark.parametrize(
    ("imported", "spared"),
    [
        ("wearscope.detectors.friction_fit", ["scipy.signal", "scipy.stats", "scipy.interpolate"]),
        ("wearscope.detectors.wear_temperature_fit", ["scipy.signal", "scipy.stats"]),
        ("wearscope.surrogates.chosen", ["scipy.optimize", "sklearn"]),
        ("wearscope.reporting.figures.audit", ["seaborn", "statsmodels", "scipy.stats"]),
    ],
)
def test_what_only_some_jobs_use_is_not_imported_by_all(imported, spared):
    code = f"import json, sys, {imported}; print(json.dumps([one for one in {spared} if one in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


def test_packages_are_those_that_python_imports_each_read_once(tmp_path, monkeypatch):
    for folder, version in (("first", "1.0"), ("second", "2.0")):
        info = tmp_path / folder / "twice-0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: Twice\nVersion: {version}\n")
    there = [str(tmp_path / "first"), str(tmp_path / "second")]
    monkeypatch.setattr(sys, "path", [*there, *sys.path, *there, *sys.path])
    read = []
    whole = importlib.metadata.PathDistribution.read_text

    def count(self, name):
        read.append((str(self._path), name))
        return whole(self, name)

    monkeypatch.setattr(importlib.metadata.PathDistribution, "read_text", count)
    packages = describe_provenance([])["packages"]
    opened = [path for path, name in read if name == "METADATA" and "twice" not in path]
    assert packages["twice"] == "1.0" == importlib.metadata.version("twice")
    assert max(map(opened.count, opened)) <= 2  # once here, once for the version of this package
