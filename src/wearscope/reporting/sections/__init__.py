"""The parts of a study's page: one class and one template each."""
