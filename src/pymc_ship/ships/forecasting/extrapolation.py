"""Distance of a simulated motion from the motion that a model was fitted to.

The convex hull of the record, each symbol over its range, is bounded by supports in fixed directions (Rockafellar 1970,
Convex Analysis, section 13): a distance is a lower bound.
"""

from collections.abc import Callable
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
import xarray as xr
from numba import njit

from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.threads import map_in_threads
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.motion.equations import KERNEL, STATE
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel

UNKNOWN = "Extrapolation is not assessed: the posterior does not store the motion of its training runs."
MARGIN = 0.01  # departure that counts as inside, in ranges of the record; a repeated run departs as much
_CHANNELS = (*STATE[:5], "delta")
_N_RANDOM = 100
_BLOCK = 256  # points of a block of the kernel; they fit into the first-level cache
_SHIPS = 16  # draws of a task of a thread
_NAMED = 3  # largest number of departures that a sentence names
_VISIBLE = 0.005  # smallest departure that a sentence names, in ranges of the symbol


class _Direction(NamedTuple):
    u: float
    v: float
    r: float
    p: float
    phi: float
    delta: float


def extrapolation(vessel: VesselLike, ships: xr.Dataset, motion: xr.DataArray) -> xr.Dataset:
    """Distance of simulated draws from the motion of a training record.

    ``ships`` have u, v [m/s], r [rad/s], delta [rad], and p [rad/s] and phi [rad] where the vessel rolls; ``motion`` is
    the prime motion of the record, dims (row, symbol), not mirrored to the other side. Dataset with the dims of the
    ships: ``distance`` (in ranges of the record, 0 within :data:`MARGIN`, NaN after divergence) and ``outside``; by
    draw and symbol ``lowest`` and ``highest`` prime value, ``below`` and ``above``, the departure in ranges of the
    record; by symbol ``trained_lowest`` and ``trained_highest``. TrialError when the ships lack a channel, or the
    motion a dimension, a symbol, a row or a finite value.
    """
    vessel = as_vessel(vessel)
    trained = _training_motion(motion)
    least, most = trained.min(axis=0), trained.max(axis=0)
    unit = np.where(most > least, most - least, 1.0)
    supports = (trained - least) / unit @ _directions().T
    limits = np.array([supports.min(axis=0), supports.max(axis=0)])
    distance, lowest, highest = _distances(vessel, ships, least, unit, limits)
    by_symbol = ("draw", "symbol")
    variables = {
        "distance": (("draw", "time"), distance, {"units": "range of the record"}),
        "outside": (("draw", "time"), distance > 0.0),
        "lowest": (by_symbol, least + unit * lowest),
        "highest": (by_symbol, least + unit * highest),
        "below": (by_symbol, np.maximum(-lowest, 0.0), {"units": "range of the record"}),
        "above": (by_symbol, np.maximum(highest - (most - least) / unit, 0.0), {"units": "range of the record"}),
        "trained_lowest": ("symbol", least),
        "trained_highest": ("symbol", most),
    }
    coords = {"time": ships["time"].reset_coords(drop=True), "symbol": list(SYMBOLS)}
    if "draw" not in ships.dims:
        return xr.Dataset(variables, coords).isel(draw=0)
    return xr.Dataset(variables, coords | {"draw": np.arange(ships.sizes["draw"])})


def sentence(vessel: Vessel, summary: xr.Dataset) -> str:
    """Sentence: which part of a forecast is outside the record, how far, and in which quantities.

    ``summary`` has variables over symbol, and attrs ``extrapolated_fraction`` and ``median_distance``.
    """
    fraction = summary.attrs["extrapolated_fraction"]
    if fraction == 0.0:
        return "Every instant lies inside the motion of the record."
    sides = ("below", "lowest", "trained_lowest"), ("above", "highest", "trained_highest")
    departures = [
        ([float(summary[name].sel(symbol=symbol)) for name in names], symbol) for names in sides for symbol in SYMBOLS
    ]
    departures.sort(key=lambda departure: -departure[0][0])
    named = [(reached, trained, symbol) for (size, reached, trained), symbol in departures if size >= _VISIBLE]
    where = "; ".join(_departure(vessel, *departure) for departure in named[:_NAMED])
    return (
        f"{percentage_outside(fraction).capitalize()} of the instants lie outside the motion of the record, "
        f"typically by {summary.attrs['median_distance']:.2g} times the span that it covers: "
        f"{where or 'combinations of quantities, each within its range in the median ship'}. A run with such "
        "motion would reduce the uncertainty."
    )


