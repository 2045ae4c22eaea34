"""What the workflow's jobs do not load: each import is paid by every process that makes it."""

import json

import pytest
from calls import call_python


@pytest.mark.parametrize(
    ("imported", "spared"),
    [
        ("wearscope.detectors.friction_fit", ["scipy.signal", "scipy.stats", "scipy.interpolate"]),
        ("wearscope.detectors.wear_temperature_fit", ["scipy.signal", "scipy.stats"]),
        ("wearscope.surrogates.chosen", ["scipy.optimize"]),
    ],
)
def test_what_only_some_jobs_use_is_not_imported_by_all(imported, spared):
    code = f"import json, sys, {imported}; print(json.dumps([one for one in {spared} if one in sys.modules]))"
    assert json.loads(call_python("-c", code).stdout) == []


COUNT_READS = """
import importlib.metadata, json, sys
there = sys.argv[1:]
sys.path = [*there, *sys.path, *there, *sys.path]
read, whole = [], importlib.metadata.PathDistribution.read_text

def count(self, name):
    read.append((str(self._path), name))
    return whole(self, name)

importlib.metadata.PathDistribution.read_text = count
from wearscope.storage.provenance import describe_provenance
version = describe_provenance([])["packages"]["twice"]
opened = [path for path, name in read if name == "METADATA" and "twice" not in path]
print(json.dumps([version, importlib.metadata.version("twice"), max(map(opened.count, opened))]))
"""


def test_packages_are_those_that_python_imports_each_read_once(tmp_path):
    for folder, version in (("first", "1.0"), ("second", "2.0")):
        info = tmp_path / folder / "twice-0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: Twice\nVersion: {version}\n")
    told = call_python("-c", COUNT_READS, tmp_path / "first", tmp_path / "second").stdout
    ours, python, most = json.loads(told)
    assert ours == python == "1.0"
    assert most <= 2  # once here, once for the version of this package
