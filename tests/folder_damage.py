"""Twenty-odd ways a measured-data folder comes damaged; for tests of whoever reads such folders.

Every kind either makes the folder break its contract, so that one clear sentence is due (`REFUSED`), or
leaves it formally whole but misleading (`MISLEADING`): there a refusal or an answer free of false names is
due.
"""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from wearscope.errors import InputError


class _Folder:
    """A data set's folder, open for damage."""

    def __init__(self, path: Path):
        self.path = path
        self.document: dict[str, Any] = yaml.safe_load((path / "dataset.yaml").read_text(encoding="utf-8"))

    def save(self) -> None:
        text = yaml.safe_dump(self.document, sort_keys=False)
        (self.path / "dataset.yaml").write_text(text, encoding="utf-8")

    def files(self, use: str | None = None) -> list[Path]:
        return [self.path / r["file"] for r in self.document["runs"] if use is None or r["use"] == use]

    def edit(self, change: Callable[[pd.DataFrame], pd.DataFrame], every: bool = False) -> None:
        """Rewrite the first training run, or every run."""
        for file in self.files() if every else self.files("train")[:1]:
            change(pd.read_parquet(file)).to_parquet(file, index=False)

    @property
    def joint(self) -> str:
        return str(self.document["robot"]["joints"][-1])

    def columns(self, prefix: str, table: pd.DataFrame) -> list[str]:
        return [name for name in table.columns if name.startswith(f"{prefix}_")]


