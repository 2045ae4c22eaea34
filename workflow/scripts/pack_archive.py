"""Packs the finished study into one file."""

from pathlib import Path

from job import run_job
from wearscope.archive.comparison import list_results
from wearscope.archive.packing import pack_study
from wearscope.integrity import find_damage
from wearscope.storage.provenance import list_platform_files

with run_job(snakemake) as say:
    folder = Path(snakemake.input.study[0]).parent
    for damage in find_damage(folder):
        raise damage
    # This job's own log and timing are still being written.
    own = {Path(snakemake.log[0]), folder / "benchmarks" / "pack_archive.tsv"}
    files = [file for file in list_results(folder) if file not in own]
    manifest = pack_study(
        snakemake.output[0],
        folder,
        files,
        snakemake.params.config,
        list_platform_files(),
        say,
        snakemake.input.own,
    )
    say(f"{len(manifest.files)} files, {Path(snakemake.output[0]).stat().st_size / 1e6:.0f} MB")
