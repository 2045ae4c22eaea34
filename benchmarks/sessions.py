"""Whether `track` tells what changed: planted sessions on random arms, scored from its files.

    python -m benchmarks.sessions --out DIR [--machines 12] [--first 0] [--seed 0]

A machine is an arm of one to four joints in space, with three or four healthy sessions. Each later session
has one change: a weight on any link, friction, a gain of a joint's torque, pushes, or none. On every third
machine one healthy session was moved by hand. No code of the platform is in the truth; Pinocchio gives the
torques.

An answer is `right`, `cannot tell` (it says that something is not known and names nothing wrong, or names the
truth as an equivalent), `missed` (it says nothing of a change) or `invented` (it names what is not there).
"""

import json
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import yaml

from benchmarks.command import start_parser

KINDS = ("none", "weight", "friction", "gain", "pushes", "none", "weight", "friction")
ANSWERS = ("right", "cannot tell", "missed", "invented")
FRICTION = {
    "friction", "coulomb", "viscous", "wear", "load_dependent_friction", "stribeck", "concave_viscous",
}  # fmt: skip
RATE, SECONDS = 100.0, 20.0


def describe_arm(lengths, masses, axes, raised=0.1):
    """URDF of links along x, joints ``j1`` on; centres of mass raised by a share of the length."""
    parts, parent, at = ['<robot name="arm"><link name="base"/>'], "base", 0.0
    for k, (length, m, axis) in enumerate(zip(lengths, masses, axes, strict=True)):
        i = m * length**2 / 12
        parts.append(
            f'<link name="l{k}"><inertial><mass value="{m}"/>'
            f'<origin xyz="{length / 2} 0 {raised * length}"/>'
            f'<inertia ixx="{i / 6}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k + 1}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>'
            f'<origin xyz="{at} 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-6" upper="6" effort="1000" velocity="20"/></joint>'
        )
        parent, at = f"l{k}", length
    return "\n".join([*parts, "</robot>"])


def write_fields(folder, name, joints, runs, reference):
    """Write ``dataset.yaml``."""
    fields = {
        "name": name,
        "robot": {"urdf": "robot.urdf", "joints": joints},
        "sample_rate": RATE,
        "declared_effects": ["rigid_body", "coulomb", "viscous"],
        "runs": runs,
        "reference": reference,
    }
    (folder / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False))


class Arm:
    """An arm with its friction and noise."""

    def __init__(self, rng):
        self.n = int(rng.choice([1, 2, 3, 4], p=[0.15, 0.35, 0.35, 0.15]))
        size = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))
        self.lengths = size * rng.uniform(0.2, 0.5, self.n)
        self.masses = 6.0 * size**2 * rng.uniform(0.4, 1.0, self.n) * 0.6 ** np.arange(self.n)
        axes = ["0 1 0", "1 0 0", "0 0 1"]
        self.axes = ["0 1 0", *(axes[k] for k in rng.choice(3, self.n - 1, p=[0.6, 0.2, 0.2]))][: self.n]
        self.joints = [f"j{k + 1}" for k in range(self.n)]
        self.urdf = describe_arm(self.lengths, self.masses, self.axes)
        self.model = pin.buildModelFromXML(self.urdf)
        self.coulomb, self.viscous, self.noise = np.zeros((3, self.n))
        self.slow = 0.4 * rng.uniform() if rng.uniform() < 0.3 else 0.0
        self.heat = 0.01 if rng.uniform() < 0.5 else 0.0
        self.scatter = rng.uniform(0.0, 0.015)
        self.frequencies = rng.uniform(0.05, 0.7, 5)
        self.amplitude = rng.uniform(0.4, 0.9, self.n)
        _, q, v, a = self.move(rng)
        usual = np.sqrt(np.mean(self.rigid(q, v, a) ** 2, axis=0)) + 0.02 * size**3 * 9.81
        share = rng.uniform(0.05, 0.3, self.n)
        self.coulomb = 0.6 * share * usual
        self.viscous = 0.6 * share * usual / np.sqrt(np.mean(v**2, axis=0))
        self.noise = rng.uniform(0.003, 0.02, self.n) * usual
        self.usual = usual

    def move(self, rng):
        """Time, positions, speeds and accelerations: sums of sines."""
        t = np.arange(int(SECONDS * RATE)) / RATE
        q, v, a = np.zeros((3, len(t), self.n))
        q += rng.uniform(-0.6, 0.6, self.n)
        for f in self.frequencies:
            w = 2 * np.pi * f
            size = self.amplitude * rng.normal(0, 1, self.n) * (0.2 / max(f, 0.2)) ** 0.7
            x = w * t[:, None] + rng.uniform(0, 2 * np.pi, self.n)
            q, v, a = q + size * np.sin(x), v + size * w * np.cos(x), a - size * w * w * np.sin(x)
        return t, q, v, a

    def rigid(self, q, v, a, link=None, mass=0.0, at=(0.0, 0.0, 0.0)):
        """Torques of the bodies, with a point mass on a link."""
        model = self.model.copy()
        if link is not None:
            model.inertias[link + 1] += pin.Inertia(mass, np.array(at), np.zeros((3, 3)))
        data = model.createData()
        return np.array([pin.rnea(model, data, *row).copy() for row in zip(q, v, a, strict=True)])

    def record(self, change, rng, motion):
        """Columns of one run."""
        t, q, v, a = self.move(motion)
        weight = [change[key] for key in ("link", "mass", "at")] if "mass" in change else []
        warmth = change["temperature"] + 2.0 * (1.0 - np.exp(-t / 6.0))
        fall = np.exp(-self.heat * (warmth - 35.0))[:, None]
        healthy = 1.0 + self.scatter * rng.standard_normal(self.n)
        slow = 1.0 + self.slow * np.exp(-((v / 0.1) ** 2))
        friction = healthy * fall * (self.coulomb * slow * np.tanh(v / 0.005) + self.viscous * v)
        j = change["joint"]
        friction[:, j] *= 1.0 + change.get("friction", 0.0)
        tau = self.rigid(q, v, a, *weight) + friction
        tau[:, j] *= 1.0 + change.get("gain", 0.0)
        for moment, size in zip(change.get("moments", ()), change.get("sizes", ()), strict=True):
            tau[:, j] -= size * np.exp(-(((t - moment) / 0.2) ** 4))
        if change.get("hand"):
            held = t > 3
            tau[held] -= change["hand"] * self.usual * (np.sin(q[held]) + rng.normal(0, 0.5, self.n))
        tau += self.noise * rng.standard_normal(q.shape)
        told = {"t": t}
        for k, name in enumerate(self.joints):
            told |= {f"q_{name}": q[:, k], f"qd_{name}": v[:, k], f"tau_{name}": tau[:, k]}
            if self.heat:
                told[f"temp_{name}"] = np.round(warmth, 1)
        return pd.DataFrame(told)


