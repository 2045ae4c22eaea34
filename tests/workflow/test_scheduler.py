"""How often Snakemake looks for jobs to start."""

from pathlib import Path

import pytest
from calls import call_python

RULES = Path(__file__).parents[2] / "workflow" / "rules" / "scheduler.smk"
WORKFLOW = """
rule all:
    input: expand("{k}.txt", k=range(4))

rule wait:
    output: "{k}.txt"
    shell: "sleep 1.5; echo {wildcards.k} > {output}"
"""


@pytest.mark.parametrize("with_rules", [pytest.param(False, marks=pytest.mark.slow), True])
def test_waiting_jobs_are_looked_through_when_a_job_has_ended(tmp_path, with_rules):
    """Without these lines they would be looked through each second, by as many timers as jobs have ended."""
    included = f'include: "{RULES}"\n' if with_rules else ""
    (tmp_path / "Snakefile").write_text(included + WORKFLOW)
    words = ("-m", "snakemake", "--cores", "1", "--verbose", "--profile", "none")
    done = call_python(*words, folder=tmp_path)
    looks = (done.stdout + done.stderr).count("Ready jobs: ")
    assert sorted(file.name for file in tmp_path.glob("*.txt")) == [f"{k}.txt" for k in range(4)]
    # One for each of the four jobs, and for the target.
    assert looks == 5 if with_rules else looks > 7
