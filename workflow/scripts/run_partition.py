"""A partition of a study of many robots, planned and run here as a study of its own."""

import os
import subprocess
import sys
from pathlib import Path

import yaml

from job import run_job
from wearscope.errors import InputError
from wearscope.files import write_text

with run_job(snakemake) as say:
    params, log = snakemake.params, Path(snakemake.log[0])
    study = Path(snakemake.output[0]).with_name("study.yaml")
    write_text(study, yaml.safe_dump(params.study, sort_keys=False))
    command = [sys.executable, "-m", "snakemake", *snakemake.output, "--cores", str(snakemake.threads)]
    command += ["--snakefile", params.snakefile, "--configfile", str(study), "--nocolor"]
    # What the whole study was started with is not for its parts.
    environment = {name: value for name, value in os.environ.items() if name != "SNAKEMAKE_PROFILE"}
    say(f"robots {', '.join(params.study['robots'])}")
    with open(log, "a", encoding="utf-8") as text:
        done = subprocess.run(command, env=environment, stdout=text, stderr=text, check=False)
    if done.returncode:
        raise InputError(
            f"the partition failed; see {log}, correct what it says and run the same command again."
        )
