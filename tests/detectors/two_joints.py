"""Arm of two joints with the paper's friction law at the first, and its motion through all speeds."""

import numpy as np
from urdf_texts import Joint, describe_robot

from wearscope.detectors.base import Batch
from wearscope.effects.base import Signals, load_effect
from wearscope.robots.model import make_model

URDF = describe_robot(
    Joint("j1", "0 1 0", 8, "0.3 0 0.02", "0.05 0.3 0.3", "0 0 0.5", limits="-3 3 1000 5"),
    Joint("j2", "0 1 0", 4, "0.2 0.01 0", "0.02 0.1 0.1", "0.6 0 0", limits="-3 3 1000 5"),
)
# Bittencourt's magnitudes (paper/notes.md) times 300 N m, at a gear ratio of 100.
LAW = {
    "eta0": 9.3, "eta1": -7.5, "eta2": 0.48, "eta3": -0.2481, "eta4": 0.0098, "eta5": 14.0, "eta6": -0.12,
    "eta7": 0.3, "eta8": 0.005, "eta9": 0.15, "alpha": 1.3,
}  # fmt: skip
MODEL = make_model(
    {
        "name": "two",
        "urdf": "two.urdf",
        "joints": ["j1", "j2"],
        "drive": {"rotor_inertia": [3.0, 2.0]},
        "payload": {"mass": 5.0, "com": [0.4, 0.0, 0.05]},
        "effects": [
            {"joint": "j1", "effect": "torque_offset", "parameters": {"offset": 1.5}},
            {"joint": "j1", "effect": "friction_wear_temperature", "parameters": LAW},
        ],
    },
    URDF,
)
FRICTION = load_effect("friction_wear_temperature")


def simulate(friction=None, wear=0.0, temperature=50.0, payload_factor=1.0, noise=0.0, seed=0, pace=1.0):
    """Motion through both speed bands; torque by inverse dynamics of the true acceleration."""
    t = np.arange(3000) / 250.0
    amplitude, pulsation = np.array([[0.9, 0.7], [0.5, 0.4]]), pace * np.array([[2.2, 1.7], [0.4, 0.31]])
    angle = pulsation[:, None, :] * t[:, None]
    q = (amplitude[:, None, :] * np.sin(angle)).sum(axis=0)
    qd = (amplitude[:, None, :] * pulsation[:, None, :] * np.cos(angle)).sum(axis=0)
    a = -(amplitude[:, None, :] * pulsation[:, None, :] ** 2 * np.sin(angle)).sum(axis=0)
    body = MODEL.rigid_body(MODEL.declared_payload.scaled(payload_factor))
    tau = body.inverse_dynamics(q, qd, a) + MODEL.rotor_inertia * a
    if friction is None:
        signals = Signals.along(t, qd, q, a, tau, temperature, wear)
        tau[:, 0] += FRICTION.torque(signals, 0, LAW) + 1.5
    else:
        tau[:, 0] += friction(qd[:, 0])
    tau += noise * np.random.default_rng(seed).normal(size=tau.shape)
    return Batch(t, q, qd, tau)
