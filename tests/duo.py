"""An arm of two joints in a vertical plane: its URDF and motions of it."""

import numpy as np
from urdf_texts import Joint, describe_robot

URDF = describe_robot(
    Joint("a", "0 1 0", 12, "0.2 0 0.02", "0.05 0.3 0.3", limits="-3 3 500 6"),
    Joint("b", "0 1 0", 6, "0.15 0.01 0", "0.02 0.1 0.1", "0.45 0 0", limits="-3 3 300 6"),
)
JOINTS = ["a", "b"]


def draw_motion(rng: np.random.Generator, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Band-limited motion of both joints with a dwell-free slow start."""
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for j in range(2):
        for k in range(1, 7):
            w = 2 * np.pi * k / 9.0
            size, phase = rng.normal(0.0, 0.5 / k), rng.uniform(0, 2 * np.pi)
            q[:, j] += size * np.sin(w * t + phase)
            v[:, j] += size * w * np.cos(w * t + phase)
            a[:, j] -= size * w**2 * np.sin(w * t + phase)
    return q, v, a
