"""An arm of two joints in a vertical plane: its URDF and motions of it."""

import numpy as np

URDF = """<robot name="duo">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0.02"/><mass value="12"/>
    <inertia ixx="0.05" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.15 0.01 0"/><mass value="6"/>
    <inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="500" velocity="6"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.45 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="300" velocity="6"/></joint>
</robot>"""
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
