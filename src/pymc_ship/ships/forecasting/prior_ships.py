"""Prior predictive check in the space of trajectories: draws of a prior in a manoeuvre."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.predictive import prior_draws
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.machine.arguments import check_counts
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, one_manoeuvre, turning_circle, zigzag
from pymc_ship.physics.motion.stability import growth_rates
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names
from pymc_ship.ships.ensemble.draws import coefficient_draws
from pymc_ship.ships.ensemble.scores import BANDS
from pymc_ship.ships.forecasting.forecast import pooled_forecast

# Status of a draw, the first that is true, and the name of its attr ..._fraction; wrong way: turns against the rudder
STATUSES = ("diverged", "wrong way", "course-unstable", "complete")
OUTCOMES = ("diverged", "wrong_way", "course_unstable", "complete")
STANDARD = {  # manoeuvres of a prior predictive check, and their indices that IMO MSC.137(76) limits
    zigzag(10, 10): ("first_overshoot_angle", "second_overshoot_angle"),
    turning_circle(35): ("advance", "tactical_diameter"),
}
TURNED_DEG = 10.0  # heading change [deg] of a turn: that of the initial turning ability of IMO MSC.137(76)
RegressionPrior = tuple[RegressionData, Prior] | xr.DataTree  # of one DOF; the prior is on scaled columns


def prior_ships(
    vessel: VesselLike,
    prior: CoefficientPrior | xr.DataTree | Mapping[str, RegressionPrior],
    manoeuvre: Manoeuvre,
    *,
    draws: int = 300,
    rng: Seed,
    duration: float | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Simulate a manoeuvre with draws of a prior.

    Parameters
    ----------
    vessel : Vessel, str or Path
    prior : CoefficientPrior, DataTree or mapping of str to (RegressionData, Prior) or DataTree
        Prior of all coefficients (factors tau are 1), a tree with the group prior, or one of them for each DOF; a DOF
        that a mapping leaves out has the vessel's reference values.
    manoeuvre : Manoeuvre
    draws : int, optional
    rng : int, SeedSequence or Generator
    duration : float, optional
        [s]; by default that of :func:`pymc_ship.forecast`.
    **settings
        ``step``, ``method`` and ``record_interval``, as :func:`pymc_ship.forecast`.

    Returns
    -------
    Dataset, dims (draw,)
        ``status``, one of :data:`STATUSES`; ``diverged`` and ``diverged_at`` [s]; ``wrong_way``: the heading first
        changed by 10 deg (or the smaller switching heading) against the rudder; ``course_unstable`` and
        ``growth_rate`` [U/L], the largest real part of the eigenvalues of linear sway, yaw and roll; the indices of
        the manoeuvre; ``coefficients`` (draw, coefficient). Attrs: ``..._fraction`` of each of :data:`OUTCOMES` (a draw
        may count in several), ``fixed_dofs`` (at their reference values) and ``summary``, a sentence.

    Raises
    ------
    InferenceError
        For a prior without a standard deviation, of another vessel or of no known form.
    VesselError, SimulationError, ValueError
        For a prior that lacks coefficients of the vessel, settings that cannot run or fewer than two draws.

    References
    ----------
    Gabry et al. (2019), J. R. Statist. Soc. A 182(2):389, doi:10.1111/rssa.12378; IMO (2002), resolution MSC.137(76).
    """
    check_counts(least=2, draws=draws)
    rng, vessel, manoeuvre = random_generator(rng), as_vessel(vessel), one_manoeuvre(manoeuvre)
    ships = simulate_draws(vessel, _rows(vessel, prior, draws, rng), manoeuvre, rng, duration=duration, **settings)
    in_prior = vessel.dofs if isinstance(prior, CoefficientPrior | xr.DataTree) else prior
    attrs = {**ships.attrs, "fixed_dofs": " ".join(dof for dof in vessel.dofs if dof not in in_prior)}
    return ships.assign_attrs(attrs | {"summary": _summary(attrs)})


def simulate_draws(
    vessel: Vessel,
    rows: np.ndarray,
    manoeuvre: Manoeuvre,
    rng: np.random.Generator,
    *,
    duration: float | None = None,
    **settings: Any,
) -> xr.Dataset:
    """As :func:`prior_ships`, for given coefficients, shape (n_draws, n_coefficients)."""
    if duration is None:
        duration = manoeuvre.traits.reach * vessel.particulars.ship_time
    settings = simulation_settings(vessel, **settings, duration=duration, ci_prob=0.9)
    tree = pooled_forecast([(vessel, rows)], manoeuvre, rng=rng, **settings)
    ships = tree["trajectories"].to_dataset()
    growth = growth_rates(vessel, rows, ships.attrs["approach_speed"])
    flags = dict(zip(OUTCOMES, (ships["diverged"].values, _wrong_way(ships, manoeuvre), growth > 0.0), strict=False))
    status = np.select(list(flags.values()), STATUSES[:-1], STATUSES[-1])
    variables = tree["indices"].to_dataset() if "indices" in tree.children else xr.Dataset()
    variables = variables.assign(
        {
            **{name: ("draw", value) for name, value in ({"status": status} | flags).items()},
            "diverged_at": ships["diverged_at"],
            "growth_rate": ("draw", growth, {"units": "U/L"}),
            "coefficients": (("draw", "coefficient"), rows),
        }
    )
    fractions = {f"{name}_fraction": float(np.mean(mask)) for name, mask in flags.items()}
    fractions["complete_fraction"] = float(np.mean(status == STATUSES[-1]))
    attrs = {**ships.attrs, "label": manoeuvre.label, "draws": len(rows), **fractions}
    return variables.assign_coords(draw=ships["draw"], coefficient=coefficient_names(vessel)).assign_attrs(attrs)


