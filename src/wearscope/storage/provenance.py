"""With what a result was made: versions of the code, of Python and of every package."""

import hashlib
import platform
import subprocess
import sys
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from wearscope.home import find_home
from wearscope.storage.files import digest_file


def describe_provenance(sources: Iterable[str | Path]) -> dict[str, Any]:
    """Versions of code and packages.

    Parameters
    ----------
    sources : iterable of path-like
        Source files.

    Returns
    -------
    dict
        ``python``; ``packages`` (version by name); ``code``: ``wearscope`` (version), ``commit`` and its
        ``date`` (None where git knows none), ``changed`` (whether tracked files differ from it), ``sha256``
        (of all sources), ``files`` (digest by source).
    """
    files = {Path(source).as_posix(): digest_file(Path(source)) for source in sources}
    text = "".join(f"{digest}  {name}\n" for name, digest in sorted(files.items()))
    packages: dict[str, str] = {}
    # Once each, though a script's path may name a folder several times; the first is what Python imports.
    for one in metadata.distributions(path=list(dict.fromkeys(sys.path))):
        fields = one.metadata  # read anew at each use
        packages.setdefault(fields["Name"].lower(), fields["Version"])
    return {
        "python": platform.python_version(),
        "packages": dict(sorted(packages.items())),
        "code": {
            "wearscope": metadata.version("wearscope"),
            "commit": read_commit(),
            "date": _git("show", "--no-patch", "--format=%cI", "HEAD"),
            "changed": bool(_git("status", "--porcelain", "--untracked-files=no")),
            "sha256": hashlib.sha256(text.encode()).hexdigest(),
            "files": files,
        },
    }


def list_platform_files() -> list[Path]:
    """Source files of the whole platform, as paths from the repository's root, sorted."""
    patterns = (
        "Snakefile",
        "src/**/*.*",
        "workflow/**/*.*",
        "envs/*.*",
        "profiles/**/*.yaml",
        "pyproject.toml",
    )
    found = {file for pattern in patterns for file in Path().glob(pattern) if file.is_file()}
    left_out = {"__pycache__", "wearscope.egg-info"}
    return sorted(file for file in found if not left_out & set(file.parts))


def read_commit() -> str | None:
    """Commit of the checkout; None where there is none."""
    return _git("rev-parse", "HEAD")


def _git(*arguments: str) -> str | None:
    """Output of git in the platform's own checkout; another folder's git settings could run a program."""
    home = find_home()
    if not (home / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(home), *arguments], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
