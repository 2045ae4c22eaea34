"""The notebooks, run from an empty folder as they stand; that of the loop on a real machine's data too."""

import os
import re
import sys
from pathlib import Path

import nbformat
import pytest
from folders import find_real
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a notebook with `wearscope` as an installed command; returns its cells."""
    tools, folder = tmp_path / "bin", tmp_path / "empty"
    tools.mkdir()
    folder.mkdir()
    (tools / "wearscope").write_text(f'#!/bin/sh\nexec {sys.executable} -m wearscope "$@"\n')
    (tools / "wearscope").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}{os.pathsep}{os.environ['PATH']}")
    # A kernel of this interpreter, with no settings of the user's.
    for name in ("IPYTHONDIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")

    def execute(path, parameters=None):
        notebook = nbformat.read(path, as_version=4)
        for cell in notebook.cells:
            if parameters is not None and "parameters" in cell.metadata.get("tags", []):
                cell.source += f"\n{parameters}"
        place = {"metadata": {"path": str(folder)}}
        return NotebookClient(notebook, timeout=1800, coalesce_streams=True, resources=place).execute().cells

    return execute


def read_outputs(cells):
    """Text that the cells show, as one."""
    shown = [one for cell in cells if cell.cell_type == "code" for one in cell.outputs]
    return "\n".join(one.get("text") or one.get("data", {}).get("text/plain", "") for one in shown)


def count_figures(cells):
    return sum(
        "image/png" in one.get("data", {})
        for cell in cells if cell.cell_type == "code" for one in cell.outputs
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "words", "figures"),
    [
        (NOTEBOOKS / "study.ipynb", ["ranking", "degC", "snr"], 2),
        (NOTEBOOKS / "loop.ipynb", ["gravity_counterbalance", "stribeck", "confirmed"], 1),
    ],
    ids=["study", "loop"],
)
def test_notebook_gives_its_answer_in_cells_as_they_are_kept(run, path, words, figures):
    cells = run(path)
    text = read_outputs(cells)
    assert all(word in text for word in words)
    assert count_figures(cells) == figures
    kept = nbformat.read(path, as_version=4).cells
    assert [list_kinds(cell) for cell in kept] == [list_kinds(cell) for cell in cells]


@pytest.mark.slow
def test_loop_takes_a_real_machine_s_data(run):
    code = f"from pathlib import Path\ndataset = Path({str(find_real('kr300'))!r})"
    cells = run(NOTEBOOKS / "loop.ipynb", code)
    assert "gravity_counterbalance" in read_outputs(cells)
    assert count_figures(cells) == 1


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_is_kept_with_its_outputs_and_without_paths_of_a_machine(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert count_figures(notebook.cells) > 0
    assert read_outputs(notebook.cells).strip()
    assert not re.search(r"(?<![\w.])/(tmp|home|root|Users)/", read_outputs(notebook.cells))
    assert all("execution" not in cell.metadata for cell in notebook.cells)


def list_kinds(cell):
    outputs = cell.outputs if cell.cell_type == "code" else []
    return [sorted(one.get("data", {"text": ""})) for one in outputs if one.get("name") != "stderr"]
