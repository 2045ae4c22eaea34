"""What a model lacks.

Torque that the model leaves at the shipped example's second axis, before and after the correction.
"""

import matplotlib.pyplot as plt
import pandas as pd

import wearscope

wearscope.diagnose(wearscope.example_dataset()).write("outcome")
rows = pd.read_parquet("outcome/residual.parquet").query("joint == 'axis_2' and counts")
rows = rows[rows.run.str.contains("sweeps")]
figure, ax = plt.subplots(layout="constrained")
ax.plot(rows.t, rows.residual_before, ".", markersize=3, label="before")
ax.plot(rows.t, rows.residual_after, ".", markersize=3, label="after")
ax.set(xlabel="time [s]", ylabel="measured minus predicted [N m]")
ax.legend()
