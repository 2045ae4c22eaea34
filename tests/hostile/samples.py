# ruff: noqa: E501
"""Sound files, small ones, of each kind that a command reads."""

import hashlib
import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from wearscope.robots.dynamics import RigidBody
from wearscope.robots.urdf import normalise_urdf

ROOT = Path(__file__).parents[2]

LINK = (
    '<link name="{0}"><inertial><origin xyz="0 0.1 0.2"/><mass value="{1}"/><inertia ixx="0.2" iyy="0.2" izz="0.1"'
    ' ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 0.3"/>'
    '<axis xyz="0 {3} 1"/><limit lower="-2" upper="2" effort="80" velocity="3"/></joint>'
)
URDF = (
    '<robot name="duo"><link name="base"/>'
    + LINK.format("one", 4)
    + LINK.format("two", 2)
    + JOINT.format("j1", "base", "one", 0)
    + JOINT.format("j2", "one", "two", 1)
    + "</robot>"
)
FIELDS = {
    "name": "duo", "description": "d", "robot": {
        "urdf": "robot.urdf", "joints": ["j1", "j2"], "gravity": [0, 0, -9.81], "gear_ratio": [50, 80],
        "torque_limit": [80, 80], "rotor_inertia": [0.1, 0.1], "inertials": "approximate",
    },
    "sample_rate": 100.0, "units": {"q": "rad", "tau": "N m"},
    "declared_effects": ["rigid_body", "coulomb", "viscous"], "torque": "motor", "turned": [], "accept": ["unrelated tau"],
    "channels": {"fan": "1"}, "reference": ["a"],
    "runs": [
        {"file": "a.csv", "use": "train", "session": "a", "payload": {"mass": 0.0001, "com": [0, 0, 0.1]}},
        {"file": "b.parquet", "use": "test", "session": "b"},
    ],
}  # fmt: skip
SERVO = {"law": "current", "kt": 1.2}


def make_table(seed: int, rows: int = 1000) -> pd.DataFrame:
    """A recording of both joints, with friction and noise."""
    t = np.arange(rows) / 100.0
    rate = 2.0 + np.arange(1, 3) + seed
    q, v = np.sin(np.outer(t, rate)), rate * np.cos(np.outer(t, rate))
    body = RigidBody(normalise_urdf(URDF, ("j1", "j2")), ("j1", "j2"))
    tau = body.inverse_dynamics(q, v, -(rate**2) * q) + np.sign(v) + 0.5 * v
    tau += 0.1 * np.random.default_rng(seed).normal(size=tau.shape)
    columns = {"t": t, "fan": t}
    for k in (0, 1):
        columns[f"q_j{k + 1}"] = q[:, k]
        columns[f"tau_j{k + 1}"] = columns[f"current_j{k + 1}"] = tau[:, k]
    return pd.DataFrame(columns)


def write_dataset(folder: Path, servo: bool = False) -> None:
    folder.mkdir(parents=True)
    fields = {**FIELDS, "servo": SERVO} if servo else FIELDS
    (folder / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False))
    (folder / "robot.urdf").write_text(URDF)
    make_table(0).to_csv(folder / "a.csv", index=False, float_format="%.5f")
    make_table(1).to_parquet(folder / "b.parquet", index=False)


MODEL = """name: duo
urdf: robot.urdf
joints: [j1, j2]
gravity: [0, 0, -9.81]
drive:
  gear_ratio: [100, 100]
  rotor_inertia: [0.5, 0.5]
  torque_limit: [80, 80]
  speed_limit: [3, 3]
  acceleration_limit: [15, 15]
  jerk_limit: [150, 150]
sensors: {encoder_resolution: [1.0e-06, 1.0e-06], torque_noise: [0.2, 0.2], sample_rate: 250}
payload: {mass: 0.3, com: [0, 0, 0.05]}
controller: {bandwidth_hz: 6.0, damping: 1.0}
home: [0, 0]
wear_axes: [j1, j2]
effects:
- joint: j1
  effect: friction_wear_temperature
  parameters: {eta0: 2, eta1: -1.6, eta2: 0.1, eta3: -0.25, eta4: 0.0098, eta5: 1.76, eta6: -0.019, eta7: 0.064, eta8: 0.004,
    eta9: 0.0152, alpha: 1}
- joint: j2
  effect: friction_wear_temperature
  parameters: {eta0: 2, eta1: -1.6, eta2: 0.1, eta3: -0.25, eta4: 0.0098, eta5: 1.76, eta6: -0.019, eta7: 0.064, eta8: 0.004,
    eta9: 0.0152, alpha: 1}
"""
VERDICT = {
    "joints": {"j1": {"rms_before": 2.0, "rms_after": 1.0, "unit": "N m"}, "j2": {"rms_before": 1.0, "rms_after": 1.0}},
    "verdict": [{"joint": "j1", "effect": "stribeck", "confidence": 0.9}], "dataset_digest": "0", "status": "named",
}  # fmt: skip
PAGE = (
    '<html><head><script type="application/json" id="strip">{"answer": "It is so.", "kind": "good", "sure": "very", '
    '"caveat": "little", "action": "go on"}</script></head><body></body></html>'
)
LEROBOT = {
    "codebase_version": "v2.1", "fps": 100, "features": {
        "observation.state": {"dtype": "float32", "shape": [2], "names": ["j1.pos", "j2.pos"]},
        "observation.effort": {"dtype": "float32", "shape": [2], "names": {"motors": ["j1", "j2"]}},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    },
}  # fmt: skip


