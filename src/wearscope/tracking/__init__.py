"""What changed in each session since a machine was healthy; the model's terms stay those of the reference."""
