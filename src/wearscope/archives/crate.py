"""RO-Crate metadata of an archive: what each file is, and what the study was made with.

RO-Crate: Soiland-Reyes et al., "Packaging research artefacts with RO-Crate", Data Science 5(2), 2022.
"""

import json
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any

from rocrate.model.contextentity import ContextEntity
from rocrate.model.file import File
from rocrate.rocrate import ROCrate

from wearscope.archives.manifest import CONFIG, FileEntry

LICENSE = "https://spdx.org/licenses/MIT"
_KINDS = {
    ".parquet": "application/vnd.apache.parquet",
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".urdf": "application/xml",
    ".tsv": "text/tab-separated-values",
    ".log": "text/plain",
}


def describe_crate(
    study: str, date: str, made: Mapping[str, Any], inputs: Mapping[str, str], files: Mapping[str, FileEntry]
) -> bytes:
    """Content of ``ro-crate-metadata.json``; equal arguments give equal bytes.

    Parameters
    ----------
    study : str
    date : str
        ISO 8601.
    made : mapping
        See `wearscope.provenance.describe_provenance`.
    inputs : mapping of str to str
        Digest by path of the user's own files, which the archive does not hold.
    files : mapping of str to FileEntry
        The archive's files.
    """
    crate = ROCrate()
    crate.name = f"wearscope study {study}"
    crate.description = (
        "A simulation-based evaluation of fault detectors: configuration, design, recordings, test "
        "quantities, surrogates, results and report."
    )
    crate.datePublished = date
    crate.license = LICENSE
    for name in sorted(files):
        fields = {
            "name": PurePosixPath(name).name,
            "sha256": files[name].sha256,
            "contentSize": str(files[name].bytes),
            "encodingFormat": _KINDS.get(PurePosixPath(name).suffix, "application/octet-stream"),
        }
        crate.add(File(crate, None, name, properties=fields))
    code = made["code"]
    packages = {name: version for name, version in made["packages"].items() if name != "wearscope"}
    crate.add(
        _entity(
            crate,
            "#wearscope",
            "SoftwareApplication",
            name="wearscope",
            softwareVersion=code["wearscope"],
            version=code["commit"] or "unknown",
            sha256=code["sha256"],
            softwareRequirements=[
                {"@id": "#package/python"},
                *({"@id": f"#package/{name}"} for name in packages),
            ],
        )
    )
    for name, version in {"python": made["python"], **packages}.items():
        crate.add(
            _entity(crate, f"#package/{name}", "SoftwareApplication", name=name, softwareVersion=version)
        )
    for name, digest in sorted(inputs.items()):
        crate.add(_entity(crate, f"#input/{name}", "CreativeWork", name=name, sha256=digest))
    design = [name for name in sorted(files) if name.startswith("design/")]
    crate.add(
        _entity(
            crate,
            "#study",
            "CreateAction",
            name=f"snakemake --configfile {CONFIG}",
            instrument={"@id": "#wearscope"},
            object=[{"@id": name} for name in [CONFIG, *design]]
            + [{"@id": f"#input/{name}"} for name in sorted(inputs)],
            result=[{"@id": name} for name in sorted(files) if name not in (CONFIG, *design)],
        )
    )
    return (json.dumps(crate.metadata.generate(), indent=1, sort_keys=True) + "\n").encode()


def _entity(crate: ROCrate, identifier: str, kind: str, **fields: Any) -> ContextEntity:
    return ContextEntity(crate, identifier, properties={"@type": kind, **fields})
