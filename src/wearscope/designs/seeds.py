"""Random streams keyed by what they are for, never by when they are drawn."""

import hashlib

import numpy as np


def seed_for(root: int, *identity: object) -> np.random.SeedSequence:
    """Seed sequence of one named thing.

    Parameters
    ----------
    root : int
        The study's root seed, non-negative; 0 is a seed like any other.
    *identity : objects with a stable ``str``
        E.g. ``"snr", robot, cycle, axis, fda``. Equal identities give equal streams, whatever else is drawn.

    Returns
    -------
    numpy.random.SeedSequence
    """
    text = "\x1f".join(str(part) for part in identity)
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return np.random.SeedSequence([int(root), *np.frombuffer(digest[:16], dtype="<u4").tolist()])


def generator_for(root: int, *identity: object) -> np.random.Generator:
    """PCG64 generator of one named thing; see `seed_for`."""
    return np.random.Generator(np.random.PCG64(seed_for(root, *identity)))
