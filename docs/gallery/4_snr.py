"""The detector that separates wear best.

The signal-to-noise ratio of every cell of a study, with medians and their intervals.
"""

import wearscope

study = wearscope.Study("results/quick")
figure = study.plot("snr")
