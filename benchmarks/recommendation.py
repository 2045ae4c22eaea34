"""Whether a study's recommendation changes with its seed.

    python -m benchmarks.recommendation [CONFIG] [--seeds 10] [--cores 2] [--keep FOLDER]

CONFIG is a configuration; left out, the study of the tutorial (`wearscope new study`). Each seed draws other
points, other noise and other audited runs. Printed: a line a seed and robot, with the detector, in how many
resamplings and cells it comes out, what is withheld and how much was audited; then how many seeds differ from
the others, and whether these say so themselves (fewer than `SETTLED` of the resamplings).
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd
import yaml

from benchmarks.command import start_parser
from wearscope.evaluation.conclusion import Conclusion, read_conclusion
from wearscope.evaluation.ranking import SETTLED
from wearscope.home import find_home
from wearscope.starters.study import write_study


def run_seed(settings: dict, seed: int, cores: int, folder: Path) -> Iterator[tuple[Conclusion, int]]:
    """Conclusions of a study with a seed, and the number of values that were audited."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(settings | {"seed": seed}), encoding="utf-8")
    home = find_home()
    command = [sys.executable, "-m", "snakemake", "conclusion", "--snakefile", str(home / "Snakefile")]
    command += ["--profile", str(home / "profiles" / "default"), "--configfile", "config.yaml"]
    ended = subprocess.run(
        [*command, "--cores", str(cores)], cwd=folder, capture_output=True, text=True, check=False
    )
    if ended.returncode:
        sys.exit(f"{folder}: the study stopped:\n{ended.stderr[-2000:]}")
    results = folder / "results" / settings["study"]
    audited = results / "audit.parquet"
    values = len(pd.read_parquet(audited)) if audited.is_file() else 0
    for one in json.loads((results / "conclusion.json").read_text(encoding="utf-8")):
        yield read_conclusion(one), values


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the seeds and print."""
    parser = start_parser(__doc__)
    parser.add_argument("config", type=Path, nargs="?")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="where the studies' folders stay")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as place:
        if given.config is None:
            write_study(Path(place) / "my-study", ["medium"])
            given.config = Path(place) / "my-study" / "config" / "config.yaml"
        settings = yaml.safe_load(given.config.read_text(encoding="utf-8"))
        found: dict[str, list[Conclusion]] = {}
        for seed in range(1, given.seeds + 1):
            folder = (given.keep or Path(place)) / f"seed-{seed}"
            for one, values in run_seed(settings, seed, given.cores, folder):
                found.setdefault(one.robot or "all", []).append(one)
                print(
                    f"seed {seed}, {one.robot or 'all'}: {one.detector or 'none'}, in {one.agree} of "
                    f"{one.resamplings} resamplings and {one.cells_first} of {one.cells} cells; withheld "
                    f"{', '.join(one.withheld) or 'none'}; {values} values audited",
                    flush=True,
                )
    for robot, conclusions in found.items():
        usual, _ = Counter(one.detector for one in conclusions).most_common(1)[0]
        other = [one for one in conclusions if one.detector != usual]
        said = sum(one.agree < SETTLED for one in other)
        print(f"{robot}: {usual}; {len(other)} of {len(conclusions)} seeds differ, {said} of these say so")


if __name__ == "__main__":
    main()