def draw_change(kind, arm, rng):
    """What is different in a later session."""
    j = int(rng.integers(arm.n))
    change = {"kind": kind, "joint": j, "temperature": float(rng.uniform(28, 42)) if arm.heat else 30.0}
    if kind == "friction":
        change["friction"] = float(rng.choice([0.15, 0.25, 0.4, -0.2]))
    elif kind == "gain":
        change["gain"] = float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.15))
    elif kind == "pushes":
        count = int(rng.integers(2, 15))
        change["moments"] = np.sort(rng.uniform(1, SECONDS - 1, count)).tolist()
        change["sizes"] = (rng.choice([-1, 1], count) * rng.uniform(0.3, 1.0, count) * arm.usual[j]).tolist()
    elif kind == "weight":
        length = arm.lengths[j]
        at = [length * rng.uniform(0.3, 1.0), 0.15 * length * rng.normal(), 0.15 * length * rng.normal()]
        _, q, v, a = arm.move(np.random.default_rng(5))
        felt = arm.rigid(q, v, a, j, 1.0, at) - arm.rigid(q, v, a)
        share = np.max(np.sqrt(np.mean(felt**2, axis=0)) / arm.usual)
        change |= {"link": j, "mass": float(rng.uniform(0.08, 0.3) / share), "at": at}
    return change


def write_machine(folder, number, seed):
    """Write a machine's data set; return what was planted, by session."""
    rng = np.random.default_rng([seed, number])
    arm = Arm(rng)
    healthy = int(rng.integers(3, 5))
    hand = number % 3 == 2
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(arm.urdf)
    warmth = rng.uniform(25, 45, healthy) if arm.heat else np.full(healthy, 30.0)
    changes = [{"kind": "healthy", "joint": 0, "temperature": float(x)} for x in warmth]
    if hand:
        changes[1]["hand"] = float(rng.uniform(0.3, 0.8))
    changes += [draw_change(kind, arm, rng) for kind in KINDS]
    runs = []
    for k, change in enumerate(changes):
        table = arm.record(change, rng, np.random.default_rng([seed, number, k]))
        table.to_parquet(folder / "runs" / f"{k:02d}.parquet", index=False)
        runs.append({"file": f"runs/{k:02d}.parquet", "use": "test" if k == healthy else "train"})
        runs[-1]["session"] = f"s{k:02d}"
    write_fields(folder, f"m{number}", arm.joints, runs, [f"s{k:02d}" for k in range(healthy)])
    planted = {f"s{k:02d}": change for k, change in enumerate(changes) if k >= healthy}
    return arm, planted, "s01" if hand else None


