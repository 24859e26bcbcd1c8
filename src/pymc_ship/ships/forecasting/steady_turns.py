"""Steady turns: the rudder that holds each rate of turn, stable or not, which is what a spiral test measures.

A direct spiral holds rudder angles and waits for the rate of turn, a reverse spiral holds rates and reads the rudder.
Both find the same curve, of which the direct one jumps over the part where a ship is unstable (ITTC 7.5-04-02-01). Here
every draw is in balance at a grid of rates, by Newton's method on the accelerations that the simulator integrates, from
one rate to the next.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import BLUE, REFERENCE, house_style, subplots
from pymc_ship.physics.manoeuvre.criteria import probability_text
from pymc_ship.physics.motion.equations import STATE, scheme, set_parts, state_derivative, workspace
from pymc_ship.physics.motion.inputs import steady_inputs
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.ship import ShipLike, as_ship

RATES = np.linspace(-0.8, 0.8, 65)
"""Prime rates of turn r' = r L / U of the curve."""

LARGEST_RUDDER = 40.0
"""Rudder angle [deg] up to which the curve is taken."""

_ITERATIONS = 12
_SMALL, _CONVERGED = 1e-6, 1e-8
_LONGEST = 0.2  # change of an unknown in one step: of the speed, or rad


def steady_turns(ship: ShipLike) -> xr.Dataset:
    """Speed, drift and rudder of every drawn ship in a steady turn at each rate, at the revolutions of nominal speed.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path

    Returns
    -------
    Dataset, dims (draw, rate)
        ``delta`` [deg], ``speed`` [m/s], ``r`` [deg/s] and ``drift`` [deg], over ``rate``, the prime rate of turn,
        positive to starboard; NaN beyond :data:`LARGEST_RUDDER` and where a ship finds no balance.

    Examples
    --------
    A tanker that is course-unstable: the rudder of slow turns lies on the wrong side.

    >>> import pymc_ship as ps
    >>> from pymc_ship.ships.forecasting.steady_turns import spiral_indices
    >>> turns = ps.steady_turns("kvlcc2")
    >>> print(turns["delta"].isel(draw=0).sel(rate=[0.1, 0.5], method="nearest").values.round(1))
    [  1.6 -25.3]
    >>> print(f"loop of {spiral_indices(turns)['loop_width'].item():.1f} deg")
    loop of 3.1 deg
    """
    models = as_ship(ship).models
    parts = [_of_model(vessel, draws) for vessel, draws in models]
    names = ("delta", "speed", "r", "drift")
    values = {name: np.concatenate([part[name] for part in parts]) for name in names}
    units = dict(zip(names, ("deg", "m/s", "deg/s", "deg"), strict=True))
    return xr.Dataset(
        {name: (("draw", "rate"), value, {"units": units[name]}) for name, value in values.items()},
        {"rate": RATES, "draw": np.arange(len(values["delta"]))},
        {"ship_time": models[0][0].particulars.ship_time},
    )


def spiral_indices(turns: xr.Dataset) -> xr.Dataset:
    """What a spiral test says of each ship: whether she is course-stable, and the loop where she is not.

    Parameters
    ----------
    turns : Dataset, dims (draw, rate)
        From :func:`steady_turns`.

    Returns
    -------
    Dataset, dims (draw,)
        ``loop_width`` [deg]: rudder angles at which she turns steadily to either side, 0 for a stable ship;
        ``residual_rate_starboard`` and ``residual_rate_port`` [deg/s]: the rates at which she keeps turning with the
        rudder where a straight course has it, 0 for a stable ship, NaN where the curve has no such rate.
    """
    delta, r = turns["delta"].values, turns["r"].values
    middle = delta.shape[1] // 2
    rows = [_loop(delta[k], r[k], middle) for k in range(len(delta))]
    names = (("loop_width", "deg"), ("residual_rate_starboard", "deg/s"), ("residual_rate_port", "deg/s"))
    values = np.array(rows, dtype=float).reshape(-1, len(names)).T
    return xr.Dataset({name: ("draw", row, {"units": unit}) for (name, unit), row in zip(names, values, strict=True)})


