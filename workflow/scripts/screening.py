"""Reads the screening of factors; shared by several scripts."""

import pandas as pd

from wearscope.storage import tables


def read_screening(files):
    """Return the screening tables of all robots as one."""
    return pd.concat([tables.read_table(file) for file in files], ignore_index=True)
