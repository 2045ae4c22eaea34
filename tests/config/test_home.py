from pathlib import Path

from wearscope.home import find_home
from wearscope.robots.model_file import find_model

ROOT = Path(__file__).parents[2]


def test_home_of_a_clone_is_its_top():
    assert find_home() == ROOT


def test_robots_of_the_home_are_found_by_name_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_model("medium") == ROOT / "config" / "robots" / "medium" / "model.yaml"
    own = tmp_path / "config" / "robots" / "medium"
    own.mkdir(parents=True)
    (own / "model.yaml").write_text("")
    assert find_model("medium") == Path("config/robots/medium/model.yaml")