def largest_loop(ship_time: float) -> float:
    """Width of the loop [deg] up to which an unstable ship is acceptable, by L/U [s] (IMO MSC/Circ.1053)."""
    return float(np.clip(ship_time / 3.0 - 3.0, 0.0, 12.0))


def spiral_sentence(turns: xr.Dataset) -> str:
    """Say with what probability the ship is course-stable, and how wide her loop is."""
    width = spiral_indices(turns)["loop_width"].values
    known = width[np.isfinite(width)]
    if not known.size:
        return "No drawn ship is in balance on a straight course: nothing is said of her stability."
    stable, limit = float(np.mean(known == 0.0)), largest_loop(turns.attrs["ship_time"])
    lower, median, upper = np.quantile(known, [0.025, 0.5, 0.975])
    found = f"Course-stable with probability {probability_text(stable)} by these draws"
    if stable == 1.0:
        return f"{found}: no loop in the spiral."
    return (
        f"{found}; loop of the spiral {median:.1f} deg of rudder ({lower:.1f} to {upper:.1f}), within the "
        f"{limit:.1f} deg of IMO MSC/Circ.1053 with probability {probability_text(float(np.mean(known <= limit)))}."
    )


@house_style
def spiral_curve(turns: xr.Dataset, *, ci_prob: float = 0.95) -> Figure:
    """Rate of turn against rudder angle: the steady turns of the median ship, and the band of rudders at each rate."""
    fig, axes = subplots(5.6, 4.4)
    draw_curve(axes[0, 0], turns, ci_prob)
    if axes[0, 0].get_legend_handles_labels()[1]:
        axes[0, 0].legend(loc="upper right")
    return fig


def draw_curve(ax: Axes, turns: xr.Dataset | None, ci_prob: float) -> None:
    """Draw the curve and its band on the axes of a spiral test, at rates whose steady turns nearly all ships have."""
    kept = None if turns is None else np.isfinite(turns["delta"].values).mean(axis=0) > ci_prob
    if turns is not None and np.any(kept):
        tails = [0.5 - 0.5 * ci_prob, 0.5, 0.5 + 0.5 * ci_prob]
        lower, median, upper = np.nanquantile(turns["delta"].values[:, kept], tails, axis=0)
        rate = np.nanmedian(turns["r"].values[:, kept], axis=0)
        ax.fill_betweenx(rate, lower, upper, color=BLUE, alpha=0.25, lw=0, label=f"{100.0 * ci_prob:g} % band")
        ax.plot(median, rate, color=BLUE, label="median")
    ax.axhline(0.0, color=REFERENCE, lw=0.6)
    ax.axvline(0.0, color=REFERENCE, lw=0.6)
    ax.set_xlabel("rudder δ [deg], positive to port")
    ax.set_ylabel("steady yaw rate r [deg/s], positive to starboard")


def _loop(delta: np.ndarray, r: np.ndarray, middle: int) -> tuple[float, float, float]:
    """Width of the loop [deg], and the rates on its outer branches [deg/s] at the rudder of the straight course."""
    if not np.isfinite(delta[middle]):
        return np.nan, np.nan, np.nan
    known = np.isfinite(delta)
    first, last = middle, middle
    while first > 0 and known[first - 1]:
        first -= 1
    while last < delta.size - 1 and known[last + 1]:
        last += 1
    own, rate = delta[first : last + 1], r[first : last + 1]
    rising = np.flatnonzero(np.diff(own) > 0.0)
    if not rising.size:
        return 0.0, 0.0, 0.0
    least, most = rising[0], rising[-1] + 1
    straight = own[middle - first]
    outer = [_crossed(own[most:], rate[most:], straight), _crossed(own[least::-1], rate[least::-1], straight)]
    return float(own[most] - own[least]), outer[0], -outer[1]


