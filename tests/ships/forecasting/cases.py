"""Forecasts of manoeuvres, and measured trials to compare with."""

from __future__ import annotations

from functools import cache

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.forecasting.figures import manoeuvre_figures
from tests.ships.ensemble.cases import posterior_forecast

MANOEUVRES = {
    "zigzag": (ps.zigzag(20.0, 20.0, side="starboard"), 320.0),
    "port": (ps.turning_circle(35.0), 600.0),
    "starboard": (ps.turning_circle(35.0, side="starboard"), 500.0),
}
"""Manoeuvres and how long they are forecast [s]."""

SETTINGS = {"step": 0.1, "record_interval": 0.5}


def scattered(vessel, draws=24, spread=0.02, seed=1):
    """Coefficients about the reference, shape (draws, n_coefficients)."""
    reference = reference_coefficients(vessel)
    return reference * (1.0 + spread * np.random.default_rng(seed).standard_normal((draws, reference.size)))


def posterior(vessel, draws):
    """Joint posterior of these draws."""
    names = [name for dof in vessel.dofs for name in vessel.coefficients(dof)["coefficient"].values]
    sample = xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), draws[None])}, {"coefficient": names})
    return xr.DataTree.from_dict({"posterior": sample})


def forecast(vessel, manoeuvre, duration, draws=None):
    """Forecast with bands of 95 %."""
    draws = scattered(vessel) if draws is None else draws
    settings = {"draws": len(draws), "rng": np.random.default_rng(2), "ci_prob": 0.95, **SETTINGS}
    return posterior_forecast(vessel, posterior(vessel, draws), manoeuvre, duration=duration, **settings)


def trial(vessel, manoeuvre, duration, *, course=0.7, approach=60.0, begin=100.0):
    """A run of the reference ship, measured from another time, course and place, with a straight approach."""
    run = ps.simulate(vessel, manoeuvre, duration=duration, **SETTINGS)
    n = round(approach / 0.5)
    before = {name: np.full(n, run[name].values[0]) for name in ("u", "v", "r", "p", "phi", "psi", "y", "delta")}
    before["x"] = -0.5 * run["u"].values[0] * np.arange(n, 0, -1)
    whole = {name: np.concatenate([values, run[name].values]) for name, values in before.items()}
    x, y, c, s = whole["x"], whole["y"], np.cos(course), np.sin(course)
    whole |= {"x": 500.0 + c * x - s * y, "y": -300.0 + s * x + c * y}
    whole["psi"] = np.angle(np.exp(1j * (whole["psi"] + course)))
    return run, xr.Dataset({n: ("time", v) for n, v in whole.items()}, {"time": begin + 0.5 * np.arange(len(x))})


@cache
def case(kind):
    """Vessel, forecast and measured trial of a manoeuvre, the run it was made from first."""
    vessel = ps.load_vessel("container")
    manoeuvre, duration = MANOEUVRES[kind]
    return vessel, forecast(vessel, manoeuvre, duration), *trial(vessel, manoeuvre, duration)


@cache
def drawn(kind, name):
    vessel, tree, _, measured = case(kind)
    return manoeuvre_figures(tree, vessel, measured)[name]


def labelled(ax, label):
    return next(line for line in ax.get_lines() if line.get_label() == label)


def legend(fig):
    return [text.get_text() for text in fig.legends[0].get_texts()]
