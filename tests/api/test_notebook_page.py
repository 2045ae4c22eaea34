"""The how-to page on notebooks: its Python runs as it stands, on a study that is there."""

import ast
import json
import re
import shutil
from pathlib import Path

import pytest

from wearscope.evaluation.conclusion import Conclusion

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "notebook.md"


@pytest.mark.slow
def test_page_s_python_runs(place, tmp_path, monkeypatch):
    shutil.copytree(place, tmp_path / "my-study")
    conclusion = [Conclusion(robot, "C", [], [], 3.0, [], 4, 4, True, 0.01, 0.99) for robot in ("", "medium")]
    (tmp_path / "my-study" / "results" / "paper" / "conclusion.json").write_text(
        json.dumps([one.to_mapping() for one in conclusion])
    )
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    names, values = {}, []
    for line in ast.parse(block).body:  # as a notebook shows it: the value of each expression
        code = ast.unparse(line)
        if isinstance(line, ast.Expr):
            values.append(eval(code, names))
        else:
            exec(code, names)
    ranking, snr, units, recommended, figure, summary, parameters, axes, spread = values
    assert set(ranking["fda"]) == {"A", "C"} and set(snr["fda"]) == {"C"}
    assert isinstance(units, dict) and figure.axes
    assert list(recommended["robot"]) == ["all", "medium"] and set(recommended["detector"]) == {"C"}
    assert len(summary) == 2 and len(parameters) > 1 and axes.has_data() and len(spread) == 6
