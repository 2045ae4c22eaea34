"""What `wearscope new` writes: models, data sets, test-cycles, detectors, effects, studies to start from."""
