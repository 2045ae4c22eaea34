"""How a detector responds to wear.

The test quantity of the friction fit: the surrogate's 95 % interval, and the simulated runs.
"""

import matplotlib.pyplot as plt

import wearscope

study = wearscope.Study("results/quick")
line = study.table("responses", fda="C", factor="f", axis=2)
runs = study.table("simulated", fda="C", factor="f", axis=2)
figure, ax = plt.subplots(layout="constrained")
ax.fill_between(line.natural, line.low, line.high, alpha=0.3)
ax.plot(runs.natural, runs.y_held, ".", label="simulated, other factors removed")
ax.set(xlabel="wear of axis 2", ylabel="test quantity [N m]")
