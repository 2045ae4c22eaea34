import json

from wearscope.storage.files import SETTINGS
from wearscope.storage.files import write_text


# While jobs wait, Snakemake looks through all of them again a timespan after each look, so that a limit of starts a
# timespan (--max-jobs-per-timespan) is kept; and each job that ends begins such a row of looks anew. By the middle of the
# default study they took a quarter of a core. What runs here is limited by its cores: a look when a job has ended is
# enough.
onstart:
    if "OWN_TURN" in globals() and OWN_TURN:
        take_turn()
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None
    if "STUDY" in globals():  # a repair asks for files with it (python -m wearscope.integrity)
        write_text(f"{R}/{SETTINGS}", json.dumps(config))
