"""Figure of the frontier: the error of every method against the noise level, from the bound down."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import REFERENCE, STYLE, subplots
from studies.frontier.tables import METHODS

LINES = {
    "bound": (REFERENCE, "--", ""),
    "flat prior": ("#7fb3dd", "-", "s"),
    "default prior": ("#1f6fb2", "-", "o"),
    "weak form": ("#3a8f4d", "-", "^"),
    "best differencing": ("#c8551b", "-", "v"),
    "paper's pipeline": ("#7d4fa3", "-", "D"),
}
"""Colour, line and marker of each method."""


def from_the_bound_down(rows: Sequence[dict]) -> Figure:
    """Median coefficient error of each method against the noise level, bars of two standard errors, log-log.

    Parameters
    ----------
    rows : sequence of dict
        From :func:`studies.frontier.tables.bound_down_rows`.

    Returns
    -------
    Figure
    """
    with matplotlib.rc_context(STYLE):
        fig, axes = subplots(7.0, 4.4)
        ax = axes[0, 0]
        for name, label in METHODS.items():
            colour, line, marker = LINES[name]
            mine = [row for row in rows if row["method"] == label]
            level, error, se = np.array([(100.0 * row["level"], row["median_error"], row["se"]) for row in mine]).T
            bars = np.minimum(2.0 * se, 0.9 * error), 2.0 * se
            settings = {"color": colour, "ls": line, "marker": marker, "ms": 4.5, "capsize": 2.0, "elinewidth": 0.8}
            ax.errorbar(level, error, bars, label=label, **settings)
        ax.loglog()
        ax.set_xticks(level, [f"{tick:g}" for tick in level])
        ax.set_xticks([], minor=True)
        ax.set_yticks([1, 10, 100], ["1", "10", "100"])
        ax.set_xlabel("noise level [%]: sd of v over its peak, 0.3 of that on the other channels")
        ax.set_ylabel("median |coefficient error| [%]")
        ax.set_title("container ship, one 20/20 zigzag of 400 s, white noise")
        handles, labels = ax.get_legend_handles_labels()
        fig.legend(handles[::-1], labels[::-1], loc="outside right center")
    return fig
