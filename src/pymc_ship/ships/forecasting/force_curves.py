"""Force curves of the draws over the range of the data and beyond."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.machine.errors import ShipError
from pymc_ship.pages.drawing import BLUE, NOISE, house_style, subplots
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.motion.captive import captive_test_forces
from pymc_ship.physics.vessel.vessel import DOFS, LETTER, Vessel, coefficient_names
from pymc_ship.ships.ensemble.draws import Models
from pymc_ship.trial.channels import CHANNELS

_FORCES = ("surge", "sway", "yaw")
_HALF_RANGE = {"v": 0.4, "r": 0.8, "delta": np.deg2rad(40.0)}
_AXES = {"v": f"{CHANNELS['v'].label}'", "r": f"{CHANNELS['r'].label}'", "delta": CHANNELS["delta"].axis}
_GRID, _MARGIN, _INSIDE = 81, 1.5, 0.95


@house_style
def force_curves(models: Models, ranges: xr.DataArray | None = None) -> Figure:
    """Prime force and moment of the hull and rudder against v', r' and rudder, one at a time at the nominal speed.

    ``models`` are pairs of a vessel and draws (n_draws, n_coefficients); ``ranges``, dims (row, symbol), is the prime
    motion of the training record, whose range is shaded. ValueError for no model, or draws of another shape.
    """
    if not models:
        raise ShipError("Force curves need at least one vessel with draws of its coefficients, found none; add one.")
    fig, axes = subplots(8.0, 6.4, len(_FORCES), len(_AXES), sharex="col")
    tails = [0.5 - 0.5 * _INSIDE, 0.5, 0.5 + 0.5 * _INSIDE]
    for column, symbol in enumerate(_AXES):
        trained = None if ranges is None else ranges.sel(symbol=symbol).values
        half = max(_HALF_RANGE[symbol], 0.0 if trained is None else _MARGIN * np.nanmax(np.abs(trained)))
        values = np.linspace(-half, half, _GRID)
        factor = np.rad2deg(1.0) if symbol == "delta" else 1.0
        for row, dof in enumerate(_FORCES):
            ax = axes[row, column]
            curves = 1e3 * np.concatenate([force_draws(vessel, draws, dof, symbol, values) for vessel, draws in models])
            lower, median, upper = np.quantile(curves, tails, axis=0)
            if trained is not None:
                ends = factor * np.nanmin(trained), factor * np.nanmax(trained)
                ax.axvspan(*ends, color=NOISE, alpha=0.3, lw=0, zorder=0, label="range of the training record")
            ax.fill_between(factor * values, lower, upper, color=BLUE, alpha=0.25, lw=0, label="95 % band")
            ax.plot(factor * values, median, color=BLUE, label="median")
            ax.set_xlim(-factor * half, factor * half)
            if column == 0:
                ax.set_ylabel(f"{LETTER[dof]}' · 10³")
        axes[-1, column].set_xlabel(_AXES[symbol])
    fig.align_ylabels(axes[:, 0])
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def force_draws(vessel: Vessel, draws: np.ndarray, dof: str, symbol: str, values: np.ndarray) -> np.ndarray:
    """Prime force of a DOF along prime values of one symbol, others zero, at the nominal speed, (n_draws, n_values)."""
    size = len(coefficient_names(vessel))
    if draws.ndim != 2 or draws.shape[1] != size or not len(draws):
        raise ShipError(f"Draws of {vessel.name!r} have shape (draws, {size}), found {draws.shape}; reorder them.")
    s, row = vessel.particulars, DOFS.index(dof)
    prime = {name: np.zeros(values.size) for name in SYMBOLS} | {symbol: np.asarray(values, dtype=float)}
    speed = s.nominal_speed / (1.0 - prime["u"])
    motion = {"v": speed * prime["v"], "phi": prime["phi"], "delta": prime["delta"]}
    motion |= {name: speed / s.L * prime[name] for name in ("r", "p")}
    motion["u"] = np.sqrt(np.maximum(speed**2 - motion["v"] ** 2, 0.0))
    return captive_test_forces(vessel, motion, draws)[:, row]
