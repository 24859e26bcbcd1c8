"""Figures of a sea trial: tracks of turning circles, headings of zigzags, steady turns of spiral tests."""

from collections.abc import Mapping
from itertools import cycle

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import BLUE, NOISE, REFERENCE, RUST, house_style, subplots
from pymc_ship.records.steering.current import DriftCurrent
from pymc_ship.records.steering.measured import align_to_first_execute, denoise_motion
from pymc_ship.ships.forecasting.figures import legend_above
from pymc_ship.ships.forecasting.steady_turns import draw_curve
from pymc_ship.ships.sea_trials.corrections import without_current

_COLUMNS = 3


@house_style
def circles(trials: Mapping[str, xr.Dataset], currents: Mapping[str, DriftCurrent], L: float) -> Figure:
    """Tracks of turning circles from the execution on [L], as measured and without current."""
    fig, axes = _grid(len(trials), 3.0)
    for ax, (name, trial) in zip(axes, trials.items(), strict=False):
        smooth, label = denoise_motion(trial), "as measured"
        track = align_to_first_execute(smooth)
        if name in currents and currents[name].velocity.any():
            ax.plot(track["y"] / L, track["x"] / L, color=NOISE, label=label)
            track = align_to_first_execute(without_current(smooth, currents[name].velocity))
            label = "without the drift"
        ax.plot(track["y"] / L, track["x"] / L, color=BLUE, label=label)
        ax.plot(0.0, 0.0, "o", ms=4, color=RUST, label="rudder put over")
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_title(name, parse_math=False)
        ax.set(xlabel="transfer to starboard [L]", ylabel="advance [L]")
    legend_above(fig, axes)
    return fig


@house_style
def swings(trials: Mapping[str, xr.Dataset], switching: Mapping[str, float]) -> Figure:
    """Heading and rudder angle of zigzags against time from the execution, with the switching headings."""
    fig, axes = _grid(len(trials), 2.4)
    for ax, (name, trial) in zip(axes, trials.items(), strict=False):
        run = align_to_first_execute(denoise_motion(trial))
        for level in (-switching[name], switching[name]):
            ax.axhline(level, color=REFERENCE, ls="--", lw=0.8, label="switching heading" if level > 0.0 else None)
        ax.plot(run["time"], np.rad2deg(run["psi"]), color=BLUE, label="heading, positive to starboard")
        ax.plot(run["time"], np.rad2deg(run["delta"]), color=RUST, lw=0.9, label="rudder angle, positive to port")
        ax.set_title(name, parse_math=False)
        ax.set(xlabel="time [s]", ylabel="angle [deg]")
    legend_above(fig, axes)
    return fig


@house_style
def spirals(measured: Mapping[str, xr.Dataset], turns: xr.Dataset | None) -> Figure:
    """Steady rates of spiral tests against the rudder angle, and those of the identified ship."""
    fig, axes = subplots(8.0, 4.4)
    ax = axes[0, 0]
    draw_curve(ax, turns)
    for (name, test), colour in zip(measured.items(), cycle((RUST, REFERENCE)), strict=False):
        ax.plot(test["delta"], test["r"], "o-", ms=4, lw=0.7, color=colour, label=f"{name}, measured")
    ax.legend(loc="upper right")
    return fig


def _grid(n: int, height: float) -> tuple[Figure, list]:
    columns = min(n, _COLUMNS)
    rows = -(-n // columns)
    fig, axes = subplots(8.0, height * rows + 0.4, rows, columns)
    for ax in axes.flat[n:]:
        ax.set_axis_off()
    return fig, list(axes.flat)
