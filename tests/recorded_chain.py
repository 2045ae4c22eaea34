"""Recordings of a hanging chain of point masses, as CSV and as the command takes them."""

import numpy as np
from click.testing import CliRunner
from urdf_texts import Joint, describe_joint, describe_robot

from wearscope.cli.main import wearscope


def pivot(name, at, mass=0.01, centre=-0.1, parent=""):
    """A joint about the axis -y, `at` a height on its carrier, whose point mass is at the height `centre`."""
    places = {"com": f"0 0 {centre}", "at": f"0 0 {at}", "moments": "1e-5 1e-5 1e-5"}
    return Joint(name, "0 -1 0", mass, **places, limits="-3.1 3.1 900 9", parent=parent)


def hang(urdf, name, at, parent):
    """Hang a light link more on the link `parent` of the file."""
    text = urdf.read_text()
    more = describe_joint(text.count("<link"), pivot(name, at, parent=parent))
    urdf.write_text(text.replace("</robot>", more + "</robot>"))


def move(rng, t, n, size, frequencies):
    q, v, a = np.zeros((3, len(t), n))
    for j in range(n):
        for f in frequencies:
            w, phase = 2 * np.pi * f * rng.uniform(0.9, 1.1), rng.uniform(0, 6.28)
            amplitude = size * rng.uniform(0.4, 1.0)
            q[:, j] += amplitude * np.sin(w * t + phase)
            v[:, j] += amplitude * w * np.cos(w * t + phase)
            a[:, j] -= amplitude * w**2 * np.sin(w * t + phase)
    return q, v, a


def chain(q, v, a, mass, length, gravity=9.81):
    """Torque of a hanging planar chain of point masses at the links' ends, by Newton's law alone.

    `mass` is of all links, or (n,) of each.
    """
    masses = np.broadcast_to(mass, q.shape[1])
    th, om, al = (np.cumsum(x, 1) for x in (q, v, a))
    ax = np.cumsum(length * (np.cos(th) * al - np.sin(th) * om**2), 1)
    az = np.cumsum(length * (np.sin(th) * al + np.cos(th) * om**2), 1) + gravity
    x, z = np.cumsum(length * np.sin(th), 1), np.cumsum(-length * np.cos(th), 1)
    tau = np.zeros_like(q)
    for j in range(q.shape[1]):
        x0, z0 = (x[:, j - 1], z[:, j - 1]) if j else (0.0, 0.0)
        tau[:, j] = sum(
            masses[i] * ((x[:, i] - x0) * az[:, i] - (z[:, i] - z0) * ax[:, i]) for i in range(j, q.shape[1])
        )
    return tau


class Bench:
    """Recordings of a chain as CSV, and the command that takes them."""

    def __init__(
        self,
        folder,
        n,
        mass=1.2,
        length=0.3,
        size=0.3,
        rate=50.0,
        seconds=14.0,
        runs=3,
        frequencies=(0.11, 0.23, 0.37, 0.61),
    ):
        self.folder, self.n, self.runs, self.frequencies = folder, n, runs, frequencies
        self.size, self.rate, self.seconds = size, rate, seconds
        links = [pivot(f"j{k + 1}", -length if k else 0, mass, -length) for k in range(n)]
        (folder / "arm.urdf").write_text(describe_robot(*links))

    def record(self, torque, clock=None, position=lambda q, k: q, speed=None, shown=1.0):
        """With speeds where `speed` is their factor; the files show `shown` times the true time."""
        for k in range(self.runs):
            rng = np.random.default_rng([self.n, k])
            t = np.arange(int(self.seconds * self.rate)) / self.rate if clock is None else clock(k)
            q, v, a = move(rng, t, self.n, self.size, self.frequencies)
            kinds = {"q": position(q, k)} | ({} if speed is None else {"qd": speed * v})
            kinds["tau"] = torque(q, v, a, rng, t)
            names = [f"{kind}{j + 1}" for kind in kinds for j in range(self.n)]
            table = np.column_stack([shown * t, *kinds.values()])
            header = ",".join(["time", *names])
            np.savetxt(self.folder / f"run{k}.csv", table, "%.8g", ",", header=header, comments="")
        return self

    def take(self, *options):
        files = [str(self.folder / f"run{k}.csv") for k in range(self.runs)]
        place = ["--urdf", str(self.folder / "arm.urdf"), "--name", "d", "--in", str(self.folder)]
        return CliRunner().invoke(wearscope, ["new", "dataset", *files, *place, *options])

    def refuse(self, *options):
        done = self.take(*options)
        assert done.exit_code != 0 and not (self.folder / "d").exists()
        return " ".join(str(done.exception or done.output).split())

    def accept(self, *options):
        """What the command says of what it wrote and checked, a line each."""
        done = self.take(*options)
        assert done.exit_code == 0, done.output + str(done.exception)
        return [line.strip() for line in done.output.splitlines()]


def rub(v, coulomb, viscous):
    return coulomb * np.tanh(v / 0.01) + viscous * v


def torque_of(mass, coulomb=0.0, viscous=0.0, noise=0.0, gravity=9.81, times=1.0):
    """Torque of a chain with links of 0.3 m, friction and noise, as `Bench.record` takes it."""

    def torque(q, v, a, rng, t):
        tau = chain(q, v, a, mass, 0.3, gravity) + rub(v, coulomb, viscous)
        return times * (tau + rng.normal(0, noise, q.shape))

    return torque
