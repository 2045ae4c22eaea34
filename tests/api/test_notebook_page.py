"""The how-to page on notebooks: its Python runs as it stands, on a study that is there."""

import ast
import re
import shutil
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "notebook.md"


@pytest.mark.slow
def test_page_s_python_runs(place, tmp_path, monkeypatch):
    shutil.copytree(place, tmp_path / "my-study")
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    names, values = {}, []
    for line in ast.parse(block).body:  # as a notebook shows it: the value of each expression
        code = ast.unparse(line)
        if isinstance(line, ast.Expr):
            values.append(eval(code, names))
        else:
            exec(code, names)
    ranking, snr, units, figure, summary, spread = values
    assert set(ranking["fda"]) == {"A", "C"} and set(snr["fda"]) == {"C"}
    assert isinstance(units, dict) and figure.axes
    assert len(summary) == 2 and len(spread) == 6
