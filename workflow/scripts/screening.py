"""What was screened, as several scripts read it."""

import pandas as pd

from wearscope.storage import tables


def read_screening(files):
    """One table of all robots."""
    return pd.concat([tables.read_table(file) for file in files], ignore_index=True)
