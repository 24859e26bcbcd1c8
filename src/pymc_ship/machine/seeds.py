"""Random generators, one for each purpose."""

from __future__ import annotations

from hashlib import sha256

import numpy as np


def generator(seed: int, *purpose: float | str) -> np.random.Generator:
    """Generator of one purpose, independent of what else runs and in which order."""
    digest = sha256("\n".join(map(str, purpose)).encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest, "little")])