def percentage_outside(fraction: float) -> str:
    """Percentage of the instants outside the motion of the record, as text."""
    return "less than 0.1 %" if 0.0 < fraction < 1e-3 else f"{100.0 * fraction:.3g} %"


def _departure(vessel: Vessel, reached: float, trained: float, symbol: str) -> str:
    """Text: extreme of one symbol, and the end of its range in the record."""
    verb, way = ("falls", "down") if reached < trained else ("rises", "up")
    display: dict[str, tuple[str, Callable[[float], float], str]] = {
        "u": ("speed", lambda u_a: vessel.particulars.nominal_speed / (1.0 - u_a), " m/s"),
        "v": ("v/U", float, ""),
        "r": ("rL/U", float, ""),
        "p": ("pL/U", float, ""),
        "phi": ("roll angle", np.rad2deg, " deg"),
        "delta": ("rudder angle", np.rad2deg, " deg"),
    }
    quantity, convert, units = display[symbol]
    return f"{quantity} {verb} to {convert(reached):.3g}{units}, the record goes {way} to {convert(trained):.3g}{units}"


@cache
def _directions() -> np.ndarray:
    """Unit vectors, each also for its opposite, shape (n_directions, n_symbols)."""
    axes = np.eye(len(SYMBOLS))
    pairs = [axes[i] + sign * axes[j] for i, j in combinations(range(len(SYMBOLS)), 2) for sign in (1.0, -1.0)]
    directions = np.vstack([axes, pairs, np.random.default_rng(1970).standard_normal((_N_RANDOM, len(SYMBOLS)))])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _training_motion(motion: xr.DataArray) -> np.ndarray:
    if set(motion.dims) != {"row", "symbol"} or set(map(str, motion.get_index("symbol"))) != set(SYMBOLS):
        raise TrialError(
            f"A training motion has the dims row and symbol ({', '.join(SYMBOLS)}), found {dict(motion.sizes)}; "
            "rearrange it."
        )
    values = motion.sel(symbol=list(SYMBOLS)).transpose("row", "symbol").values
    if not values.size or not np.isfinite(values).all():
        raise TrialError(f"A training motion is finite and has rows, found {len(values)} rows; clean the record.")
    return values


def _distances(
    vessel: Vessel, ships: xr.Dataset, least: np.ndarray, unit: np.ndarray, limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (n_draws, n_time) and extremes (n_draws, n_symbols), counted from ``least`` in ``unit``."""
    missing = [name for name in ("u", "v", "r", "delta") if name not in ships]
    if missing:
        raise TrialError(f"Ships have the channels u, v, r and delta; {', '.join(missing)} missing; add them.")
    record = {name: np.atleast_2d(ships[name].values) for name in _CHANNELS if name in ships}
    n_draws, n_time = record["u"].shape
    distance = np.zeros((n_draws, n_time))
    lowest, highest = np.empty((2, n_draws, len(SYMBOLS)))

    def fill_rows(begin: int) -> None:
        rows = slice(begin, begin + _SHIPS)
        prime, _, _ = prime_record(vessel, {name: values[rows].ravel() for name, values in record.items()})
        points = (np.array([prime[symbol] for symbol in SYMBOLS]) - least[:, None]) / unit[:, None]
        _fill_distances(points, _directions(), limits, distance[rows].reshape(-1))
        by_ship = points.reshape(len(SYMBOLS), -1, n_time)
        lowest[rows], highest[rows] = np.fmin.reduce(by_ship, axis=2).T, np.fmax.reduce(by_ship, axis=2).T

    blocks = range(0, n_draws, _SHIPS)
    map_in_threads(fill_rows, blocks)
    distance[distance < MARGIN] = 0.0
    distance[np.isnan(record["u"])] = np.nan
    return distance, lowest, highest


@njit(**KERNEL)
def _fill_distances(points: np.ndarray, directions: np.ndarray, limits: np.ndarray, distance: np.ndarray) -> None:
    """Raise each distance to the largest excess of its point (n_symbols, n_points) over the supports."""
    for begin in range(0, distance.size, _BLOCK):
        end = min(begin + _BLOCK, distance.size)
        for k in range(len(directions)):
            unit = directions[k]
            way = _Direction(unit[0], unit[1], unit[2], unit[3], unit[4], unit[5])
            low, high = limits[0, k], limits[1, k]
            for i in range(begin, end):
                support = way.u * points[0, i] + way.v * points[1, i] + way.r * points[2, i]
                support += way.p * points[3, i] + way.phi * points[4, i] + way.delta * points[5, i]
                distance[i] = max(distance[i], max(support - high, low - support))
