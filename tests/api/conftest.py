"""A small finished study on disk: planted test quantities, everything after them by the real evaluation."""

import pytest
from planted_study import make_tables

from wearscope.designs.factors import PAPER_FACTORS
from wearscope.storage import tables


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    """A folder with ``results/paper`` in it."""
    folder = tmp_path_factory.mktemp("study")
    units = {f"{one.name}_natural": one.unit for one in PAPER_FACTORS} | {"fit": "%"}
    for name, table in make_tables().items():
        if name not in ("design/checks", "group_scope"):
            tables.write_table(folder / f"results/paper/{name}.parquet", table, units)
    (folder / "config").mkdir()
    (folder / "config" / "config.yaml").write_text("study: paper\n")
    return folder