def status_row(ships: xr.Dataset) -> dict:
    """Row of a table: ``manoeuvre``, number of ``ships`` and percentage in each of :data:`OUTCOMES`."""
    percentages = {name: 100.0 * ships.attrs[f"{name}_fraction"] for name in OUTCOMES}
    return {"manoeuvre": ships.attrs["label"], "ships": ships.attrs["draws"], **percentages}


def index_row(ships: xr.Dataset, index: str, L: float, *, ci_prob: float) -> dict:
    """Row of a table: ``unit`` (L for distances) and band of an index over the draws that reach it, ``reached`` %."""
    values, unit = ships[index].values, ships[index].attrs["units"]
    values = values[np.isfinite(values)] / (L if unit == "m" else 1.0)
    tail = 0.5 * (1.0 - ci_prob)
    band = np.quantile(values, [tail, 0.5, 1.0 - tail]) if values.size else np.full(3, np.nan)
    reached = {"reached": 100.0 * values.size / ships.sizes["draw"]}
    return {"unit": "L" if unit == "m" else unit} | dict(zip(BANDS, band.tolist(), strict=True)) | reached


def _rows(
    vessel: Vessel,
    prior: CoefficientPrior | xr.DataTree | Mapping[str, RegressionPrior],
    draws: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draws of all coefficients from a prior, shape (draws, n_coefficients)."""
    if isinstance(prior, CoefficientPrior):
        names = coefficient_names(vessel)
        if prior.mean.shape != (len(names),):
            raise InferenceError(
                f"A prior of {vessel.name!r} has {len(names)} coefficients, found {prior.mean.size}; make it with "
                "this vessel."
            )
        return prior.draw(draws, rng)
    if not isinstance(prior, Mapping):
        raise InferenceError(
            "A prior is a CoefficientPrior, a tree with the group prior or a mapping of DOFs, found "
            f"{type(prior).__name__}; make one, for example with coefficient_prior."
        )
    if isinstance(prior, xr.DataTree):
        return coefficient_draws(vessel, _checked_tree(prior, "The tree"), draws, rng, group="prior")
    trees = {dof: _tree(dof, dof_prior, draws, rng) for dof, dof_prior in prior.items()}
    return coefficient_draws(vessel, trees, draws, rng, group="prior")


def _tree(dof: str, dof_prior: RegressionPrior, draws: int, rng: np.random.Generator) -> xr.DataTree:
    if isinstance(dof_prior, xr.DataTree):
        return _checked_tree(dof_prior, f"The tree of {dof}")
    kinds = tuple(map(type, dof_prior)) if isinstance(dof_prior, tuple) else ()
    if len(kinds) != 2 or not issubclass(kinds[0], RegressionData) or not issubclass(kinds[1], Prior):
        raise InferenceError(
            f"The prior of {dof} is a pair of RegressionData and Prior or a tree with the group prior, found "
            f"{type(dof_prior).__name__}; give the data that scale the prior."
        )
    data, prior = dof_prior
    return xr.DataTree.from_dict({"prior": prior_draws(data, prior, draws, rng=rng)})


def _checked_tree(tree: xr.DataTree, name: str) -> xr.DataTree:
    if "prior" not in tree.children or "coefficients" not in tree["prior"].data_vars:
        raise InferenceError(f"{name} has no coefficients in a group prior; add the group with with_predictive.")
    return tree


def _wrong_way(ships: xr.Dataset, manoeuvre: Manoeuvre) -> np.ndarray:
    """Whether each heading changed against the rudder first, shape (n_draws,)."""
    delta = ships["delta"].values[0]
    steered = np.flatnonzero(delta)
    if not steered.size:
        return np.zeros(ships.sizes["draw"], dtype=bool)
    psi = ships["psi"].values[:, steered[0] :]
    change = -np.sign(delta[steered[0]]) * (psi - psi[:, :1])
    threshold = min(np.deg2rad(TURNED_DEG), manoeuvre.switch[0])
    has_turned = np.abs(change) >= threshold
    first = change[np.arange(len(change)), has_turned.argmax(axis=1)]
    return has_turned.any(axis=1) & (first < 0.0)


def _summary(attrs: Mapping) -> str:
    diverged, wrong, unstable, complete = (f"{100.0 * attrs[f'{name}_fraction']:.3g} %" for name in OUTCOMES)
    fixed = f", {', '.join(attrs['fixed_dofs'].split())} at reference values" if attrs["fixed_dofs"] else ""
    return (
        f"Of {attrs['draws']} draws of the prior in a {attrs['label']}{fixed}: {diverged} diverge, {wrong} turn the "
        f"wrong way, {unstable} are course-unstable; {complete} do none of this."
    )
