"""Compares two studies: settings, versions, tables and conclusions."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd

from wearscope.archive.packing import MADE, MANIFEST, Manifest, parse_manifest, read_member, walk_archive
from wearscope.errors import InputError
from wearscope.storage import tables
from wearscope.storage.files import SETTINGS, check_shown, digest_file, load_json
from wearscope.storage.verdicts import check_verdict


def _tell_rank(row: Mapping[str, Any]) -> str:
    """Describe a detector's rank with its interval; a detector without rank is only an upper bound."""
    if pd.isna(row["rank"]):
        return "upper bound"
    # `float` refuses a date, which would accept any format specification and print it.
    ends = (float(row[one]) for one in ("rank", "rank_low", "rank_high"))
    return "rank {:g} ({:g} to {:g})".format(*ends)


#: Who supports the result of an audit, by whether surrogate and direct simulation agree.
_AGREEING = {True: "simulation and surrogate", False: "simulation alone"}


def _tell_audit(row: Mapping[str, Any]) -> str:
    """Describe an audit's result: whether the detector passes in direct simulation, and who agrees."""
    passes = {True: "passes", False: "fails"}[row["passes_direct"]]
    return f"{passes} by {_AGREEING[row['agrees']]}"


#: For each table of conclusions: its file, the columns that identify a conclusion, the columns with its
#: content, and the function that words it.
_CONCLUSIONS: tuple[tuple[str, list[str], list[str], Callable[[Mapping[str, Any]], str]], ...] = (
    ("findings.parquet", ["question", "paper"], ["verdict"], lambda row: str(row["verdict"])),
    ("ranking.parquet", ["fda"], ["rank", "rank_low", "rank_high"], _tell_rank),
    (
        "audit_verdicts.parquet",
        ["robot", "cycle", "axis", "fda", "factor"],
        ["passes_direct", "agrees"],
        _tell_audit,
    ),
)


def list_results(folder: str | Path) -> list[Path]:
    """List the files of results in a study's folder, without hidden files and those that packing makes."""
    folder = Path(folder)
    found = []
    for file in sorted(folder.rglob("*")):
        parts = file.relative_to(folder).parts
        hidden = any(part[0] in ".-" for part in parts)
        if not hidden and "__pycache__" not in parts and parts[0] not in MADE and file.is_file():
            found.append(file)
    return found


def compare_contents(
    left: "Content", right: "Content", name_detector: Callable[[str, str], str] = lambda code, use: code
) -> pd.DataFrame:
    """Compare two studies.

    Parameters
    ----------
    left, right : Content
    name_detector : callable
        Returns a detector's name in conclusions, given its code and its setting ``use``.

    Returns
    -------
    DataFrame
        A row for each setting, package, code version, conclusion or file that differs, and for each table
        that is the same. Columns: ``item``, ``what`` (``setting``, ``version``, ``conclusion``, ``table``,
        ``file``), ``outcome`` (``same bytes``, ``same values``, ``differs``, ``only in a``, ``only in b``)
        and ``detail``. Logs and timings are left out.
    """
    rows = []
    for what, key in (("setting", "config"), ("version", "packages"), ("version", "code")):
        one, other = left.describe(key), right.describe(key)
        if one and other:  # without a record on one side there is nothing to compare
            rows += _compare_mappings(one, other, what, "")
    rows += _compare_conclusions(left, right, name_detector)
    for name in sorted(set(left.digests) | set(right.digests)):
        if name.startswith(("logs/", "benchmarks/")) or name in MADE:
            continue
        what = "table" if name.endswith(".parquet") else "file"
        detail = ""
        if name not in right.digests or name not in left.digests:
            outcome = "only in a" if name in left.digests else "only in b"
        elif left.digests[name] == right.digests[name]:
            if what == "file":
                continue
            outcome = "same bytes"
        elif what == "file":
            outcome = "differs"
        else:
            detail = compare_tables(left.table(name), right.table(name))
            outcome = "differs" if detail else "same values"
        rows.append({"item": name, "what": what, "outcome": outcome, "detail": detail})
    return pd.DataFrame(rows, columns=["item", "what", "outcome", "detail"])


