"""Describes what made a result: versions of the code, of Python and of every installed package."""

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
    """Return the versions of code and packages.

    Parameters
    ----------
    sources : iterable of path-like
        Source files.

    Returns
    -------
    dict
        ``python`` (version), ``packages`` (version by name) and ``code``. The latter holds ``wearscope``
        (version), ``commit`` and its ``date`` (None without git), ``changed`` (whether tracked files differ
        from the commit), ``sha256`` (of all sources together) and ``files`` (SHA-256 by source).
    """
    files = {Path(source).as_posix(): digest_file(Path(source)) for source in sources}
    text = "".join(f"{digest}  {name}\n" for name, digest in sorted(files.items()))
    packages: dict[str, str] = {}
    # The module path of a script may hold a folder several times, and a package may be in several folders.
    # Python imports the first, so the first version counts.
    for one in metadata.distributions(path=list(dict.fromkeys(sys.path))):
        fields = one.metadata  # the property reads the file at each access
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
    """List the platform's source files, sorted, relative to the working folder, the repository's root."""
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
    """Return the commit of the platform's checkout; None outside a git checkout."""
    return _git("rev-parse", "HEAD")


def name_version() -> str:
    """Return the platform's version and commit in words."""
    return f"{metadata.version('wearscope')} ({read_commit() or 'commit not known'})"


def _git(*arguments: str) -> str | None:
    """Return git's output in the platform's checkout, or None if git fails.

    Git runs nowhere else: the settings of an unknown folder could make it run a program.
    """
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
