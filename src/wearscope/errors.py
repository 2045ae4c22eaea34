"""The one exception that a user of the platform is meant to read."""


class InputError(ValueError):
    """Bad input, told in one sentence: the file, field or row, what is wrong, and the remedy."""
