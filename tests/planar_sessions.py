"""A planar arm over its sessions: bodies by Pinocchio, friction, noise, and what changes in a session."""

from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin

from benchmarks.sessions import RATE, describe_arm, write_fields


class Planar:
    """Links along x, all joints about y, in a vertical plane; `links` are pairs of length and mass."""

    def __init__(self, links, coulomb, viscous, noise, centre, amplitude, frequencies, seconds=20.0):
        self.links, self.coulomb, self.viscous = links, np.array(coulomb), np.array(viscous)
        self.noise, self.centre, self.amplitude = noise, np.array(centre), np.array(amplitude)
        self.frequencies, self.t = frequencies, np.arange(0.0, seconds, 1.0 / RATE)
        self.joints = [f"j{k + 1}" for k in range(len(links))]
        self.urdf = describe_arm(*zip(*links, strict=True), ["0 1 0"] * len(links), raised=0.0)
        self.model = pin.buildModelFromXML(self.urdf)

    def move(self, rng):
        """Positions, speeds and accelerations: sums of sines."""
        n = len(self.joints)
        q, v, a = (np.zeros((len(self.t), n)) for _ in range(3))
        q += self.centre
        for f in self.frequencies:
            w, share = 2 * np.pi * f, (self.frequencies[0] / f) ** 0.5
            size, phase = self.amplitude * share * rng.normal(0, 1, n), rng.uniform(0, 2 * np.pi, n)
            x = w * self.t[:, None] + phase
            q, v, a = q + size * np.sin(x), v + size * w * np.cos(x), a - size * w**2 * np.sin(x)
        return q, v, a

    def record(self, rng, weight=None, friction=None, torque=None):
        """Columns of a run; `weight`: (link, kg, m), `friction`: factors, `torque(t, q)`."""
        model = self.model.copy()
        if weight is not None:
            link, mass, at = weight
            model.inertias[link + 1] += pin.Inertia(mass, np.array([at, 0.0, 0.0]), np.zeros((3, 3)))
        data, (q, v, a) = model.createData(), self.move(rng)
        tau = np.array([pin.rnea(model, data, *row).copy() for row in zip(q, v, a, strict=True)])
        own = self.coulomb * np.tanh(v / 0.01) + self.viscous * v
        tau += own * (1.0 if friction is None else np.array(friction))
        tau += 0.0 if torque is None else torque(self.t, q)
        tau += self.noise * rng.standard_normal(q.shape)
        parts = (("q", q), ("qd", v), ("tau", tau))
        return {"t": self.t} | {
            f"{kind}_{j}": x[:, k] for kind, x in parts for k, j in enumerate(self.joints)
        }


def write_planar(folder: Path, arm: Planar, sessions: dict, reference: int, seed: int = 0) -> Path:
    """Write sessions by name, each of what `Planar.record` takes; the first ones are the reference."""
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(arm.urdf)
    runs = []
    for k, (name, change) in enumerate(sessions.items()):
        table = pd.DataFrame(arm.record(np.random.default_rng([seed, k]), **change))
        table.to_parquet(folder / "runs" / f"{name}.parquet")
        use = "train" if k < reference else "test"
        runs.append({"file": f"runs/{name}.parquet", "use": use, "session": name})
    write_fields(folder, folder.name, arm.joints, runs, list(sessions)[:reference])
    return folder
