"""Compares surrogates with simulated values and weighs the evidence; shared by two scripts."""

import pandas as pd

from wearscope.evaluation.audit import AUDIT, RECHECK, audit_table, audit_verdicts, weigh_evidence
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_chosen


def weigh(given, model, designs, parts):
    """Return the audited values, the scope verdicts and which answers are withheld."""
    direct = pd.concat(map(tables.read_table, parts), ignore_index=True)
    direct["set"] = direct["set"].replace(RECHECK, AUDIT)
    points = pd.concat(map(tables.read_table, designs), ignore_index=True)
    surrogates, *asked = map(tables.read_table, given.asked)
    chosen = dict(read_chosen(*asked)) if model == "chosen" else None
    table = audit_table(direct, surrogates, points, model, chosen=chosen)
    verdicts = audit_verdicts(table)
    snr = tables.read_table(given.direct[0]) if len(given.direct) else None
    return table, verdicts, weigh_evidence(table, verdicts, snr)
