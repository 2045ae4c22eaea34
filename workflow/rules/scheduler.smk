import json

from wearscope.storage.files import SETTINGS
from wearscope.storage.files import write_text


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
