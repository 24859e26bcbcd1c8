"""Figures of a forecast manoeuvre, with a measured trial where there is one."""

from collections.abc import Iterable, Mapping
from itertools import cycle
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import BLUE, REFERENCE, RUST, house_style, subplots, thinned
from pymc_ship.pages.tables import percent
from pymc_ship.physics.manoeuvre.kinds import OVERSHOOTS, SIDES
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.measured import align_to_first_execute
from pymc_ship.ships.ensemble.scores import BANDS
from pymc_ship.ships.forecasting.track import measured_track, track
from pymc_ship.trial.channels import CHANNELS, default_channels

_FALLEN = 0.5  # heading change [deg] after which an overshoot's peak is passed
SIGNS = "heading [deg], positive to starboard\nrudder [deg], positive to port"
_POINTS = 400
_TRACKS = 40  # draws of a turning circle
_SHOWN = 20.0  # L/U of headings
_LINES = ("-", "--", ":", "-.")
MEASURED: Mapping[str, Any] = {"color": REFERENCE, "lw": 1.0, "label": "measured"}  # line of a measured trial


def manoeuvre_figures(tree: xr.DataTree, vessel: Vessel, measured: xr.Dataset | None = None) -> dict[str, Figure]:
    """Every figure of a forecast, by name: ``track``, ``heading_and_rudder`` and ``motion``."""
    return {
        "track": track(tree, vessel, measured),
        "heading_and_rudder": heading_and_rudder(tree, measured),
        "motion": motion(tree, measured),
    }


@house_style
def heading_and_rudder(tree: xr.DataTree, measured: xr.Dataset | None = None) -> Figure:
    """Heading and rudder [deg] of a forecast against time: band, median and measured trial (some channels suffice).

    A zigzag has both on one axis, with the switching headings, the overshoots with their intervals at the peaks of the
    median ship, and the measured peaks.
    """
    swings = kind_named(tree.attrs["manoeuvre"]).swings
    trial = None if measured is None else align_to_first_execute(measured)
    fig, axes = subplots(8.0, 4.2 if swings else 4.6, 1 if swings else 2, 1, sharex=True)
    upper, lower = axes[0, 0], axes[-1, 0]
    if swings:
        _panel(upper, tree, "psi", trial, mark="heading: ")
        _panel(upper, tree, "delta", trial, colour=RUST, mark="rudder: ")
        _overshoots(upper, tree, trial)
        upper.set_ylabel(SIGNS)
    else:
        _panel(upper, tree, "psi", trial)
        _panel(lower, tree, "delta", trial)
        upper.set_ylabel(f"{CHANNELS['psi'].axis}\npositive to starboard")
        lower.set_ylabel(f"{CHANNELS['delta'].axis}\npositive to port")
    lower.set_xlabel("time from the rudder's execution [s]")
    lower.set_xlim(0.0, float(tree["bands"].dataset["time"][-1]))
    legend_above(fig, [upper], 4)
    return fig


def legend_above(fig: Figure, axes: Iterable[Axes], ncols: int | None = None) -> None:
    """One legend above a figure for the labels of axes, the measured trial last; all in one row by default."""
    handles = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if "measured" in handles:
        handles["measured"] = handles.pop("measured")
    fig.legend(handles.values(), handles, loc="outside upper center", ncols=ncols or len(handles))


@house_style
def overview(
    forecasts: Mapping[str, xr.DataTree], vessel: Vessel, measured: Mapping[str, xr.Dataset] | None = None
) -> Figure:
    """Turning circles [L] and headings of other manoeuvres [deg] of forecasts by label, with their measured trials.

    Colours are sides, lines are angles. Circles are drawn for their first round, headings for 20 L/U.
    """
    circles = {name: tree for name, tree in forecasts.items() if kind_named(tree.attrs["manoeuvre"]).circles}
    others = {name: tree for name, tree in forecasts.items() if name not in circles}
    fig, axes = subplots(8.0, 3.9, 1, bool(circles) + bool(others))
    panels, measured = list(axes[0]), measured or {}
    if circles:
        _circles(panels[0], circles, vessel, measured)
    if others:
        _headings(panels[-1], others, vessel, measured)
    legend_above(fig, panels, 4)
    return fig