def _truncate(f: _Folder) -> None:
    file = f.files("train")[0]
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def _swap(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        return table.rename(columns={f"q_{f.joint}": f"tau_{f.joint}", f"tau_{f.joint}": f"q_{f.joint}"})

    f.edit(change, every=True)


def _one_nan(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[len(table) // 3, f"tau_{f.joint}"] = np.nan
        return table

    f.edit(change)


def _one_infinity(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[len(table) // 3, f"q_{f.joint}"] = np.inf
        return table

    f.edit(change)


def _backwards(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        middle = len(table) // 2
        t = table["t"].to_numpy().copy()
        t[middle : middle + 5] = t[middle : middle + 5][::-1]
        return table.assign(t=t)

    f.edit(change)


def _jump(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        t = table["t"].to_numpy().copy()
        t[len(t) // 2 :] += 3.0
        return table.assign(t=t)

    f.edit(change)


def _duplicated_rows(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        middle = len(table) // 2
        return pd.concat([table[:middle], table[middle - 10 : middle], table[middle:]], ignore_index=True)

    f.edit(change)


def _factor(prefix: str, factor: float) -> Callable[[_Folder], None]:
    def apply(f: _Folder) -> None:
        def change(table: pd.DataFrame) -> pd.DataFrame:
            names = f.columns(prefix, table)
            table[names] = table[names] * factor
            return table

        f.edit(change, every=True)

    return apply


def _constant_torque(f: _Folder) -> None:
    f.edit(lambda table: table.assign(**{f"tau_{f.joint}": 1.0}), every=True)


def _missing_column(f: _Folder) -> None:
    f.edit(lambda table: table.drop(columns=f"tau_{f.joint}"))


def _text_values(f: _Folder) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        return table.assign(**{f"tau_{f.joint}": table[f"tau_{f.joint}"].map("{:.3f} Nm".format)})

    f.edit(change)


def _empty_run(f: _Folder) -> None:
    f.edit(lambda table: table[:0])


def _short_run(f: _Folder) -> None:
    f.edit(lambda table: table[:12])


def _missing_file(f: _Folder) -> None:
    f.files("train")[0].unlink()


def _unknown_joint(f: _Folder) -> None:
    f.document["robot"]["joints"][0] = "no_such_joint"


def _unknown_effect(f: _Folder) -> None:
    f.document["declared_effects"].append("gremlins")


def _test_repeats_train(f: _Folder) -> None:
    shutil.copyfile(f.files("train")[0], f.files("test")[0])


def _same_file_twice(f: _Folder) -> None:
    runs = f.document["runs"]
    train = next(run for run in runs if run["use"] == "train")
    next(run for run in runs if run["use"] == "test")["file"] = train["file"]


def _wrong_rate(f: _Folder) -> None:
    f.document["sample_rate"] = 4.0 * f.document["sample_rate"]


def _wrong_units(f: _Folder) -> None:
    f.document["units"] = (
        {"q": "rad", "tau": "N m"} if f.document["units"]["q"] == "m" else {"q": "m", "tau": "N"}
    )


def _odd_units(f: _Folder) -> None:
    f.document["units"] = {"q": "furlong", "tau": "N m"}


def _no_train(f: _Folder) -> None:
    for run in f.document["runs"]:
        run["use"] = "test"


def _odd_use(f: _Folder) -> None:
    f.document["runs"][0]["use"] = "training"


def _missing_urdf(f: _Folder) -> None:
    (f.path / "robot.urdf").unlink()


def _broken_urdf(f: _Folder) -> None:
    urdf = f.path / "robot.urdf"
    urdf.write_text(urdf.read_text(encoding="utf-8")[:400], encoding="utf-8")


def _massless_urdf(f: _Folder) -> None:
    urdf = f.path / "robot.urdf"
    text = urdf.read_text(encoding="utf-8")
    while "<inertial>" in text:
        text = text[: text.index("<inertial>")] + text[text.index("</inertial>") + len("</inertial>") :]
    urdf.write_text(text, encoding="utf-8")


def _masses_in_grams(f: _Folder) -> None:
    urdf = f.path / "robot.urdf"
    parts = urdf.read_text(encoding="utf-8").split('<mass value="')
    heavy = [parts[0]]
    for part in parts[1:]:
        value, rest = part.split('"', 1)
        heavy.append(f'{float(value) * 1000:g}"{rest}')
    urdf.write_text('<mass value="'.join(heavy), encoding="utf-8")


def _broken_yaml(f: _Folder) -> None:
    f.document = {}
    (f.path / "dataset.yaml").write_text("name: [unclosed\nrobot: {", encoding="utf-8")


_REFUSED: dict[str, Callable[[_Folder], None]] = {
    "truncated_parquet": _truncate,
    "one_nan": _one_nan,
    "one_infinity": _one_infinity,
    "time_backwards": _backwards,
    "time_jump": _jump,
    "duplicated_rows": _duplicated_rows,
    "missing_column": _missing_column,
    "text_values": _text_values,
    "empty_run": _empty_run,
    "short_run": _short_run,
    "missing_run_file": _missing_file,
    "unknown_joint": _unknown_joint,
    "unknown_effect": _unknown_effect,
    "test_repeats_train": _test_repeats_train,
    "same_file_twice": _same_file_twice,
    "wrong_rate": _wrong_rate,
    "wrong_units": _wrong_units,
    "odd_units": _odd_units,
    "no_train_run": _no_train,
    "odd_use": _odd_use,
    "missing_urdf": _missing_urdf,
    "broken_urdf": _broken_urdf,
    "broken_yaml": _broken_yaml,
}
_MISLEADING: dict[str, Callable[[_Folder], None]] = {
    "swapped_columns": _swap,
    "millimetres_for_metres": _factor("q", 1000.0),
    "constant_torque": _constant_torque,
    "massless_urdf": _massless_urdf,
    "masses_in_grams": _masses_in_grams,
}
REFUSED: tuple[str, ...] = tuple(_REFUSED)
MISLEADING: tuple[str, ...] = tuple(_MISLEADING)
DAMAGES: tuple[str, ...] = REFUSED + MISLEADING


def damage(folder: str | Path, kind: str) -> None:
    """Damage a measured-data folder in place.

    Parameters
    ----------
    folder : path-like
        A whole folder; it is changed, so pass a copy.
    kind : str
        One of `DAMAGES`. ``millimetres_for_metres`` is meant for sliding joints.

    Raises
    ------
    InputError
        For an unknown kind.
    """
    if kind not in DAMAGES:
        raise InputError(f"damage: there is no kind '{kind}'; choose one of {', '.join(DAMAGES)}.")
    opened = _Folder(Path(folder))
    (_REFUSED | _MISLEADING)[kind](opened)
    if opened.document:
        opened.save()


def copy_damaged(source: str | Path, target: str | Path, kind: str) -> Path:
    """Copy a measured-data folder and damage the copy; gives the copy's path."""
    shutil.copytree(source, target)
    damage(target, kind)
    return Path(target)
