"""What a simulation that cannot be trusted raises."""


class SimulationError(RuntimeError):
    """A run that diverged, left its limits or disagreed with PyBullet, told in one sentence."""


class SelfTestError(SimulationError):
    """PyBullet adds something that the model has not: no run can be trusted, whatever its design point."""