class Content:
    """An archive or a folder of results, read one file at a time.

    Attributes
    ----------
    digests : dict
        SHA-256 of each file, by its path in the study.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.manifest: Manifest | None = None
        if self.path.is_dir():
            files = list_results(self.path)
            for file in files:
                if file.suffix == ".parquet":
                    tables.check_unpacked(file)  # before the whole file is read for its digest
            self.digests = {file.relative_to(self.path).as_posix(): digest_file(file) for file in files}
            if (self.path / MANIFEST).is_file():
                self.manifest = parse_manifest((self.path / MANIFEST).read_bytes(), str(self.path))
        else:
            self.manifest = walk_archive(self.path)
            self.digests = {name: entry.sha256 for name, entry in self.manifest.files.items()}

    def describe(self, key: str) -> dict[str, Any]:
        """Return a section of the manifest; for a folder without manifest, its settings or an empty dict."""
        if self.manifest is not None:
            return self.manifest.model_dump(mode="json")[key]
        settings = self.path / SETTINGS
        if key != "config" or not settings.is_file():
            return {}
        try:
            found = load_json(settings.read_bytes())
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise InputError(f"{settings}: holds no settings; delete it, or run the study again.")
        return found

    def find_setting(self, section: str, code: str, key: str) -> str | None:
        """Return a field of a detector or factor in the settings, as text; None if it is not there.

        `section` is "detectors" or "factors", `code` the name there. An entry that is no mapping is returned
        itself.
        """
        try:
            one = self.describe("config")[section][code]
            return str(one[key] if isinstance(one, Mapping) else one)
        except (KeyError, TypeError):
            return None

    def name_detector(self, code: str, name: Callable[[str, str], str]) -> str:
        """Return a detector's name; its code if the settings do not describe the detector."""
        use = self.find_setting("detectors", code, "use")
        return code if use is None else name(code, use)

    def read(self, name: str) -> bytes:
        """Return the content of a file."""
        if not self.path.is_dir():
            return read_member(self.path, name)
        check_shown(self.path / name)
        return (self.path / name).read_bytes()

    def table(self, name: str) -> pd.DataFrame:
        """Return the table in a Parquet file, once its size is checked."""
        where = f"{self.path}: {name}"
        content = self.read(name)
        tables.check_unpacked(content, where)
        return tables.to_frame(tables.read_arrow(content, name=where), where)


def _conclude(content: Content, name_detector: Callable[[str, str], str]) -> Iterator[tuple[str, str]]:
    """Yield the conclusions of a study as two texts: the subject, and what is concluded."""
    for name, keys, says, tell in _CONCLUSIONS:
        if name not in content.digests:
            continue
        table = content.table(name)
        missing = sorted({*keys, *says} - set(table.columns))
        if missing:
            raise InputError(
                f"{content.path}: {name}: has no column {missing[0]}; compare studies, not parts."
            )
        stem = PurePosixPath(name).stem
        for row in table[[*keys, *says]].to_dict("records"):
            try:
                said = tell(row)
            except (KeyError, TypeError, ValueError):
                told = f"{content.path}: {name}: a row holds no {' or '.join(says)}"
                raise InputError(f"{told}; run the study again.") from None
            named = {key: str(row[key]) for key in keys}
            if "factor" in named:
                described = content.find_setting("factors", named["factor"], "description")
                named["factor"] = described or named["factor"]
            if "fda" in named:
                named["fda"] = content.name_detector(named["fda"], name_detector)
            if "axis" in named:
                named["axis"] = f"axis {row['axis']}"
            yield f"{stem}: {', '.join(named.values())}", said
    for name in sorted(content.digests):
        if PurePosixPath(name).name == "verdict.json":
            yield from _conclude_loop(content, name)


