"""The attribution board; finished cases are kept for a run that was stopped, unless the code has changed."""

import hashlib
import shutil
from pathlib import Path

from job import run_job
from wearscope import tables
from wearscope.attribution_board.board import run_board

# The board's own processes read this script again.
if __name__ == "__main__":
    with run_job(snakemake) as say:
        folder, params = Path(snakemake.output[0]).parent, snakemake.params
        digest = hashlib.sha256(b"".join(Path(file).read_bytes() for file in snakemake.input)).hexdigest()
        mark = folder / "cases" / "code.sha256"
        if not mark.is_file() or mark.read_text(encoding="utf-8") != digest:
            shutil.rmtree(folder / "cases", ignore_errors=True)
            tables.write_text(mark, digest)
        run_board(
            params.part, folder, params.cases, params.seed, snakemake.threads, params.limit, progress=say
        )
