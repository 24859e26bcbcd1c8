"""Steady turns: the rudder angle at each rate of turn, as a reverse spiral test measures it (ITTC 7.5-04-02-01).

Newton's method on the accelerations of the simulator, from one rate to the next, also on the unstable branch.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import BLUE, REFERENCE, house_style, subplots
from pymc_ship.physics.manoeuvre.criteria import fraction_of_draws, probability_text
from pymc_ship.physics.motion.equations import STATE, scheme, set_parts, state_derivative, workspace
from pymc_ship.physics.motion.inputs import steady_inputs
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.ship import ShipLike, as_ship

RATES = np.linspace(-0.8, 0.8, 65)  # prime rates of turn r' = r L / U of the curve
LARGEST_RUDDER = 40.0  # largest rudder angle of the curve [deg]
SPIRAL_INDICES = {"loop_width": "deg", "residual_rate_starboard": "deg/s", "residual_rate_port": "deg/s"}
_INSIDE = 0.95  # probability inside the band of a curve
_ITERATIONS = 12
_SMALL, _CONVERGED = 1e-6, 1e-8
_LONGEST = 0.2  # change of an unknown in one step: of the speed, or rad


def steady_turns(ship: ShipLike) -> xr.Dataset:
    """Speed, drift and rudder angle of each draw in steady turns.

    Revolutions are those of the nominal speed.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path

    Returns
    -------
    Dataset, dims (draw, rate)
        ``delta`` [deg], ``speed`` [m/s], ``r`` [deg/s] and ``drift`` [deg] over ``rate``, the prime rate of turn,
        positive to starboard; NaN beyond :data:`LARGEST_RUDDER` and without a steady turn.

    Examples
    --------
    A course-unstable tanker: in slow turns the rudder is on the other side.

    >>> import pymc_ship as ps
    >>> from pymc_ship.ships.forecasting.steady_turns import spiral_indices
    >>> turns = ps.steady_turns("kvlcc2")
    >>> print(turns["delta"].isel(draw=0).sel(rate=[0.1, 0.5], method="nearest").values.round(1))
    [  1.6 -25.3]
    >>> print(f"loop of {spiral_indices(turns)['loop_width'].item():.1f} deg")
    loop of 3.1 deg
    """
    models = as_ship(ship).models
    parts = [_turns_of_model(vessel, draws) for vessel, draws in models]
    units = {"delta": "deg", "speed": "m/s", "r": "deg/s", "drift": "deg"}
    variables = {
        name: (("draw", "rate"), np.concatenate([part[name] for part in parts]), {"units": unit})
        for name, unit in units.items()
    }
    coords = {"rate": RATES, "draw": np.arange(sum(len(draws) for _, draws in models))}
    return xr.Dataset(variables, coords, {"ship_time": models[0][0].particulars.ship_time})


def spiral_indices(turns: xr.Dataset) -> xr.Dataset:
    """Indices of :data:`SPIRAL_INDICES` of the draws of :func:`steady_turns`; 0 for a course-stable ship.

    The residual rates are those at the rudder angle of the straight course; NaN where the curve has no such rate.
    """
    rows = [_loop(delta, r) for delta, r in zip(turns["delta"].values, turns["r"].values, strict=True)]
    values = np.array(rows, dtype=float).reshape(-1, len(SPIRAL_INDICES)).T
    named = zip(SPIRAL_INDICES.items(), values, strict=True)
    return xr.Dataset({name: ("draw", row, {"units": unit}) for (name, unit), row in named})


def largest_loop(ship_time: float) -> float:
    """Width of the loop [deg] up to which an unstable ship is acceptable, by L/U [s] (IMO MSC/Circ.1053)."""
    return float(np.clip(ship_time / 3.0 - 3.0, 0.0, 12.0))


def spiral_sentence(turns: xr.Dataset) -> str:
    """Sentence: probability of course stability, and width of the spiral's loop."""
    width = spiral_indices(turns)["loop_width"].values
    finite_widths = width[np.isfinite(width)]
    if not finite_widths.size:
        return "No draw has a steady straight course: its course stability is unknown."
    stable, limit = finite_widths == 0.0, largest_loop(turns.attrs["ship_time"])
    lower, median, upper = np.quantile(finite_widths, [0.025, 0.5, 0.975])
    stability = f"Course-stable with probability {probability_text(fraction_of_draws(stable))} by these draws"
    if stable.all():
        return f"{stability}: no loop in the spiral."
    return (
        f"{stability}; loop of the spiral {median:.1f} deg of rudder ({lower:.1f} to {upper:.1f}), within the "
        f"{limit:.1f} deg of IMO MSC/Circ.1053 with probability "
        f"{probability_text(fraction_of_draws(finite_widths <= limit))}."
    )


@house_style
def spiral_curve(turns: xr.Dataset) -> Figure:
    """Rate of turn against rudder angle: median and band of the rudder at each rate."""
    fig, axes = subplots(5.6, 4.4)
    draw_curve(axes[0, 0], turns)
    if axes[0, 0].get_legend_handles_labels()[1]:
        axes[0, 0].legend(loc="upper right")
    return fig


