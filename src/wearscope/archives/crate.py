"""RO-Crate metadata of an archive: what each file is, and what the study was made with.

RO-Crate: Soiland-Reyes et al., "Packaging research artefacts with RO-Crate", Data Science 5(2), 2022.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote

from wearscope.archives.manifest import CONFIG, FileEntry

VERSION = "https://w3id.org/ro/crate/1.3"
METADATA = "ro-crate-metadata.json"
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
    root = {
        "name": f"wearscope study {study}",
        "description": (
            "A simulation-based evaluation of fault detectors: configuration, design, recordings, test "
            "quantities, surrogates, results and report."
        ),
        "datePublished": date,
        "license": LICENSE,
        "hasPart": _refer(files),
    }
    about = {"about": {"@id": "./"}, "conformsTo": {"@id": VERSION}}
    code = made["code"]
    packages = {name: version for name, version in made["packages"].items() if name != "wearscope"}
    software = {
        "name": "wearscope",
        "softwareVersion": code["wearscope"],
        "version": code["commit"] or "unknown",
        "sha256": code["sha256"],
        "softwareRequirements": [{"@id": f"#package/{name}"} for name in ("python", *packages)],
    }
    design = [name for name in files if name.startswith("design/")]
    run = {
        "name": f"snakemake --configfile {CONFIG}",
        "instrument": {"@id": "#wearscope"},
        "object": [*_refer([CONFIG]), *_refer(design), *({"@id": f"#input/{one}"} for one in sorted(inputs))],
        "result": _refer(set(files) - {CONFIG, *design}),
    }
    graph = [
        _entity("./", "Dataset", **root),
        _entity(METADATA, "CreativeWork", **about),
        *(
            _entity(
                quote(name),
                "File",
                name=PurePosixPath(name).name,
                sha256=files[name].sha256,
                contentSize=str(files[name].bytes),
                encodingFormat=_KINDS.get(PurePosixPath(name).suffix, "application/octet-stream"),
            )
            for name in sorted(files)
        ),
        _entity("#wearscope", "SoftwareApplication", **software),
        *(
            _entity(f"#package/{name}", "SoftwareApplication", name=name, softwareVersion=version)
            for name, version in {"python": made["python"], **packages}.items()
        ),
        *(
            _entity(f"#input/{name}", "CreativeWork", name=name, sha256=digest)
            for name, digest in sorted(inputs.items())
        ),
        _entity("#study", "CreateAction", **run),
    ]
    crate = {"@context": f"{VERSION}/context", "@graph": graph}
    return (json.dumps(crate, indent=1, sort_keys=True) + "\n").encode()


def _entity(identifier: str, kind: str, **fields: Any) -> dict[str, Any]:
    return {"@id": identifier, "@type": kind, **fields}


def _refer(files: Iterable[str]) -> list[dict[str, str]]:
    return [{"@id": quote(name)} for name in sorted(files)]