def _styles(forecasts: Mapping[str, xr.DataTree]) -> dict[str, dict[str, Any]]:
    sides = {"port": RUST, "starboard": BLUE}
    angles = {name: tree.attrs["label"].removesuffix(tree.attrs["side"]) for name, tree in forecasts.items()}
    lines = dict(zip(dict.fromkeys(angles.values()), cycle(_LINES), strict=False))
    return {
        name: {"color": sides[tree.attrs["side"]], "ls": lines[angles[name]], "label": tree.attrs["label"]}
        for name, tree in forecasts.items()
    }


def _circles(
    ax: Axes, forecasts: Mapping[str, xr.DataTree], vessel: Vessel, measured: Mapping[str, xr.Dataset]
) -> None:
    L = vessel.particulars.L
    for name, style in _styles(forecasts).items():
        tree = forecasts[name]
        ships = thinned(tree["trajectories"].to_dataset(), _POINTS)
        faint = {"color": style["color"], "lw": 0.4, "alpha": 0.3}
        faint["label"] = "draws" if ships.sizes["draw"] > 1 else None
        lines: list[tuple[xr.Dataset, Mapping[str, Any]]]
        lines = [(ships.isel(draw=draw), faint) for draw in range(min(ships.sizes["draw"], _TRACKS))]
        lines.append((ships.isel(draw=tree.attrs["median_draw"]), style | {"lw": 1.6}))
        trial = measured_track(tree, measured.get(name), 360.0)
        if trial is not None:
            lines.append((trial, MEASURED))
        for ship, drawn in lines:
            first_round = np.abs(ship["psi"].values) <= 2.0 * np.pi
            ax.plot(ship["y"].values[first_round] / L, ship["x"].values[first_round] / L, **drawn)
    ax.set(aspect="equal", xlabel="transfer to starboard [L]", ylabel="advance [L]", title="Turning circles")
    ax.plot(0.0, 0.0, "o", ms=4, color=REFERENCE, label="rudder executed")


def _headings(
    ax: Axes, forecasts: Mapping[str, xr.DataTree], vessel: Vessel, measured: Mapping[str, xr.Dataset]
) -> None:
    until = 0.0
    for name, style in _styles(forecasts).items():
        tree = forecasts[name]
        psi = np.rad2deg(tree["bands"].dataset["psi"].sel(band=list(BANDS)))
        until = max(until, float(psi["time"][-1]))
        ax.fill_between(psi["time"], psi[0], psi[2], color=style["color"], alpha=0.18, lw=0)
        ax.plot(psi["time"], psi[1], **style)
        trial = align_to_first_execute(measured[name]) if name in measured else {}
        if "psi" in trial:
            shown = trial["psi"].sel(time=trial["time"] <= float(psi["time"][-1]))
            ax.plot(shown["time"], np.rad2deg(shown), **MEASURED)
    title = f"Headings: median, {percent(tree.attrs['ci_prob'])} band"
    ax.set(xlabel="time from the execute [s]", ylabel="heading change [deg]", title=title)
    ax.set_xlim(0.0, min(until, _SHOWN * vessel.particulars.ship_time))


def overshoot_peaks(ship: xr.Dataset, heading_deg: float, side: str) -> list[tuple[float, float]]:
    """Time [s] and heading [deg] of the peaks beyond the switching heading, to alternate sides."""
    finite = np.isfinite(ship["psi"].values)
    time, psi, peaks = ship["time"].values[finite], np.rad2deg(ship["psi"].values[finite]), []
    sign, begin = SIDES[side], 0
    while (indices := np.flatnonzero(sign * psi[begin:] >= heading_deg)).size:
        begin += int(indices[0])
        beyond = sign * psi[begin:]
        back = np.flatnonzero(np.maximum.accumulate(beyond) - beyond > _FALLEN)
        if not back.size:
            break
        peak = begin + int(np.argmax(beyond[: back[0]]))
        peaks.append((float(time[peak]), float(psi[peak])))
        begin, sign = begin + int(back[0]), -sign
    return peaks


