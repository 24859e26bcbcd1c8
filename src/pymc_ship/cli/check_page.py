"""The page of ``check``: columns, track, heading and rudder, checks and indices of one trial file, in one file."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.cli.texts import check_rows
from pymc_ship.pages.drawing import BLUE, REFERENCE, RUST, house_style, subplots, thinned
from pymc_ship.pages.page import Content, Page, render_page
from pymc_ship.pages.tables import number, table
from pymc_ship.physics.manoeuvre.steering_record import first_execute
from pymc_ship.records.checks.verdicts import Check

_PAGE = Page(
    "check.html",
    Path(__file__).with_name("check_page.html.j2"),
    packages=("pymc-ship", "numpy", "scipy", "pywavelets", "xarray", "matplotlib"),
)
_SOURCES = ("IMO (2002), Standards for ship manoeuvrability, resolution MSC.137(76).",)
_POINTS = 2000  # of a line in a figure
_MARKS = 8  # positions on the track with their time
_ROUND = (1.0, 2.0, 5.0, 10.0)


def check_page(
    name: str,
    trial: xr.Dataset,
    checks: Iterable[Check],
    tables: Mapping[str, tuple[Sequence[str], Sequence[Sequence[Any]]]],
    sentences: Mapping[str, str],
    *,
    command: str,
) -> str:
    """Text of the page of a file: the trial after its corrections, its checks, tables as head and rows, sentences."""
    shown = {**tables, "checks": (("check", "verdict", "finding"), check_rows(checks))}
    formatted = {
        key: table(
            [dict(zip(head, row, strict=True)) for row in rows],
            {one: (one, number(4) if one == "measured" else str) for one in head},
        )
        for key, (head, rows) in shown.items()
    }
    changes = [line for line in trial.attrs["reading"].splitlines() if not line.startswith("Columns ")]
    values = {"name": name, "tables": formatted, "sentences": sentences, "changes": changes, "command": command}
    execute = first_execute(trial) if "delta" in trial and trial["delta"].values.any() else None
    figures: dict[str, Figure | str] = {}
    if {"x", "y"} <= set(trial):
        figures["track"] = _track(trial, execute)
    if {"psi", "delta"} & set(trial):
        figures["heading_and_rudder"] = _heading_and_rudder(trial, execute)
    return render_page(_PAGE, Content(values, figures, sources=_SOURCES))


@house_style
def _track(trial: xr.Dataset, execute: float | None) -> Figure:
    """Track seen from above, north up, with times, and the point at which the rudder is first put over."""
    time, x, y = (trial[name].values for name in ("time", "x", "y"))
    fig, axes = subplots(8.0, 6.0)
    ax, shown = axes[0, 0], thinned(trial, _POINTS)
    ax.plot(shown["y"], shown["x"], color=BLUE, label="track")
    step = _round_interval(float(np.ptp(time)) / _MARKS)
    for when in np.arange(np.ceil(time[0] / step) * step, time[-1], step):
        north, east = (float(np.interp(when, time, values)) for values in (x, y))
        ax.plot(east, north, ".", color=BLUE, ms=5)
        ax.annotate(f"{when:g} s", (east, north), (4, 3), textcoords="offset points", fontsize=7.5)
    ax.plot(y[0], x[0], "s", ms=5, color=REFERENCE, label="begin of the record")
    if execute is not None:
        where = [float(np.interp(execute, time, values)) for values in (y, x)]
        ax.plot(*where, "o", ms=5, color=RUST, label="rudder first put over")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="y, east [m]", ylabel="x, north [m]")
    ax.legend(loc="best")
    return fig


def _round_interval(interval: float) -> float:
    """Next round number, 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(interval, 1e-9)))
    return float(next(factor * power for factor in _ROUND if factor * power >= interval * (1.0 - 1e-9)))


@house_style
def _heading_and_rudder(trial: xr.Dataset, execute: float | None) -> Figure:
    """Heading and rudder angle against time, each in degrees on axes of its own."""
    labels = {"psi": "heading [deg]\npositive to starboard", "delta": "rudder [deg]\npositive to port"}
    names = [name for name in labels if name in trial]
    fig, axes = subplots(8.0, 2.3 * len(names) + 0.4, len(names), 1, sharex=True)
    for ax, name in zip(axes[:, 0], names, strict=True):
        shown = thinned(trial[[name]], _POINTS)
        ax.plot(shown["time"], np.rad2deg(shown[name]), color=BLUE if name == "psi" else RUST)
        if execute is not None:
            ax.axvline(execute, color=REFERENCE, lw=0.8, ls="--", label="rudder first put over")
        ax.set_ylabel(labels[name])
    axes[-1, 0].set_xlabel("time [s]")
    if execute is not None:
        axes[0, 0].legend(loc="best")
    return fig
