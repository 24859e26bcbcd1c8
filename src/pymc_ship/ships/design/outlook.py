"""Summary of an identified ship: forecasts of the standard manoeuvres, and the recommended next run."""

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import SimulationError
from pymc_ship.pages.tables import percent
from pymc_ship.physics.manoeuvre.standard import STANDARD
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.ships.design.next_run import design
from pymc_ship.ships.ensemble.draws import thinned_draws
from pymc_ship.ships.ensemble.index_error import steady_error
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.forecast import pooled_forecast

_DRAWS = 200  # at most
LEAST_GAIN = 0.05  # fraction of the widths by which a recommended run shortens them
_INSIDE = 0.95  # probability of intervals


def manoeuvring_summary(ship: Ship, rng: np.random.Generator) -> tuple[dict[str, xr.DataTree], tuple[str, ...]]:
    """Forecasts of the standard manoeuvres by label, with intervals of 95 %, and sentences.

    The sentences are on the tactical diameter, and on the run that would shorten the intervals most.
    """
    vessel, drawn = ship.models[0][0], thinned_draws(ship.models, _DRAWS)
    settings = simulation_settings(vessel, ci_prob=_INSIDE, motion=ship.motion)
    settings["errors"] = (ship.index_error or {}) | steady_error(ship.motion_error)
    forecasts, diameters = {}, []
    zigzag_rng = rng.spawn(1)[0]
    for manoeuvre in sorted(STANDARD, key=lambda one: not one.traits.circles):
        circles = manoeuvre.traits.circles
        settings["duration"] = manoeuvre.traits.reach * vessel.particulars.ship_time
        tree = pooled_forecast(drawn, manoeuvre, rng=rng if circles else zigzag_rng, **settings)
        forecasts[manoeuvre.label] = tree
        if circles:
            bands = tree["index_bands"].dataset["tactical_diameter"] / vessel.particulars.L
            lower, median, upper = bands.values.tolist()
            interval = f"{median:.2f} L ({lower:.2f} to {upper:.2f}) to {manoeuvre.side}"
            diameters += [interval] if np.isfinite(median) else []
    turns = [f"Tactical diameter of the turning circle of 35 deg: {', '.join(diameters)}."] if diameters else []
    return forecasts, (*turns, *_recommended_run(ship))


def sentence_without_gain(plan: xr.Dataset) -> str:
    """Sentence where the best first run of :func:`pymc_ship.design` gains less than 5 %; empty otherwise."""
    ratio = float(plan["width_ratio"].sel(step=1).min("candidate"))
    if ratio <= 1.0 - LEAST_GAIN:
        return ""
    return (
        f"No further run is recommended: none of the {plan.sizes['candidate']} candidates shortens the intervals by "
        f"{percent(LEAST_GAIN)} or more; the best, {plan['chosen'].values[0]}, leaves {ratio:.2f} of their width."
    )


def _recommended_run(ship: Ship) -> list[str]:
    """Sentence on the standard manoeuvre that shortens the intervals most; none where no index can be forecast."""
    vessel = ship.models[0][0]
    try:
        plan = design(ship, STANDARD, draws=_DRAWS)
    except SimulationError:
        return []
    best = plan.sel(candidate=plan["chosen"].item(), step=1)
    if no_run := sentence_without_gain(plan):
        return [no_run]
    now, then = plan["half_width"].values
    most = int(np.argmin(then / now))
    target, unit = (str(plan[name].values[most]) for name in ("target", "units"))
    manoeuvre, index = target.split(", ")
    width = np.array([then[most], now[most]]) / (vessel.particulars.L if unit == "m" else 1.0)
    return [
        f"Recommended next run: {best['candidate'].item()}. It shortens the intervals of the standard manoeuvres to "
        f"{float(best['width_ratio']):.2f} of their width, that of the {index} of the {manoeuvre} "
        f"from ± {width[1]:.2g} to ± {width[0]:.2g} {unit if unit != 'm' else 'L'}. The run takes "
        f"{float(best['sea_room']) / vessel.particulars.L:.1f} L of sea room."
    ]
