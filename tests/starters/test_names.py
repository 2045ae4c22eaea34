"""Names of files, columns, joints and links are data: bounded where they are read, escaped where written."""

import pytest
import yaml
from click.testing import CliRunner
from hostile.samples import URDF, make_table, write_dataset, write_robot

from wearscope.cli.main import wearscope
from wearscope.errors import InputError
from wearscope.robots.urdf import parse_urdf
from wearscope.starters.writing import quote

ODD = "a\naccept: [unrelated tau]\nturned: [q_j1]\n#"


def convert(folder, *arguments):
    done = CliRunner().invoke(wearscope, ["new", "dataset", *arguments, "--urdf", "data/robot.urdf", "--name",
                                          "made", "--accept", "unrelated tau", "--accept", "degrees q",
                                          "--accept", "clock t"])  # fmt: skip
    assert done.exception is None or isinstance(done.exception, InputError | SystemExit), done.exception
    return done


@pytest.mark.parametrize("where", ["file", "column", "note"])
def test_a_name_writes_no_field(tmp_path, monkeypatch, where):
    monkeypatch.chdir(tmp_path)
    write_dataset(tmp_path / "data")
    table = make_table(0).drop(columns=["current_j1", "current_j2", "fan"])
    name = "data/odd.parquet" if where == "column" else f"data/{ODD}.csv"
    if where == "column":
        table = table.rename(columns={"t": f"time [s] {ODD}"})
    if where == "note":  # a row that is left out is told with the file
        table.loc[5, "q_j1"] = None
    (table.to_parquet if where == "column" else table.to_csv)(tmp_path / name, index=False)
    done = convert(tmp_path, name, "data/b.parquet")
    assert done.exit_code == 0, done.output + str(done.exception)
    fields = yaml.safe_load((tmp_path / "made" / "dataset.yaml").read_text())
    assert "turned" not in fields and "unrelated tau" in fields["accept"]
    assert done.output.replace("\n", "").isprintable()


def test_long_names_are_refused_where_they_are_read(tmp_path, monkeypatch):
    """PyBullet ends the process at a joint of 1,500 characters, and at a link of 5,000."""
    for old in ("j1", "one", "duo"):
        with pytest.raises(
            InputError, match=r"name '\w{30}' has more than 100 characters; give each its own"
        ):
            parse_urdf(URDF.replace(f'"{old}"', f'"{"x" * 1500}"'))
        assert parse_urdf(URDF.replace(f'"{old}"', f'"{"x" * 100}"')).joints
    monkeypatch.chdir(tmp_path)
    write_robot(tmp_path / "arm")
    path = tmp_path / "arm" / "robot.urdf"
    path.write_text(path.read_text().replace("j1", "j" * 1500))
    done = CliRunner().invoke(wearscope, ["new", "robot", "arm/robot.urdf", "--name", "made"])
    assert isinstance(done.exception, InputError) and not (tmp_path / "made").exists()
    write_dataset(tmp_path / "data")
    make_table(0).rename(columns={"t": "t" * 400}).to_csv(tmp_path / "long.csv", index=False)
    assert "more than 300 characters" in str(convert(tmp_path, "long.csv").exception)


@pytest.mark.parametrize(
    "text", ["j1", "yes", "1", "~", "=", "a: b", "a, b", "- a", "a #b", "[1", ODD, "\x1b[2J", "é", " a ", "",
             "\ud800",
             "\u2028", "'", '"', "1e3", ".inf", "2024-01-01", "?", "a\\b", "../arm"],
)  # fmt: skip
def test_a_quoted_name_is_read_back(text):
    line = quote(text)
    assert line.isprintable()
    if text != "\ud800":  # which no file holds
        assert yaml.safe_load(f"a: [{line}, {line}]\n{line}: 2") == {"a": [text, text], text: 2}
