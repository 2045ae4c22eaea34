"""Wear or temperature.

Both change the friction torque of a joint, and over speed they look alike except near rest.
"""

import matplotlib.pyplot as plt

import wearscope

new, worn, cold = (
    wearscope.simulate("medium", "axis_sweeps", wear=wear, temperature=temperature)
    for wear, temperature in ((0, 50), (40, 50), (0, 35))
)
rows = (new.joint == "axis_2") & (new.qd.abs() > 0.01)
figure, ax = plt.subplots(layout="constrained")
ax.plot(new.qd[rows], worn.tau[rows] - new.tau[rows], ".", label="worn")
ax.plot(new.qd[rows], cold.tau[rows] - new.tau[rows], ".", label="15 °C colder")
ax.set(xlabel="speed [rad/s]", ylabel="change of torque [N m]")
ax.legend()
