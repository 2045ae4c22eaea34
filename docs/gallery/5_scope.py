"""The variation that a detector tolerates.

The share of cells that meet the requirement, by wear increase and temperature variation.
"""

import wearscope

study = wearscope.Study("results/quick")
figure = study.plot("scope", factor="w3")
