"""Whether a study's tables are the same bytes on two versions of Python; where not, how much they differ.

    .venv/bin/python -m benchmarks.python_versions PYTHON OTHER_PYTHON --out DIR

Both interpreters have the locked packages (`make setup VENV=... PYTHON=...`) and run this clone's workflow.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]


def run_study(python: Path, config: Path, folder: Path, cores: int) -> Path:
    """Run a study with an interpreter; return the folder of its results."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [python.absolute(), "-m", "snakemake", "--snakefile", ROOT / "Snakefile", "--directory", folder]
    command += ["--configfile", config.resolve(), "--cores", str(cores), "--quiet", "all"]
    subprocess.run([str(one) for one in command], check=True)
    (made,) = (one for one in (folder / "results").iterdir() if (one / "surrogates.parquet").exists())
    return made


def measure_difference(one: pd.DataFrame, other: pd.DataFrame) -> pd.Series:
    """Largest difference of each column that differs, of its largest size; NaN where it is no number."""
    if one.shape != other.shape or list(one.columns) != list(other.columns):
        return pd.Series({"rows or columns": np.nan})
    found = {}
    for name in one.columns:
        a, b = one[name], other[name]
        if a.equals(b):
            continue
        if not pd.api.types.is_numeric_dtype(a) or not (a.isna() == b.isna()).all():
            found[name] = np.nan
            continue
        found[name] = float((a - b).abs().max() / max(a.abs().max(), np.finfo(float).tiny))
    return pd.Series(found, dtype=float)


def compare_tables(first: Path, second: Path) -> pd.DataFrame:
    """One row for each column that differs, and for each table of the same bytes."""
    names = sorted({f.relative_to(top).as_posix() for top in (first, second) for f in top.rglob("*.parquet")})
    rows: list[tuple[str, str, float]] = []
    for name in names:
        if not ((first / name).exists() and (second / name).exists()):
            rows.append((name, "missing in one", np.nan))
        elif (first / name).read_bytes() == (second / name).read_bytes():
            rows.append((name, "", 0.0))
        else:
            found = measure_difference(pd.read_parquet(first / name), pd.read_parquet(second / name))
            rows += [(name, str(column), size) for column, size in found.items()] or [
                (name, "bytes alone", 0.0)
            ]
    return pd.DataFrame(rows, columns=["table", "column", "difference"])


def main() -> int:
    """Run both studies and say what differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pythons", nargs=2, type=Path, metavar="PYTHON")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--config", type=Path, default=ROOT / "config" / "quick.yaml")
    parser.add_argument("--cores", type=int, default=2)
    given = parser.parse_args()
    made = [
        run_study(python, given.config, given.out / str(k), given.cores)
        for k, python in enumerate(given.pythons)
    ]
    found = compare_tables(*made)
    same = found["column"] == ""
    print(f"{same.sum()} of {found['table'].nunique()} tables are the same bytes.")
    if not same.all():
        print(found[~same].to_string(index=False))
    return 0 if same.all() else 1


if __name__ == "__main__":
    sys.exit(main())