def _conclude_loop(content: Content, name: str) -> Iterator[tuple[str, str]]:
    """Yield the conclusions of a closed loop, from its verdict: for each joint, the effects it names."""
    where = f"{content.path}: {name}"
    try:
        verdict = load_json(content.read(name))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: is no verdict ({type(error).__name__}); make it again.") from None
    named: dict[str, list[str]] = {joint: [] for joint in check_verdict(verdict, where)["joints"]}
    for entry in verdict["verdict"]:
        named.setdefault(entry["joint"], []).append(entry["effect"])
    for joint, effects in named.items():
        yield f"{PurePosixPath(name).parent}: {joint}", ", ".join(sorted(effects)) or "nothing named"


def _compare_conclusions(
    left: Content, right: Content, name_detector: Callable[[str, str], str]
) -> list[dict[str, str]]:
    """Return a row for each conclusion that differs, as in `compare_contents`."""
    a, b = (dict(_conclude(one, name_detector)) for one in (left, right))
    rows = []
    for item in [*a, *(one for one in b if one not in a)]:
        if a.get(item) != b.get(item):
            outcome = "only in a" if item not in b else "only in b" if item not in a else "differs"
            detail = f"{a.get(item, 'none')} against {b.get(item, 'none')}"
            rows.append({"item": item, "what": "conclusion", "outcome": outcome, "detail": detail})
    return rows


def _compare_mappings(a: Mapping[str, Any], b: Mapping[str, Any], what: str, prefix: str) -> list[dict]:
    """Return a row for each value that differs in two nested mappings, as in `compare_contents`."""
    rows: list[dict] = []
    for key in sorted(set(a) | set(b)):
        one, other = a.get(key), b.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            rows += _compare_mappings(one, other, what, f"{prefix}{key}.")
        elif one != other:
            detail = f"{one} against {other}"
            rows.append({"item": f"{prefix}{key}", "what": what, "outcome": "differs", "detail": detail})
    return rows


def compare_tables(a: pd.DataFrame, b: pd.DataFrame) -> str:
    """Describe how two tables differ, in words; return "" if all values are equal (NaN equals NaN).

    Parameters
    ----------
    a, b : DataFrame
        Their rows are compared in the given order.

    Returns
    -------
    str
        E.g. ``y: 12 of 90 rows, largest difference 0.3 (0.1 %)``. The percentage relates to the larger of
        the two values.
    """
    if list(a.columns) != list(b.columns):
        missing = sorted(set(a.columns) ^ set(b.columns))
        return f"columns differ: {', '.join(missing)}" if missing else "columns are in another order"
    if len(a) != len(b):
        return f"{len(a)} rows against {len(b)}"
    return "; ".join(filter(None, (_compare_column(name, a[name], b[name]) for name in a.columns)))


def _compare_column(name: str, a: pd.Series, b: pd.Series) -> str:
    """Describe how two columns differ, as in `compare_tables`."""
    numbers = all(
        pd.api.types.is_numeric_dtype(one) and not pd.api.types.is_bool_dtype(one) for one in (a, b)
    )
    if not numbers:
        different = np.array([_text(x) != _text(y) for x, y in zip(a, b, strict=True)], dtype=bool)
        return f"{name}: {int(different.sum())} of {len(a)} rows" if different.any() else ""
    x, y = a.to_numpy(dtype=float), b.to_numpy(dtype=float)
    same = (x == y) | (np.isnan(x) & np.isnan(y))
    if same.all():
        return ""
    where = f"{name}: {int((~same).sum())} of {len(a)} rows"
    both = ~same & np.isfinite(x) & np.isfinite(y)
    if not both.any():
        return where
    gap = np.abs(x[both] - y[both])
    largest = int(np.argmax(gap))
    scale = max(abs(x[both][largest]), abs(y[both][largest]))
    return f"{where}, largest difference {gap[largest]:.3g} ({100 * gap[largest] / scale:.2g} %)"


def _text(value: object) -> str:
    """Return a text that is equal for equal values; NumPy would shorten a long array's."""
    return np.array2string(value, threshold=1 << 30) if isinstance(value, np.ndarray) else repr(value)
