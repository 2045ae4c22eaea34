"""Sections of the model file as pydantic models."""

from typing import Annotated

from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, NonNegativeFloat, PositiveFloat

from wearscope.robots.dynamics import Payload

Finite = Annotated[float, AllowInfNan(False)]
Positive = Annotated[PositiveFloat, AllowInfNan(False)]
NotNegative = Annotated[NonNegativeFloat, AllowInfNan(False)]


class Section(BaseModel):
    """A section of the model file; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Drive(Section):
    """Drive train, one value for each joint; limits hold on the joint side."""

    gear_ratio: list[Finite] | None = None
    """Motor angle [rad] for a joint rad or m; negative where the motor turns against the joint."""
    rotor_inertia: list[NotNegative] | None = None
    """Inertia of rotor and gear reflected to the joint [kg m^2; kg for a prismatic joint]."""
    torque_limit: list[Positive] | None = None
    """Largest motor torque, as torque at the joint [N m or N]."""
    speed_limit: list[Positive] | None = None
    """Largest joint speed [rad/s or m/s]."""
    acceleration_limit: list[Positive] | None = None
    """Largest joint acceleration of a reference motion [rad/s^2 or m/s^2]."""
    jerk_limit: list[Positive] | None = None
    """Largest joint jerk of a reference motion [rad/s^3 or m/s^3]."""


class Sensors(Section):
    """Sensors of the drive: their resolution, noise and sample rate."""

    encoder_resolution: list[NotNegative] | None = None
    """Step of the recorded position on the joint side [rad or m]; 0 records it exactly."""
    torque_noise: list[NotNegative] | None = None
    """Standard deviation of white noise on the recorded torque [N m or N]."""
    sample_rate: Positive = 250.0
    """Rate of the recording [Hz]."""


class DeclaredPayload(Section):
    """The payload that the controller assumes, in the frame of the last joint's link."""

    mass: NotNegative
    """[kg]"""
    com: Annotated[list[Finite], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Centre of mass [m]."""
    inertia: Annotated[list[Finite], Field(min_length=6, max_length=6)] = [0.0] * 6
    """Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass [kg m^2]."""

    def to_payload(self) -> Payload:
        """Return the payload as `RigidBody` takes it."""
        return Payload(self.mass, tuple(self.com), tuple(self.inertia))


class Controller(Section):
    """Feedback controller of each joint."""

    bandwidth_hz: Positive | list[Positive] = 5.0
    """Natural frequency of the closed position loop [Hz], one for all joints or one for each."""
    damping: Positive = 1.0
    """Damping ratio of the closed position loop."""


class EffectEntry(Section):
    """An effect at a joint, with its parameters and their origin."""

    joint: str
    effect: str
    parameters: dict[str, Finite] = {}
    source: str = "assumed"
    assumed: bool = False
    """Whether the parameters come from another robot or a guess, not from data of this robot."""
    identified: bool = False
    """Whether data of this robot determined the parameters."""
    intervals: dict[str, Annotated[list[Finite], Field(min_length=2, max_length=2)]] = {}
    """95 % interval of each parameter that was identified."""
