"""Rigid-body dynamics of a normalised URDF, computed by Pinocchio with the joints in the caller's order."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wearscope.errors import InputError
from wearscope.robots.spatial import Array, Inertia
from wearscope.robots.urdf import replace_inertias

N_PARAMETERS = 10  # inertial parameters of a link


@dataclass(frozen=True)
class Payload:
    """A load on the last joint's link.

    Attributes
    ----------
    mass : float
        [kg]
    com : tuple of 3 float
        Centre of mass in the frame of the last joint's link [m].
    inertia : tuple of 6 float
        Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass, along the link's axes [kg m^2].
    """

    mass: float
    com: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def parameters(self) -> Array:
        """Ten inertial parameters (10,) about the link frame, as `RigidBody.payload_regressor` takes them."""
        xx, xy, xz, yy, yz, zz = self.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return Inertia(self.mass, np.array(self.com, dtype=float), tensor).to_parameters()

    def scaled(self, factor: float) -> "Payload":
        """Return the payload with mass and inertia times `factor` and the same centre of mass."""
        return Payload(factor * self.mass, self.com, tuple(factor * value for value in self.inertia))


class RigidBody:
    """Inverse dynamics, mass matrix, bias and inertial regressors of a robot on a fixed base.

    Parameters
    ----------
    urdf_text : str
        Normalised URDF (`wearscope.robots.urdf.normalise_urdf`) with exactly the joints `joints`.
    joints : sequence of str, length n
        Joints in the order of every array.
    gravity : sequence of 3 float
        In the base frame [m/s^2].
    payload : Payload, optional
        Payload fixed to the link of the last joint.

    Notes
    -----
    Each joint's link has ten inertial parameters about the joint's frame, in the order of
    `wearscope.robots.spatial.PARAMETER_NAMES`. `inertial_parameters` are those of the links without the
    payload: torque = inertial_regressor @ inertial_parameters + payload_regressor @ payload.parameters.

    Raises
    ------
    InputError
        Where the URDF's joints are not `joints`.
    """

    def __init__(
        self,
        urdf_text: str,
        joints: Sequence[str],
        gravity: Sequence[float] = (0.0, 0.0, -9.81),
        payload: Payload | None = None,
    ) -> None:
        model = pin.buildModelFromXML(urdf_text)
        found = list(model.names)[1:]
        if sorted(found) != sorted(joints) or model.nq != len(joints):
            raise InputError(
                f"URDF '{model.name}': its one-dof joints are {', '.join(found)}, not {', '.join(joints)}; "
                "normalise it with these joints first."
            )
        self.names = list(joints)
        self.gravity = tuple(float(value) for value in gravity)
        self.payload = payload
        self._urdf_text = urdf_text
        self._model = model
        self._model.gravity.linear = np.array(self.gravity)
        # Pinocchio sorts the joints of a tree by name: `_order[k]` is where it keeps joint k of ours.
        self._order = np.array([model.joints[model.getJointId(name)].idx_v for name in joints])
        self._ids = [model.getJointId(name) for name in joints]
        self._in_order = bool(np.array_equal(self._order, np.arange(len(joints))))
        self._links = np.array([model.inertias[i].toDynamicParameters() for i in self._ids])
        self._nominal = self._links.copy()
        self._load_inertias()

    def _load_inertias(self) -> None:
        """Set Pinocchio's inertias to those of the links and the payload; refuse a mass of 0 or less."""
        totals = self._links.copy()
        if self.payload is not None:
            totals[-1] += self.payload.parameters
        for joint_id, parameters in zip(self._ids, totals, strict=True):
            if not parameters[0] > 0.0:
                name = self._model.names[joint_id]
                raise InputError(
                    f"joint '{name}': its link would weigh {parameters[0]:g} kg; it must be positive."
                )
            self._model.inertias[joint_id] = pin.Inertia.FromDynamicParameters(parameters)
        self._data = self._model.createData()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    def _sorted(self, values: ArrayLike) -> Array:
        """Return values by joint (..., n) in Pinocchio's order."""
        array = np.asarray(values, dtype=float)
        if self._in_order:
            return array
        out = np.empty_like(array)
        out[..., self._order] = array
        return out

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Joint torque of the rigid body, without rotors and friction.

        Parameters
        ----------
        q, v, a : array (n,) or (N, n)
            Joint position, speed, acceleration [rad or m, per s, per s^2].

        Returns
        -------
        array of the same shape
            [N m] or [N].
        """
        q, v, a = self._sorted(q), self._sorted(v), self._sorted(a)
        if q.ndim == 1:
            return pin.rnea(self._model, self._data, q, v, a)[self._order]
        # One call on one thread gives the same bytes as sample by sample. For one joint it returns a vector.
        torque = pin.rneaInParallel(1, pin.ModelPool(self._model, 1), q.T, v.T, a.T)
        out = np.ascontiguousarray(torque.T).reshape(q.shape)
        return out if self._in_order else out[:, self._order]

    @property
    def reach(self) -> float:
        """Sum of the links' lengths [m]; the last link is at least twice as long as to its centre of mass."""
        lengths = np.linalg.norm(np.diff(self.joint_origins(np.zeros(self.n))[0, 1:], axis=0), axis=1)
        mass, *moment = self.inertial_parameters[-10:-6]
        lengths[-1] = max(lengths[-1], 2.0 * float(np.linalg.norm(moment)) / max(mass, 1e-9))
        return float(lengths.sum())

    def joint_origins(self, q: ArrayLike) -> Array:
        """Return the positions of the joints (forward kinematics).

        Parameters
        ----------
        q : array (N, n)
            Joint positions [rad or m].

        Returns
        -------
        array (N, n + 2, 3)
            Positions in the base frame [m]: the base, the joints in order, and the end of the chain. The end
            is the point farthest from the last joint among the frames on its link and the payload's centre
            of mass.
        """
        rows = self._sorted(np.atleast_2d(np.asarray(q, dtype=float)))
        last = self._ids[-1]
        frames = [frame.placement.translation for frame in self._model.frames if frame.parentJoint == last]
        if self.payload is not None:
            frames.append(np.asarray(self.payload.com, dtype=float))
        end = max(frames, key=lambda one: float(np.linalg.norm(one)), default=np.zeros(3))
        out = np.zeros((len(rows), self.n + 2, 3))
        for row, posture in enumerate(rows):
            pin.forwardKinematics(self._model, self._data, posture)
            out[row, 1:-1] = [self._data.oMi[i].translation for i in self._ids]
            out[row, -1] = self._data.oMi[last].act(end)
        return out

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space mass matrix (n, n), symmetric to the last bit."""
        upper = np.triu(pin.crba(self._model, self._data, self._sorted(q)))
        full = upper + np.triu(upper, 1).T
        return full if self._in_order else full[np.ix_(self._order, self._order)]

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Coriolis, centrifugal and gravity torque (n,)."""
        return pin.nonLinearEffects(self._model, self._data, self._sorted(q), self._sorted(v))[self._order]

    def inertial_regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Regressor (N, n, 10 n) of the links' inertial parameters; (n, 10 n) for one sample (n,)."""
        return self._regress(self._ids, q, v, a)

    def add_to_links(self, parameters: ArrayLike, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return the torque (N, n) by which additional inertial parameters (10 n,) change that of the links.

        It equals ``inertial_regressor(q, v, a) @ parameters`` and is several times faster.
        """
        other = self._copy()
        changes = np.reshape(parameters, (self.n, N_PARAMETERS))
        for joint_id, change in zip(self._ids, changes, strict=True):
            total = self._model.inertias[joint_id].toDynamicParameters() + change
            other._model.inertias[joint_id] = pin.Inertia.FromDynamicParameters(total)
        return other.inverse_dynamics(q, v, a) - self.inverse_dynamics(q, v, a)

    def payload_regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Regressor (N, n, 10) of a payload on the last joint's link; (n, 10) for one sample."""
        return self._regress(self._ids[-1:], q, v, a)

    def _regress(self, ids: Sequence[int], q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return the regressor (N, n, 10 L) of L links, which `ids` gives as Pinocchio's joint indices."""
        single = np.ndim(q) == 1
        q, v, a = (np.atleast_2d(self._sorted(x)) for x in (q, v, a))
        columns = np.concatenate([np.arange(N_PARAMETERS) + N_PARAMETERS * (one - 1) for one in ids])
        # Where the joints are in Pinocchio's order, a slice is a view and costs next to nothing.
        view = (..., slice(columns[0], columns[-1] + 1))
        pick = view if self._in_order else np.ix_(self._order, columns)
        out = np.empty((len(q), self.n, len(columns)))
        for row, sample in enumerate(zip(q, v, a, strict=True)):
            out[row] = pin.computeJointTorqueRegressor(self._model, self._data, *sample)[pick]
        return out[0] if single else out

    @property
    def inertial_parameters(self) -> Array:
        """Inertial parameters (10 n,) of the links without the payload, ten for each link."""
        return self._links.ravel().copy()

    def with_inertial_parameters(self, parameters: ArrayLike) -> "RigidBody":
        """Return the same robot with other link parameters (10 n,) and the same payload.

        Raises
        ------
        InputError
            Where the mass of a link with its payload would not be positive.
        """
        other = self._copy()
        other._links = np.array(parameters, dtype=float).reshape(self.n, N_PARAMETERS)
        other._load_inertias()
        return other

    def with_gravity(self, gravity: Sequence[float]) -> "RigidBody":
        """Return the same robot under another gravity in the base frame [m/s^2]."""
        other = self._copy()
        other.gravity = tuple(float(value) for value in gravity)
        other._model.gravity.linear = np.array(other.gravity)
        other._load_inertias()
        return other

    def with_payload(self, payload: Payload | None) -> "RigidBody":
        """Return the same robot with another payload in place of its own."""
        other = self._copy()
        other.payload = payload
        other._load_inertias()
        return other

    def _copy(self) -> "RigidBody":
        """Return a copy with a Pinocchio model of its own."""
        other = RigidBody.__new__(RigidBody)
        other.__dict__.update(self.__dict__)
        other._model = self._model.copy()
        return other

    def __getstate__(self) -> dict:
        """Pickle the arguments and the parameters; Pinocchio's objects are built again from them."""
        return {
            "arguments": (self._urdf_text, self.names, self.gravity, self.payload),
            "parameters": self._links,
        }

    def __setstate__(self, state: dict) -> None:
        """Build Pinocchio's objects again."""
        RigidBody.__init__(self, *state["arguments"])
        self._links = state["parameters"]
        self._load_inertias()

    def urdf_text(self) -> str:
        """Return the normalised URDF with the current parameters of the links, without the payload."""
        changed = {
            name: Inertia.from_parameters(parameters)
            for name, parameters, nominal in zip(self.names, self._links, self._nominal, strict=True)
            if not np.array_equal(parameters, nominal)
        }
        return replace_inertias(self._urdf_text, changed) if changed else self._urdf_text