def _crossed(delta: np.ndarray, rate: np.ndarray, level: float) -> float:
    """Rate at which a branch that begins on one side of a rudder angle reaches it; NaN where it does not."""
    passed = np.flatnonzero((delta[:-1] - level) * (delta[1:] - level) <= 0.0)
    if not passed.size:
        return np.nan
    k = passed[0]
    share = (level - delta[k]) / (delta[k + 1] - delta[k]) if delta[k + 1] != delta[k] else 0.0
    return float(rate[k] + share * (rate[k + 1] - rate[k]))


def _of_model(vessel: Vessel, draws: np.ndarray) -> dict[str, np.ndarray]:
    """Steady turns of the draws of one vessel, each (n_draws, n_rates)."""
    s, constants, n_ships = vessel.particulars, scheme(vessel), len(draws)
    columns, work = np.ascontiguousarray(draws.T), workspace(n_ships, constants)
    set_parts(columns, constants, work)
    rolls = "roll" in vessel.dofs
    others = steady_inputs(vessel, s.nominal_speed)
    inputs = np.zeros((1 + others.size, n_ships))
    inputs[1:] = others[:, None]
    state, rate = np.zeros((len(STATE), n_ships)), np.empty((len(STATE), n_ships))
    scale = np.array([s.nominal_speed / s.ship_time] * 2 + [s.ship_time**-2] * 2)
    balanced = [0, 1, 2, *([3] if rolls else [])]

    def residual(unknown: np.ndarray, prime: float) -> np.ndarray:
        state[0], state[1] = s.nominal_speed * unknown[0], s.nominal_speed * unknown[1]
        state[2] = prime * np.hypot(state[0], state[1]) / s.L
        inputs[0] = unknown[2]
        if rolls:
            state[STATE.index("phi")] = unknown[3]
        state_derivative(state, inputs, columns, constants, work, rate)
        return rate[balanced] / scale[balanced, None]

    size, middle = len(balanced), RATES.size // 2
    found = np.full((RATES.size, size, n_ships), np.nan)
    for way in (range(middle, RATES.size), range(middle - 1, -1, -1)):
        at = np.vstack([np.ones(n_ships), np.zeros((size - 1, n_ships))]) if way[0] == middle else found[middle].copy()
        for k in way:
            at, settled = _balanced(residual, at, float(RATES[k]))
            found[k] = np.where(settled & (np.abs(at[2]) <= np.deg2rad(LARGEST_RUDDER)), at, np.nan)
    u, v, delta = (found[:, k].T for k in range(3))
    speed = s.nominal_speed * np.hypot(u, v)
    return {
        "delta": np.rad2deg(delta),
        "speed": speed,
        "r": np.rad2deg(RATES * speed / s.L),
        "drift": np.rad2deg(np.arctan2(-v, u)),
    }


def _balanced(
    residual: Callable[[np.ndarray, float], np.ndarray], start: np.ndarray, prime: float
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method for all ships at once: unknowns (n_unknowns, n_ships), and which of them are in balance."""
    at = start.copy()
    for _ in range(_ITERATIONS):
        left = residual(at, prime)
        settled = np.abs(left).max(axis=0) < _CONVERGED
        if settled.all():
            break
        jacobian = np.empty((at.shape[1], len(at), len(at)))
        for column in range(len(at)):
            moved = at.copy()
            moved[column] += _SMALL
            jacobian[:, :, column] = ((residual(moved, prime) - left) / _SMALL).T
        step = _solved(jacobian, left.T).T
        at = at - np.where(settled, 0.0, np.clip(step, -_LONGEST, _LONGEST))
        at[0] = np.maximum(at[0], 0.05)
    return at, settled


def _solved(jacobian: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Newton steps; 0 where a ship has none."""
    good = np.isfinite(jacobian).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)
    good[good] = np.abs(np.linalg.det(jacobian[good])) > 0.0
    step = np.zeros_like(left)
    step[good] = np.linalg.solve(jacobian[good], left[good][..., None])[..., 0]
    return step
