"""Files that `wearscope new` writes: robot models, data sets, test-cycles, detectors, effects and studies."""