def _overshoots(ax: Axes, tree: xr.DataTree, trial: xr.Dataset | None) -> None:
    """Switching headings, overshoots of the forecast with their intervals, and the measured peaks."""
    heading, side = tree.attrs["heading_deg"], tree.attrs["side"]
    for k, level in enumerate((heading, -heading)):
        label = "switching headings" if k == 0 else None
        ax.axhline(level, color=REFERENCE, lw=0.7, ls="--", label=label)
    ship = tree["trajectories"].to_dataset().isel(draw=tree.attrs["median_draw"])
    sign, bands = SIDES[side], tree["index_bands"].to_dataset()
    for k, (name, (when, _)) in enumerate(zip(OVERSHOOTS, overshoot_peaks(ship, heading, side), strict=False)):
        values = bands[name]
        lower, median, upper = (heading + float(values.sel(band=band)) for band in BANDS)
        error = np.array([[median - lower], [upper - median]])[:: int(sign)]
        label = "overshoot with its interval" if k == 0 else None
        style: dict[str, Any] = {"fmt": "o", "ms": 5, "color": BLUE, "mec": "white", "capsize": 3, "zorder": 4}
        ax.errorbar(when, sign * median, error, label=label, **style)
        away, side_of_text = (8, "bottom") if sign > 0.0 else (-8, "top")
        settings: dict[str, Any] = {"ha": "center", "va": side_of_text, "fontsize": 8.0, "color": BLUE}
        text = f"{float(values.sel(band='median')):.1f}°"
        ax.annotate(text, (when, sign * upper), (0, away), textcoords="offset points", **settings)
        sign = -sign
    if trial is not None and "psi" in trial:
        until = trial.sel(time=trial["time"] <= float(tree["bands"].dataset["time"][-1]))
        if peaks := overshoot_peaks(until, heading, side):
            style = {"ms": 5, "color": REFERENCE, "mec": "white", "zorder": 5}
            ax.plot(*zip(*peaks, strict=True), "D", label="measured peak", **style)
    ax.margins(y=0.12)


@house_style
def motion(tree: xr.DataTree, measured: xr.Dataset | None = None) -> Figure:
    """Velocities, yaw rate, roll (where there is one) and rudder against time: band, median and measured trial."""
    bands = tree["bands"].to_dataset()
    names = [*(name for name in default_channels() if name in bands), "delta"]
    trial = None if measured is None else align_to_first_execute(measured)
    rows = len(names) // 2
    fig, axes = subplots(8.0, 1.9 * rows + 0.6, rows, 2, sharex=True)
    for ax, name in zip(axes.flat, names, strict=True):
        _panel(ax, tree, name, trial)
        ax.set_ylabel(CHANNELS[name].axis)
        ax.set_xlim(0.0, float(bands["time"][-1]))
    for ax in axes[-1]:
        ax.set_xlabel("time from the rudder's execution [s]")
    legend_above(fig, axes.flat, 3)
    return fig


def _panel(
    ax: Axes, tree: xr.DataTree, name: str, trial: xr.Dataset | None, *, colour: str = BLUE, mark: str = ""
) -> None:
    bands = thinned(tree["bands"].to_dataset()[[name]], _POINTS)
    factor = CHANNELS[name].unit.display_factor
    lower, median, upper = factor * bands[name].sel(band=list(BANDS)).values
    band_label = f"{mark}{percent(tree.attrs['ci_prob'])} band"
    ax.fill_between(bands["time"], lower, upper, color=colour, alpha=0.22, lw=0, label=band_label)
    ax.plot(bands["time"], median, color=colour, label=f"{mark}median")
    if trial is not None and name in trial:
        trial_samples = thinned(trial[[name]].sel(time=trial["time"] <= float(bands["time"][-1])), _POINTS)
        ax.plot(trial_samples["time"], factor * trial_samples[name], **MEASURED)
