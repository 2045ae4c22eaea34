"""Friction of a joint over speed.

Cold and warm, new and worn: the friction law of the medium robot's second axis.
"""

import matplotlib.pyplot as plt

from wearscope.robots.friction import friction_curves
from wearscope.robots.model import load_model

curves = friction_curves(load_model("medium"), temperatures=(30, 70), wear=(0, 50))
figure, ax = plt.subplots(layout="constrained")
for (temperature, wear), rows in curves[curves.joint == "axis_2"].groupby(["temperature", "wear"]):
    ax.plot(rows.speed, rows.torque, label=f"{temperature:.0f} °C, wear {wear:.0f}")
ax.set(xlabel="speed [rad/s]", ylabel="friction [N m]")
ax.legend()
