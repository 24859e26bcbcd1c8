"""A table of a regression, and a stand-in for a DataFrame."""

from __future__ import annotations

import numpy as np


class Table:
    """What the package asks of a DataFrame: names, values and an index."""

    def __init__(self, **columns):
        self.columns = list(columns)
        self.values = np.array(list(columns.values()), dtype=object).T
        self.index = range(len(self.values))

    def to_numpy(self):
        return self.values


def motion(n_rows=60, seed=1):
    """Variables v, r, delta and a response Y by column; Y = 1 + 2 v - 3 r + 4 v r + 5 delta^2 + 0.1 e."""
    rng = np.random.default_rng(seed)
    v, r, delta = rng.standard_normal((3, n_rows))
    y = 1.0 + 2.0 * v - 3.0 * r + 4.0 * v * r + 5.0 * delta**2 + 0.1 * rng.standard_normal(n_rows)
    return {"Y": y, "v": v, "r": r, "delta": delta}
