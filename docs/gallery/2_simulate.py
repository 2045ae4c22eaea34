"""Simulate one motion, new and worn.

Torque that wear adds at two joints. The same seed gives both runs the same sensor noise.
"""

import matplotlib.pyplot as plt

import wearscope

new, worn = (wearscope.simulate("medium", "axis_sweeps", wear=wear, seed=1) for wear in (0, 50))
figure, ax = plt.subplots(layout="constrained")
for joint in ("axis_1", "axis_2"):
    rows = new.joint == joint
    ax.plot(new.t[rows], worn.tau[rows] - new.tau[rows], label=joint)
ax.set(xlabel="time [s]", ylabel="torque added by wear [N m]")
ax.legend()