def is_true(entry, change, arm):
    """Whether a named change is the one that was planted."""
    if change["kind"] == "weight":
        places = [entry["joint"], *entry.get("anywhere", [])]
        return entry["effect"] == "payload_error" and arm.joints[change["link"]] in places
    if entry["joint"] != arm.joints[change["joint"]]:
        return False
    if change["kind"] == "friction":
        return entry["effect"] in FRICTION
    return change["kind"] == "gain" and entry["effect"] == "torque_constant_error"


def has_size(entries, change):
    """Whether a weight or a gain has its size: the interval holds it, or it is right within a quarter."""
    if change["kind"] not in ("weight", "gain"):
        return True
    truth, name = (change["mass"], "mass") if change["kind"] == "weight" else (change["gain"], "gain")
    for entry in entries:
        if entry["parameter"] == name:
            low, high = entry["ci95"]
            return low <= truth <= high or abs(entry["change"] - truth) <= 0.25 * abs(truth)
    return False


def score(told, change, arm):
    """Answer to one session."""
    names = {"weight": "payload_error", "gain": "torque_constant_error"}
    entries, sentences = told["changes"], [*told["cannot_tell"]]
    false = [entry for entry in entries if not is_true(entry, change, arm)]
    joint = arm.joints[change["joint"]]
    claimed = [text for text in sentences if text.startswith("The friction of ")]
    kept = [text for text in claimed if change["kind"] != "friction" or f"of {joint} changed" not in text]
    if false:
        hinted = any(names.get(change["kind"], "") in entry["equivalent"] for entry in false)
        return "cannot tell" if hinted and len({e["effect"] for e in false}) == 1 else "invented"
    if kept:  # an honest doubt where friction does depend on a temperature; without that, what is not there
        return "cannot tell" if arm.heat else "invented"
    if change["kind"] == "none":
        return "cannot tell" if sentences else "right"
    if change["kind"] == "pushes":
        return "right" if told["events"] else "cannot tell" if sentences else "missed"
    if claimed or (entries and has_size(entries, change)):
        return "right"
    return "invented" if entries else "cannot tell" if sentences else "missed"


def run_machine(number, seed, out):
    """Rows of a machine's sessions."""
    from wearscope.tracking.run import track

    place = out / f"{seed}-{number:03d}"
    kept = place / "rows.json"
    if kept.is_file():
        return json.loads(kept.read_text())
    arm, planted, moved = write_machine(place / "data", number, seed)
    begin = time.process_time()
    row = {"seed": seed, "machine": number, "joints": arm.n, "hand": bool(moved)}
    try:
        told = track(place / "data", place / "told")
    except Exception as error:
        rows = [
            row | {"session": "", "kind": "", "answer": "failed", "said": f"{type(error).__name__}: {error}"}
        ]
        kept.write_text(json.dumps(rows))
        return rows
    seconds = (time.process_time() - begin) / len(planted)
    named = any(one["session"] == moved for one in told.get("reference_scatter", []))
    rows = []
    for one in told["sessions"]:
        change = planted[one["session"]]
        said = [f"{e['joint']} {e['effect']} {e['parameter']} {e['change']:+.3g}" for e in one["changes"]]
        truth = {k: v for k, v in change.items() if k not in ("moments", "sizes", "temperature", "kind")}
        rows.append(
            row
            | {"session": one["session"], "kind": change["kind"], "answer": score(one, change, arm)}
            | {"named": named, "seconds": seconds, "truth": str(truth)}
            | {"said": "; ".join([*said, *one["cannot_tell"]]), "events": len(one["events"])}
            | {"visible": json.dumps(one.get("smallest_visible"))}
        )
    kept.write_text(json.dumps(rows))
    return rows


def summarise(rows):
    """Counts of answers by what was planted."""
    table = pd.DataFrame(rows)
    counts = pd.crosstab(table["kind"], table["answer"], margins=True)
    return counts.reindex(columns=[*(a for a in (*ANSWERS, "failed") if a in counts), "All"])


def main():
    """Command line."""
    parser = start_parser(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--machines", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rows = []
    for number in range(given.first, given.first + given.machines):
        rows += run_machine(number, given.seed, given.out)
        for row in rows:
            if row["machine"] == number:
                told = ("machine", "joints", "session", "kind", "answer", "said")
                print({key: row[key] for key in told}, flush=True)
    print(summarise(rows).to_string())
    moved = [row for row in rows if row["hand"] and row["answer"] != "failed"]
    if moved:
        share = np.mean([row["named"] for row in moved])
        print(f"healthy session moved by hand: named on {share:.0%} of machines")
    seconds = np.mean([row.get("seconds", np.nan) for row in rows])
    print(f"{seconds:.1f} s of processor a session, the reference included")


if __name__ == "__main__":
    main()
