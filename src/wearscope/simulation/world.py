"""The PyBullet world: a robot with all but rigid-body dynamics switched off, and a self-test of that."""

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from wearscope.errors import SelfTestError, SimulationError
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.spatial import Array
from wearscope.simulation.chain import write_plant_urdf

#: Beginning of the line that PyBullet prints when it is imported.
BANNER = b"pybullet build time:"


@contextmanager
def drop_banner() -> Iterator[None]:
    """Catch the output to standard error, also of C code, and then print all of it but PyBullet's banner.

    The output is printed also where the body raises. Without a standard error or a temporary file, nothing is
    caught.
    """
    try:
        held = tempfile.TemporaryFile()
        kept = os.dup(2)
    except OSError:
        yield
        return
    _flush()
    with held:
        os.dup2(held.fileno(), 2)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, 2)
            os.close(kept)
            held.seek(0)
            for line in held:
                if not line.startswith(BANNER):
                    os.write(2, line)


def _flush() -> None:
    if sys.stderr is not None:
        sys.stderr.flush()


with drop_banner():
    import pybullet


#: Speed limit for PyBullet [rad/s or m/s], above that of any joint; by default it clips speeds at 100 rad/s.
MAX_JOINT_VELOCITY = 1e6
#: Largest relative difference between the applied torque and inverse dynamics in the self-test.
SELF_TEST_TOLERANCE = 1e-9


class World:
    """A PyBullet client without display, holding one robot at a time.

    Use as a context manager, or call `close`.
    """

    def __init__(self) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        if self.client < 0:
            raise SimulationError("PyBullet gives no further client; close worlds that are no longer used.")
        # Nothing collides: with a plain list of bodies a step takes a sixth less time than with a box tree.
        pybullet.resetSimulation(pybullet.RESET_USE_SIMPLE_BROADPHASE, physicsClientId=self.client)
        self.body = -1

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def load(self, urdf_text: str, joints: Sequence[str], gravity: Sequence[float], dt: float) -> None:
        """Build the robot anew, so that a run does not depend on the runs before it.

        Parameters
        ----------
        urdf_text : str
            Normalised URDF with the payload on its last link.
        joints : sequence of str (n,)
            Joints in the order of every array.
        gravity : sequence of 3 float
            [m/s^2]
        dt : float
            Step [s].
        """
        self.joints = list(joints)
        c = self.client
        if self.body >= 0:
            pybullet.removeBody(self.body, physicsClientId=c)
        pybullet.setGravity(*gravity, physicsClientId=c)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=dt,
            numSubSteps=0,
            deterministicOverlappingPairs=1,
            enableFileCaching=0,
            physicsClientId=c,
        )
        handle, path = tempfile.mkstemp(suffix=".urdf")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(urdf_text)
            self.body = pybullet.loadURDF(
                path,
                useFixedBase=True,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_MAINTAIN_LINK_ORDER,
                physicsClientId=c,
            )
        finally:
            os.unlink(path)
        found = {
            pybullet.getJointInfo(self.body, index, physicsClientId=c)[1].decode(): index
            for index in range(pybullet.getNumJoints(self.body, physicsClientId=c))
        }
        self.indices = tuple(found[name] for name in self.joints)
        for index in [-1, *self.indices]:
            pybullet.changeDynamics(
                self.body,
                index,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                maxJointVelocity=MAX_JOINT_VELOCITY,
                physicsClientId=c,
            )
        # PyBullet gives every joint a velocity motor that brakes it; a force limit of 0 switches it off.
        pybullet.setJointMotorControlArray(
            self.body,
            self.indices,
            pybullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self.indices),
            physicsClientId=c,
        )

    def set_state(self, q: Array, v: Array) -> None:
        """Put the joints at position `q` and speed `v` (n,)."""
        pybullet.resetJointStatesMultiDof(
            self.body,
            self.indices,
            [[float(x)] for x in q],
            [[float(x)] for x in v],
            physicsClientId=self.client,
        )

    def read_state(self) -> tuple[Array, Array]:
        """Position and speed (n,) of the joints."""
        states = pybullet.getJointStates(self.body, self.indices, physicsClientId=self.client)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def advance(self, torques: Array) -> None:
        """Take K steps, each with one row of the joint torques (K, n)."""
        body, indices, mode, client = self.body, self.indices, pybullet.TORQUE_CONTROL, self.client
        apply, step = pybullet.setJointMotorControlArray, pybullet.stepSimulation
        for row in zip(*torques.T.tolist(), strict=True):
            # The arguments are positions, speeds, forces and gains; torque control reads the forces alone.
            # Keyword arguments would take a quarter more time.
            apply(body, indices, mode, row, row, row, row, row, client)
            step(client)

    def close(self) -> None:
        """Disconnect the PyBullet client."""
        if self.client >= 0:
            pybullet.disconnect(physicsClientId=self.client)
            self.client = -1


def prove_world(world: World, body: RigidBody, dt: float) -> float:
    """Test that PyBullet adds nothing to rigid-body dynamics.

    A torque is applied at random states. It must equal Pinocchio's inverse dynamics at the acceleration that
    the change of PyBullet's speed over one step gives.

    Parameters
    ----------
    world : World
        The robot stays loaded in it.
    body : RigidBody
        With its payload.
    dt : float
        Step [s].

    Returns
    -------
    float
        Largest relative difference.

    Raises
    ------
    SelfTestError
        Where the difference exceeds `SELF_TEST_TOLERANCE`.
    """
    world.load(write_plant_urdf(body), body.names, body.gravity, dt)
    rng = np.random.default_rng(np.random.SeedSequence(entropy=0))
    worst = 0.0
    for _ in range(20):
        q, v = rng.uniform(-1.5, 1.5, body.n), rng.uniform(-2.0, 2.0, body.n)
        torque = body.inverse_dynamics(q, v, rng.uniform(-5.0, 5.0, body.n))
        world.set_state(q, v)
        world.advance(torque[None, :])
        arrived, speed = world.read_state()
        needed = body.inverse_dynamics(q, v, (speed - v) / dt)
        size = np.abs(torque).max()
        worst = max(
            worst,
            float(np.abs(needed - torque).max() / size),
            float(np.abs(arrived - (q + dt * speed)).max() / (1.0 + np.abs(q).max())),
        )
    if not worst <= SELF_TEST_TOLERANCE:
        raise SelfTestError(
            f"self-test: the torque applied in PyBullet differs from inverse dynamics by {worst:.2g} of it, "
            f"more than {SELF_TEST_TOLERANCE:g}; PyBullet adds something that the model has not."
        )
    return worst
