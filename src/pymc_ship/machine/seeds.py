"""Random generators: from the seed of a caller, and one for each purpose."""

from hashlib import sha256

import numpy as np

from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import ShipError

Seed = int | np.random.SeedSequence | np.random.Generator  # what public functions take as ``rng``


def generator(seed: int, *purpose: float | str) -> np.random.Generator:
    """Generator for one purpose, independent of other purposes and of the order of calls."""
    digest = sha256("\n".join(map(str, purpose)).encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest, "little")])


def random_generator(rng: Seed) -> np.random.Generator:
    """Generator of a :data:`Seed`; a Generator is returned unchanged, anything else is a ValueError."""
    if isinstance(rng, np.random.Generator):
        return rng
    number = isinstance(rng, int | np.integer) and not isinstance(rng, bool) and rng >= 0
    if not number and not isinstance(rng, np.random.SeedSequence):
        raise ShipError(
            f"Random draws need a seed: rng is a whole number from 0 up, a SeedSequence or a Generator of numpy, found "
            f"{short_repr(rng)}; give one such as rng=1."
        )
    return np.random.default_rng(rng)
