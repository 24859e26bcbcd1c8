"""Figures of a population of ships: what its intervals hold, with standard errors over ships."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.experiments.figures import COLOURS, MARKERS
from pymc_ship.pages.drawing import BLUE, REFERENCE, RUST, house_style, subplots
from studies.population.coverage import Columns, statements, where


@house_style
def reliability(columns: Columns) -> Figure:
    """Share of the statements "at most" and "at least" that held, by the probability they were made with."""
    fig, axes = subplots(4.6, 3.9)
    ax, stated = axes[0, 0], np.linspace(0.5, 0.995, 100)
    ax.plot(stated, stated, color=REFERENCE, ls="--", lw=0.9, label="as stated")
    far = columns["beyond"] >= 1.0
    for label, colour, mask in (("within one range of the runs", BLUE, ~far), ("beyond", RUST, far)):
        if mask.any():
            rows = statements(where(columns, mask), stated)
            share, error = np.array([(row["share"], row["se"]) for row in rows]).T
            ax.plot(stated, share, color=colour, label=label)
            ax.fill_between(stated, share - error, np.minimum(share + error, 1.0), color=colour, alpha=0.2, lw=0.0)
    ax.set_xlabel("probability stated")
    ax.set_ylabel("share that held")
    ax.legend(loc="upper left")
    return fig


@house_style
def coverage_by_index(rows: Sequence[Mapping]) -> Figure:
    """Share of every index in its intervals of 95 and 50 %, with two standard errors over ships.

    ``rows`` are those of :func:`studies.population.coverage.by` by index.
    """
    place = np.arange(len(rows))[::-1]
    fig, axes = subplots(7.5, 0.8 + 0.24 * len(rows))
    ax = axes[0, 0]
    for level, colour, marker in ((95, BLUE, "o"), (50, RUST, "s")):
        share, error = np.array([(row[f"hold_{level}"], row[f"hold_{level}_se"]) for row in rows]).T
        bars = 2.0 * np.nan_to_num(error)
        ends = np.minimum(bars, share), np.minimum(bars, 100.0 - share)
        style = {"color": colour, "ls": "none", "ms": 4.0, "elinewidth": 0.8, "capsize": 2.0}
        ax.errorbar(share, place, xerr=ends, marker=marker, label=f"intervals of {level} %", **style)
        ax.axvline(level, color=colour, ls="--", lw=0.9)
    ax.set_yticks(place, [row["group"] for row in rows])
    ax.set_xlim(0.0, 101.0)
    ax.set_xlabel("share of the ships inside [%]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


@house_style
def motion_by_lead(rows: Sequence[Mapping]) -> Figure:
    """Share of the motion in bands of 90 % by the time since a restart, a line a state, with two standard errors.

    ``rows`` are those of :func:`studies.population.coverage.motion_rows` by lead [L/U].
    """
    fig, axes = subplots(5.6, 3.6)
    ax, states = axes[0, 0], list(dict.fromkeys(row["state"] for row in rows))
    for k, name in enumerate(states):
        mine = [(row["group"], row["hold_90"], row["se"]) for row in rows if row["state"] == name]
        lead, share, error = np.array(mine).T
        style = {"color": COLOURS[k], "marker": MARKERS[k], "ms": 4.0, "elinewidth": 0.8, "capsize": 2.0}
        offset = 0.12 * (k - 0.5 * (len(states) - 1))
        bars = 2.0 * np.nan_to_num(error)
        ax.errorbar(lead + offset, share, (bars, np.minimum(bars, 100.0 - share)), label=name, **style)
    ax.axhline(90.0, color=REFERENCE, ls="--", lw=0.9)
    ax.set_xlabel("time since the restart [L/U]")
    ax.set_ylabel("instants in bands of 90 % [%]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=len(states))
    return fig
