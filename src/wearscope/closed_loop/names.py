"""Names of the files that a closed loop leaves, for whoever only needs to know where they are."""


def drawn_path(stage: str, number: int) -> str:
    """Path of a drawn model in the folder of its loop; `stage` is before or after, `number` from 1."""
    return f"drawn/{stage}-{number:02d}.yaml"
