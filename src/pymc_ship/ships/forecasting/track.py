"""The track of a forecast manoeuvre seen from above, with ship outlines to scale, marks and dimensions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from pymc_ship.pages.drawing import BLUE, REFERENCE, house_style, subplots
from pymc_ship.physics.manoeuvre.kinds import SIDES
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.measured import align_to_first_execute, measured_indices
from pymc_ship.ships.ensemble.scores import BANDS

_HALF_OUTLINE = np.array([(-0.5, 0.36), (-0.42, 0.5), (0.22, 0.5), (0.38, 0.34), (0.46, 0.14)])  # x/L, y/B
_N_TRACKS = 40  # draws whose tracks are drawn
_INTERVALS = (1, 2, 5, 10, 15, 20, 30, 45, 60, 90, 120, 180, 300, 600)
_SPACING, _POINTS, _FIRST_ROUND, _SHOWN_TURN = 1.6, 160, 360.0, 420.0
_ROOM = 0.11  # room for a dimension line and its text, as a fraction of the larger range of the track


def hull(vessel: Vessel, x: float, y: float, psi: float) -> np.ndarray:
    """Outline of the ship at a position [m] and heading [rad]: advance and transfer [L], shape (n_points, 2)."""
    half = np.vstack([_HALF_OUTLINE, [(0.5, 0.0)], (_HALF_OUTLINE * (1.0, -1.0))[::-1]])
    ahead, abeam = half[:, 0], half[:, 1] * vessel.particulars.B / vessel.particulars.L
    c, s = np.cos(psi), np.sin(psi)
    centre = np.array([x, y]) / vessel.particulars.L
    return centre + np.column_stack([c * ahead - s * abeam, s * ahead + c * abeam])


class _Plan:
    """Axes in ship lengths: ahead up and starboard right or, turned, ahead right and starboard down."""

    def __init__(self, ax: Axes, vessel: Vessel, *, turned: bool):
        self.ax, self.vessel, self.turned, self.L = ax, vessel, turned, vessel.particulars.L
        ax.set_aspect("equal")
        labels = ("transfer y/L" if turned else "transfer y/L (to starboard)", "advance x/L")
        ax.set_xlabel(labels[turned])
        ax.set_ylabel(labels[not turned])

    def points(self, advance: Any, transfer: Any) -> tuple[Any, Any]:
        """Coordinates on the axes."""
        return (advance, transfer) if self.turned else (transfer, advance)

    def line(self, ship: xr.Dataset, **style: Any) -> None:
        """Track of a ship."""
        thinned = ship.isel(time=slice(None, None, max(1, ship.sizes["time"] // _POINTS)))
        x, y = (thinned[name].values / self.L for name in ("x", "y"))
        self.ax.plot(*self.points(x, y), **style)

    def outlines(self, ship: xr.Dataset, interval: float, **style: Any) -> None:
        """Outlines at a time interval [s], in the first round."""
        time, x, y, psi = (ship[name].values for name in ("time", "x", "y", "psi"))
        finite = np.isfinite(x + y + psi)
        for when in np.arange(0.0, time[finite][-1] + 1e-9, interval):
            pose = [float(np.interp(when, time[finite], values[finite])) for values in (x, y, psi)]
            if abs(pose[2]) <= np.deg2rad(_FIRST_ROUND):
                outline = hull(self.vessel, *pose)
                self.ax.add_patch(Polygon(np.column_stack(self.points(*outline.T)), **style))


def _until(ship: xr.Dataset, turned: float) -> xr.Dataset:
    """Finite part of a track, up to a heading change [deg]."""
    psi = ship["psi"].values
    over = np.flatnonzero(~np.isfinite(psi) | (np.abs(psi - psi[0]) > np.deg2rad(turned)))
    return ship.isel(time=slice(0, over[0] if over.size else None))


def _position_at(ship: xr.Dataset, turned: float) -> tuple[float, float] | None:
    """Position x, y [m] at a heading change [deg]; None where it is not reached."""
    psi = np.abs(ship["psi"].values - ship["psi"].values[0])
    over = np.flatnonzero(psi >= np.deg2rad(turned))
    if not over.size:
        return None
    pair = slice(max(over[0] - 1, 0), over[0] + 1)
    x, y = (float(np.interp(np.deg2rad(turned), psi[pair], ship[name].values[pair])) for name in ("x", "y"))
    return x, y


@house_style
def track(tree: xr.DataTree, vessel: Vessel, measured: xr.Dataset | None = None) -> Figure:
    """Tracks of a forecast in ship lengths, with outlines to scale: draws, median ship and a trial with x, y and psi.

    A circle shows its first round with the points and dimensions at 90 and 180 deg. A track more than 2.5 times as long
    as wide has ahead to the right.
    """
    turning = kind_named(tree.attrs["manoeuvre"]).circles
    most = _SHOWN_TURN if turning else np.inf
    ships = tree["trajectories"].to_dataset()
    median = tree.attrs["median_draw"]
    shown = [median, *(k for k in range(ships.sizes["draw"]) if k != median)][:_N_TRACKS]
    drawn = [_until(ships.isel(draw=k), most) for k in shown]
    trial = measured_track(tree, measured, most)
    named = [(drawn[0], BLUE, "median ship")] + ([] if trial is None else [(trial, REFERENCE, "measured")])
    advance, transfer = (_extent([*drawn, *([] if trial is None else [trial])], name, vessel) for name in ("x", "y"))
    turned = bool(not turning and np.ptp(advance) > 2.5 * np.ptp(transfer))
    if turning:  # room for dimension lines below, above and on the side away from the turn
        room = _ROOM * max(np.ptp(advance), np.ptp(transfer))
        advance = advance[0] - room, advance[1] + room
        is_starboard = SIDES[tree.attrs["side"]] > 0.0
        transfer = (transfer[0] - room, transfer[1]) if is_starboard else (transfer[0], transfer[1] + room)
    ratio = float(np.ptp(transfer) / np.ptp(advance)) if turned else float(np.ptp(advance) / np.ptp(transfer))
    fig, axes = subplots(8.0, float(np.clip(7.2 * ratio + 1.2, 2.0, 8.0)))
    plan = _Plan(axes[0, 0], vessel, turned=turned)
    for k, ship in enumerate(drawn):
        plan.line(ship, color=BLUE, lw=0.4, alpha=0.35, label="forecast draws" if k == 1 else None)
    interval = _outline_interval(drawn[0], vessel)
    for ship, colour, label in named:
        plan.line(ship, color=colour, lw=1.9 if label == "measured" else 1.3, label=label, zorder=3)
        face = (colour, 0.0 if label == "measured" else 0.3)
        plan.outlines(ship, interval, fc=face, ec=colour, lw=0.9, zorder=3.5 if label == "measured" else 2.5)
    if turning:
        measured_values = {} if measured is None or trial is None else measured_indices(measured, tree.attrs)
        _dimensions(plan, tree, named, (advance, transfer), measured_values)
    horizontal, vertical = plan.points(advance, transfer)
    plan.ax.set(xlim=horizontal, ylim=vertical[::-1] if turned else vertical)
    title = f"{tree.attrs['label']}: outlines every {interval:g} s, L = {plan.L:.4g} m"
    plan.ax.set_title(f"{title}{', starboard is down' if turned else ''}", loc="left")
    legend = fig.legend(*plan.ax.get_legend_handles_labels(), loc="outside upper center", ncols=5)
    for handle in legend.get_lines():
        handle.set_alpha(1.0)
    return fig


def _extent(ships: Sequence[xr.Dataset], name: str, vessel: Vessel) -> tuple[float, float]:
    """Range of a coordinate of the tracks and of the outlines at their ends [L]."""
    values = np.concatenate([[0.0], *(ship[name].values for ship in ships)]) / vessel.particulars.L
    return float(np.nanmin(values)) - 0.6, float(np.nanmax(values)) + 0.6


def measured_track(tree: xr.DataTree, measured: xr.Dataset | None, most: float) -> xr.Dataset | None:
    """Aligned trial as long as the forecast, up to a heading change [deg]; None where it has no track."""
    if measured is None:
        return None
    trial = align_to_first_execute(measured)
    if not {"x", "y", "psi"} <= set(trial.data_vars):
        return None
    aligned = trial.sel(time=trial["time"] <= float(tree["trajectories"].dataset["time"][-1]))
    trial = _until(aligned[["x", "y", "psi"]].dropna("time"), most)
    return trial if trial.sizes["time"] > 1 else None


def _outline_interval(ship: xr.Dataset, vessel: Vessel) -> float:
    """Round interval [s] in which the ship moves about a ship length and a half."""
    x, y, time = (ship[name].values for name in ("x", "y", "time"))
    path = float(np.hypot(np.diff(x), np.diff(y)).sum()) / vessel.particulars.L
    wanted = _SPACING * float(np.ptp(time)) / max(path, 1e-9)
    return float(next((interval for interval in _INTERVALS if interval >= wanted), _INTERVALS[-1]))


def _dimensions(
    plan: _Plan,
    tree: xr.DataTree,
    named: Sequence[tuple[xr.Dataset, str, str]],
    ranges: tuple[tuple[float, float], tuple[float, float]],
    measured: Mapping[str, float],
) -> None:
    """Marks at 90 and 180 deg; advance, transfer and tactical diameter with intervals."""
    advance, transfer = ranges
    ordered_at = np.array([0.0, -tree.attrs["rudder_delay"] * tree.attrs["approach_speed"] / plan.L])
    marks = {(label, angle): _position_at(ship, angle) for ship, _, label in named for angle in (90.0, 180.0)}
    for (label, angle), position in marks.items():
        if position is not None:
            colour = BLUE if label == "median ship" else REFERENCE
            where = f"{angle:g}° of heading" if label == "median ship" else None
            style: dict[str, Any] = {"color": colour, "mec": "white", "ms": 7.0, "zorder": 4, "label": where}
            plan.ax.plot(position[1] / plan.L, position[0] / plan.L, "o" if angle == 90.0 else "s", **style)
    inward = 0.8 * _ROOM / (1.0 + 2.0 * _ROOM) * np.ptp(advance)
    side = transfer[0] + inward if tree.attrs["side"] == "starboard" else transfer[1] - inward
    levels = {"advance": side, "transfer": advance[1] - inward, "tactical_diameter": advance[0] + inward}
    for name, (angle, axis) in {"advance": (90.0, 0), "transfer": (90.0, 1), "tactical_diameter": (180.0, 1)}.items():
        if (position := marks["median ship", angle]) is not None:
            text = _dimension_text(tree, name, plan.L, measured.get(name, np.nan) / plan.L)
            mark = np.array([position[1], position[0]]) / plan.L
            _dimension(plan.ax, (ordered_at, mark), levels[name], text, vertical=axis == 0)


def _dimension_text(tree: xr.DataTree, name: str, L: float, measured: float) -> str:
    bands = tree["index_bands"][name] / L
    lower, median, upper = (f"{float(bands.sel(band=band)):.2f}" for band in BANDS)
    measured_line = f"\nmeasured {measured:.2f} L" if np.isfinite(measured) else ""
    return f"{name.replace('_', ' ')} {median} L\n({lower} to {upper}){measured_line}"


def _dimension(ax: Axes, corners: tuple[np.ndarray, np.ndarray], level: float, text: str, *, vertical: bool) -> None:
    """Dimension line between two points, drawn aside at a level, with extension lines."""
    ends = np.array([(level, y) if vertical else (x, level) for x, y in corners])
    for corner, foot in zip(corners, ends, strict=True):
        ax.plot(*np.column_stack([corner, foot]), color=REFERENCE, lw=0.6, ls=":", zorder=2)
    arrow = {"arrowstyle": "<->", "lw": 0.9, "color": REFERENCE, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tuple(ends[1]), tuple(ends[0]), arrowprops=arrow)
    away = 5.0 if level > 0.0 else -5.0
    settings: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8.0, "multialignment": "center"}
    if vertical:
        settings |= {"xytext": (away, 0), "ha": "left" if level > 0.0 else "right", "va": "center", "rotation": 90.0}
    else:
        settings |= {"xytext": (0, away), "ha": "center", "va": "bottom" if level > 0.0 else "top"}
    ax.annotate(text, tuple(ends.mean(axis=0)), **settings)
