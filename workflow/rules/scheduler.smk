"""Starts a run: alone in its folder, and bound to the process that has started it."""

import json
import os
import sys
from contextlib import ExitStack
from pathlib import Path

from wearscope.cli.workflow import wait_turn
from wearscope.jobs.study_files import tell
from wearscope.processes import MAIN, STARTER, end_with, identify_process
from wearscope.storage.files import SETTINGS
from wearscope.storage.files import write_text

# If a job (partitions.smk) or `wearscope` has started this process, it ends with that one, which holds the lock.
STARTED_BY = os.environ.pop(STARTER, "")
end_with(STARTED_BY)
# Every job ends with this process, even if only this process is killed.
os.environ[MAIN] = identify_process(os.getpid())
# Two runs of one study at once would not see each other's new files. So this run waits with its planning until another
# has ended, and locks the folder when it starts. A dry run need not wait.
TURN = ExitStack()
OWN_TURN = workflow.is_main_process and not STARTED_BY and not {"-n", "--dry-run", "--dryrun"} & {*sys.argv}


def take_turn():
    tell(TURN.enter_context, wait_turn(Path(), lambda told: print(told, file=sys.stderr)))


if OWN_TURN and os.path.lexists("results/.wearscope.lock"):
    take_turn()
    TURN.close()


# To keep a limit of job starts per timespan (--max-jobs-per-timespan), Snakemake checks all waiting jobs once per
# timespan, and each job that ends starts another such series of checks. In the middle of the default study they took a
# quarter of a core. On one machine the cores limit the jobs, so a check at the end of each job is enough, and the
# limiter is removed.
onstart:
    if "OWN_TURN" in globals() and OWN_TURN:
        take_turn()
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None
    if "STUDY" in globals():  # python -m wearscope.integrity uses this file to make damaged files again
        write_text(f"{R}/{SETTINGS}", json.dumps(config))
