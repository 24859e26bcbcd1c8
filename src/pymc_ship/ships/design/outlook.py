"""What the report of an identified ship says ahead: her turning circle, and the run that would tell most next."""

from __future__ import annotations

from typing import Any

import numpy as np

from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.manoeuvre.standard import STANDARD
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.ships.design.next_run import design
from pymc_ship.ships.ensemble.draws import thinned_draws
from pymc_ship.ships.ensemble.index_error import steady_error
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.forecast import pooled_forecast

_DRAWS = 200  # at most
_INSIDE = 0.95  # probability of intervals


def outlook(ship: Ship, rng: np.random.Generator) -> tuple[str, ...]:
    """Sentences on the turning circle of an identified ship, and on the standard manoeuvre that would tell most next.

    Empty where hardly any draw reaches an index.
    """
    vessel, drawn = ship.models[0][0], thinned_draws(ship.models, _DRAWS)
    settings: dict[str, Any] = simulation_settings(vessel) | {"ci_prob": _INSIDE, "rng": rng, "motion": ship.motion}
    settings["errors"] = (ship.index_error or {}) | steady_error(ship.motion_error)
    turns = []
    for manoeuvre in (one for one in STANDARD if one.traits.circles):
        duration = manoeuvre.traits.reach * vessel.particulars.ship_time
        bands = pooled_forecast(drawn, manoeuvre, duration=duration, **settings)["index_bands"].dataset
        lower, median, upper = (bands["tactical_diameter"] / vessel.particulars.L).values.tolist()
        turns += [f"{median:.2f} L ({lower:.2f} to {upper:.2f}) to {manoeuvre.side}"] if np.isfinite(median) else []
    said = [f"Tactical diameter of the turning circle of 35 deg: {', '.join(turns)}."] if turns else []
    try:
        plan = design(ship, STANDARD, draws=_DRAWS)
    except SimulationError:
        return tuple(said)
    best = plan.sel(candidate=plan["chosen"].item(), step=1)
    now, then = plan["half_width"].values
    most = int(np.argmin(then / now))
    target, unit = (str(plan[name].values[most]) for name in ("target", "units"))
    sailed, index = target.split(", ")
    width = np.array([then[most], now[most]]) / (vessel.particulars.L if unit == "m" else 1.0)
    said.append(
        f"As the next run the {best['candidate'].item()} would tell most: the intervals of the standard manoeuvres "
        f"would be {float(best['width_ratio']):.2f} times as wide as now, that of the {index} of the {sailed} "
        f"± {width[0]:.2g} in place of ± {width[1]:.2g} {unit if unit != 'm' else 'L'}. The run takes "
        f"{float(best['sea_room']) / vessel.particulars.L:.1f} L of sea room."
    )
    return tuple(said)