def draw_curve(ax: Axes, turns: xr.Dataset | None) -> None:
    """Draw median and 95 % band of a spiral, at rates where nearly all draws have a steady turn."""
    is_shown = None if turns is None else np.isfinite(turns["delta"].values).mean(axis=0) > _INSIDE
    if turns is not None and np.any(is_shown):
        tails = [0.5 - 0.5 * _INSIDE, 0.5, 0.5 + 0.5 * _INSIDE]
        lower, median, upper = np.nanquantile(turns["delta"].values[:, is_shown], tails, axis=0)
        rate = np.nanmedian(turns["r"].values[:, is_shown], axis=0)
        ax.fill_betweenx(rate, lower, upper, color=BLUE, alpha=0.25, lw=0, label="95 % band")
        ax.plot(median, rate, color=BLUE, label="median")
    ax.axhline(0.0, color=REFERENCE, lw=0.6)
    ax.axvline(0.0, color=REFERENCE, lw=0.6)
    ax.set_xlabel("rudder δ [deg], positive to port")
    ax.set_ylabel("steady yaw rate r [deg/s], positive to starboard")


def _loop(delta: np.ndarray, r: np.ndarray) -> tuple[float, float, float]:
    """Width of the loop [deg], and the rates on its outer branches [deg/s] at the rudder of the straight course."""
    middle, gaps = delta.size // 2, np.flatnonzero(~np.isfinite(delta))
    straight = delta[middle]
    if np.isnan(straight):
        return np.nan, np.nan, np.nan
    around = slice(gaps[gaps < middle].max(initial=-1) + 1, gaps[gaps > middle].min(initial=delta.size))
    rudder, rate = delta[around], r[around]
    rising = np.flatnonzero(np.diff(rudder) > 0.0)
    if not rising.size:
        return 0.0, 0.0, 0.0
    least, most = rising[0], rising[-1] + 1
    starboard = _crossing_rate(rudder[most:], rate[most:], straight)
    port = _crossing_rate(rudder[least::-1], rate[least::-1], straight)
    return float(rudder[most] - rudder[least]), starboard, -port


def _crossing_rate(delta: np.ndarray, rate: np.ndarray, level: float) -> float:
    """Rate at which a branch crosses a rudder angle; NaN where it does not."""
    crossings = np.flatnonzero((delta[:-1] - level) * (delta[1:] - level) <= 0.0)
    if not crossings.size:
        return np.nan
    k = crossings[0]
    weight = (level - delta[k]) / (delta[k + 1] - delta[k]) if delta[k + 1] != delta[k] else 0.0
    return float(rate[k] + weight * (rate[k + 1] - rate[k]))


def _turns_of_model(vessel: Vessel, draws: np.ndarray) -> dict[str, np.ndarray]:
    s, constants, n_ships = vessel.particulars, scheme(vessel), len(draws)
    columns, work = np.ascontiguousarray(draws.T), workspace(n_ships, constants)
    set_parts(columns, constants, work)
    rolls = "roll" in vessel.dofs
    others = steady_inputs(vessel, s.nominal_speed)
    inputs = np.vstack([np.zeros(n_ships), np.tile(others[:, None], n_ships)])
    state, rate = np.zeros((len(STATE), n_ships)), np.empty((len(STATE), n_ships))
    scale = np.array([s.nominal_speed / s.ship_time] * 2 + [s.ship_time**-2] * 2)
    residual_rows = [0, 1, 2, *([3] if rolls else [])]

    def residual(unknown: np.ndarray, prime: float) -> np.ndarray:
        state[0], state[1] = s.nominal_speed * unknown[0], s.nominal_speed * unknown[1]
        state[2] = prime * np.hypot(state[0], state[1]) / s.L
        inputs[0] = unknown[2]
        if rolls:
            state[STATE.index("phi")] = unknown[3]
        state_derivative(state, inputs, columns, constants, work, rate)
        return rate[residual_rows] / scale[residual_rows, None]

    size, middle = len(residual_rows), RATES.size // 2
    solutions = np.full((RATES.size, size, n_ships), np.nan)
    for way in (range(middle, RATES.size), range(middle - 1, -1, -1)):
        solution = solutions[middle].copy()
        if way[0] == middle:
            solution = np.vstack([np.ones(n_ships), np.zeros((size - 1, n_ships))])
        for k in way:
            solution, converged = _newton(residual, solution, float(RATES[k]))
            solutions[k] = np.where(converged & (np.abs(solution[2]) <= np.deg2rad(LARGEST_RUDDER)), solution, np.nan)
    u, v, delta = (solutions[:, k].T for k in range(3))
    speed = s.nominal_speed * np.hypot(u, v)
    return {
        "delta": np.rad2deg(delta),
        "speed": speed,
        "r": np.rad2deg(RATES * speed / s.L),
        "drift": np.rad2deg(np.arctan2(-v, u)),
    }


def _newton(
    residual: Callable[[np.ndarray, float], np.ndarray], start: np.ndarray, prime: float
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method for all draws at once: unknowns (n_unknowns, n_ships), and which draws converged."""
    solution = start.copy()
    for _ in range(_ITERATIONS):
        residuals = residual(solution, prime)
        converged = np.abs(residuals).max(axis=0) < _CONVERGED
        if converged.all():
            break
        jacobian = np.empty((solution.shape[1], len(solution), len(solution)))
        for column in range(len(solution)):
            moved = solution.copy()
            moved[column] += _SMALL
            jacobian[:, :, column] = ((residual(moved, prime) - residuals) / _SMALL).T
        regular = np.isfinite(jacobian).all(axis=(1, 2)) & np.isfinite(residuals).all(axis=0)
        regular[regular] = np.abs(np.linalg.det(jacobian[regular])) > 0.0
        step = np.zeros_like(residuals.T)  # 0 where the Jacobian is singular
        step[regular] = np.linalg.solve(jacobian[regular], residuals.T[regular][..., None])[..., 0]
        solution = solution - np.where(converged, 0.0, np.clip(step.T, -_LONGEST, _LONGEST))
        solution[0] = np.maximum(solution[0], 0.05)
    return solution, converged