def write_robot(folder: Path) -> None:
    """A model of the arm."""
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    (folder / "model.yaml").write_text(MODEL)


def write_loop(folder: Path) -> None:
    """Results of a loop, as far as what compares and lists them reads."""
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text(json.dumps(VERDICT))
    (folder / "report.html").write_text(PAGE)
    write_ranking(folder)


def write_ranking(folder: Path) -> None:
    """The table of a study that says which detector is best."""
    columns = ("rank", "rank_low", "rank_high", "median", "median_low", "median_high")
    pq.write_table(
        pa.table({"fda": ["A", "B"], **{name: [1.0, 2.0] for name in columns}}), folder / "ranking.parquet"
    )


def write_lerobot(folder: Path) -> None:
    """A data set of LeRobot of three episodes."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data").mkdir()
    (folder / "meta" / "info.json").write_text(json.dumps(LEROBOT))
    table = make_table(0)
    lists = {"state": table[["q_j1", "q_j2"]], "effort": table[["tau_j1", "tau_j2"]]}
    columns = {f"observation.{name}": one.to_numpy().tolist() for name, one in lists.items()}
    columns |= {"timestamp": table["t"], "episode_index": np.arange(len(table)) * 3 // len(table)}
    pq.write_table(pa.table(columns), folder / "data" / "a.parquet")


def write_study(folder: Path) -> None:
    """A small study of the arm with code of its own."""
    write_robot(folder / "arm")
    text = (ROOT / "config" / "quick.yaml").read_text()
    settings = yaml.safe_load(text) | {"time_limit": 5, "export": {"model": "arm"}, "allow_code": []}
    (folder / "config").mkdir()
    (folder / "config" / "config.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))


def write_archive(path: Path) -> None:
    """A packed study."""
    members = [
        ("MANIFEST.json", json.dumps(MANIFEST).encode()), ("MANIFEST.sha256", b""), ("config.yaml", b"study: tiny\nseed: 0\n"),
        ("report.html", PAGE.encode()), ("verdict.json", json.dumps(VERDICT).encode()),
    ]  # fmt: skip
    table = io.BytesIO()
    ranking = {"rank": [1.0], "rank_low": [1.0], "rank_high": [2.0], "median": [3.0]}
    ranking |= {"median_low": [2.0], "median_high": [4.0]}
    pq.write_table(pa.table({"fda": ["A"], **ranking}), table)
    members.append(("ranking.parquet", table.getvalue()))
    sign(members)
    with tarfile.open(path, "w") as tar:
        for name, content in members:
            member = tarfile.TarInfo(name)
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))


MANIFEST = {
    "format": 2, "study": "tiny", "config": {"study": "tiny", "seed": 0}, "python": "3.11", "packages": {"numpy": "2"},
    "code": {"wearscope": "0.3.0", "commit": None, "changed": False, "sha256": "0" * 64, "files": {}, "date": None},
    "inputs": {}, "files": {},
}  # fmt: skip


def write_own(folder: Path, kind: str) -> None:
    """A file of own code, as `wearscope new` makes it."""
    from jinja2 import Template

    text = (ROOT / "src" / "wearscope" / "starters" / "templates" / f"{kind}.py.jinja").read_text()
    filled = Template(text).render(
        name="own", title="Own", description="d", unit="rad", unit_text="rad", points=[(0.3, 0.2)], speed=0.5
    )
    (folder / "own.py").write_text(filled)


def write_shown(folder: Path, kind: str) -> None:
    """A table."""
    frame = pd.DataFrame({"a": [1.0, 2.0], "b": ["x", "y"], "fda": ["A", "B"]})
    content = {
        "csv": lambda: frame.to_csv(index=False).encode(), "json": lambda: frame.to_json().encode(),
        "parquet": frame.to_parquet,
    }  # fmt: skip
    (folder / f"a.{kind}").write_bytes(content[kind]())


def sign(members: list[tuple[str, bytes]]) -> None:
    """Checksums such as whoever packs an archive can make them."""
    try:
        manifest = json.loads(members[0][1])
        manifest["files"] = {
            name: {"sha256": hashlib.sha256(one).hexdigest(), "bytes": len(one)}
            for name, one in members[1:]
            if name != "MANIFEST.sha256"
        }
        text = json.dumps(manifest).encode()
    except (ValueError, TypeError, KeyError):
        text = members[0][1]
    members[0] = (members[0][0], text)
    for i, (name, _) in enumerate(members):
        if name == "MANIFEST.sha256":
            members[i] = (name, f"{hashlib.sha256(text).hexdigest()}  MANIFEST.json\n".encode())
