"""Runs a partition of a divided study, or a complete study, by another Snakemake inside this job."""

import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

import yaml

from job import run_job
from wearscope.errors import InputError
from wearscope.processes import PYTHON, STARTER, identify_process
from wearscope.storage.files import write_text, write_whole

with run_job(snakemake) as say:
    params, log = snakemake.params, Path(snakemake.log[0])
    write_text(params.file, yaml.safe_dump(params.study, sort_keys=False))
    command = [*PYTHON, "-m", "snakemake", *params.targets, "--cores", str(snakemake.threads)]
    command += ["--snakefile", params.snakefile, "--configfile", params.file, "--nocolor"]
    # Settings of the whole study's Snakemake must not reach the one that runs a part.
    environment = {name: value for name, value in os.environ.items() if name != "SNAKEMAKE_PROFILE"}
    environment[STARTER] = identify_process(os.getpid())
    say(f"robots {', '.join(params.study['robots'])}")
    with open(log, "a", encoding="utf-8") as text:
        done = subprocess.run(command, env=environment, stdout=text, stderr=text, check=False)
    if done.returncode:
        raise InputError(f"{log}: it failed; correct what is said there and run the same command again.")
    for made, wanted in zip(params.targets, snakemake.output, strict=False):
        if made != str(wanted):  # a storage takes it from elsewhere
            write_whole(wanted, partial(shutil.copyfile, made))
