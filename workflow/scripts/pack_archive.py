"""The finished study in one file."""

from pathlib import Path

from job import run_job
from wearscope.archive import pack_study
from wearscope.provenance import list_platform_files

with run_job(snakemake) as say:
    folder = Path(snakemake.input.study[0]).parent
    # This job's own log and timing are still being written.
    own = {Path(snakemake.log[0]), folder / "benchmarks" / "pack_archive.tsv"}
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file not in own]
    sources = list_platform_files()
    manifest = pack_study(snakemake.output[0], folder, files, snakemake.params.config, sources, say)
    say(f"{len(manifest['files'])} files, {Path(snakemake.output[0]).stat().st_size / 1e6:.0f} MB")
