"""Ships drawn from the study's priors and posteriors."""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.identify import Identification
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.trajectory.prior import CoefficientPrior, coefficient_prior
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.replication.measurements import published_prior
from pymc_ship.ships.ensemble.draws import coefficient_draws
from pymc_ship.ships.forecasting.prior_ships import (
    STANDARD,
    RegressionPrior,
    index_row,
    prior_ships,
    simulate_draws,
    status_row,
)

SHIPS = 200  # ships of each prior in each manoeuvre: a proportion of 50 % has a standard error of 3.5 %

CI_PROB = 0.9  # probability of the bands of the indices, as that of the study's forecasts

POSTERIOR = "posterior"  # choice that names the ships of a family's posterior


def study_priors(
    vessel: Vessel, identification: Identification, trial: xr.Dataset
) -> dict[tuple[str, str], CoefficientPrior | Mapping[str, RegressionPrior]]:
    """Priors of all degrees of freedom that the study compares, by family and choice.

    The published choice is among them where every DOF has published estimates. ``trial``, dims (time,), scales the
    order-damped prior of the trajectory fits.
    """
    priors: dict[tuple[str, str], CoefficientPrior | Mapping[str, RegressionPrior]] = {}
    for family, by_dof in identification.tuned.items():
        choices: dict[str, Mapping[str, Prior | None]] = {
            "chosen": identification.priors[family],
            "evidence maximum": {dof: tuned.evidence_prior for dof, tuned in by_dof.items()},
            "published": {dof: published_prior(vessel, family, dof) for dof in by_dof},
        }
        for choice, chosen in choices.items():
            known = {dof: (identification.data[dof], prior) for dof, prior in chosen.items() if prior is not None}
            if len(known) == len(chosen):
                priors[family, choice] = known
    priors["trajectory fit", "order-damped, factors 1"] = coefficient_prior([trial], vessel, "order_damped")
    return priors


def prior_ship_rows(
    vessel: Vessel,
    identification: Identification,
    trial: xr.Dataset,
    rng: Callable[[str, str], np.random.Generator],
    *,
    ships: int = SHIPS,
) -> list[dict]:
    """How the ships of each prior, and of each family's posterior, end in the standard manoeuvres.

    ``rng`` gives a generator for a family and a choice; ``ships`` are drawn of each. Keys: ``family``, ``choice``,
    those of :func:`pymc_ship.ships.forecasting.prior_ships.status_row`, and ``index``, the first index of the manoeuvre
    that IMO limits, with those of :func:`pymc_ship.ships.forecasting.prior_ships.index_row`.
    """
    rows = []
    for (family, choice), prior in study_priors(vessel, identification, trial).items():
        generator = rng(family, choice)
        ships_by_manoeuvre = {of: prior_ships(vessel, prior, of, draws=ships, rng=generator) for of in STANDARD}
        rows += _rows(vessel, ships_by_manoeuvre, family, choice)
    for family in identification.exact:
        generator = rng(family, POSTERIOR)
        drawn = coefficient_draws(vessel, identification.posteriors(family, draws=400, rng=generator), ships, generator)
        ships_by_manoeuvre = {of: simulate_draws(vessel, drawn, of, generator) for of in STANDARD}
        rows += _rows(vessel, ships_by_manoeuvre, family, POSTERIOR)
    return rows


def _rows(vessel: Vessel, ships_by_manoeuvre: dict, family: str, choice: str) -> list[dict]:
    L, rows = vessel.particulars.L, []
    for manoeuvre, ships in ships_by_manoeuvre.items():
        index = STANDARD[manoeuvre][0]
        band = index_row(ships, index, L, ci_prob=CI_PROB)
        rows.append({"family": family, "choice": choice, **status_row(ships), "index": index.replace("_", " "), **band})
    return rows
