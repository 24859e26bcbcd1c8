"""What ships a prior holds: its draws carried into a manoeuvre, before there is a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.predictive import prior_draws
from pymc_ship.inference.trajectory.prior import CoefficientPrior
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

STATUSES = ("diverged", "wrong way", "course-unstable", "sailed")
"""How a ship of a prior ends: the first that is true of her. `ran away`: she leaves the model's range. `wrong way`: she
turns against her rudder. `course-unstable`: she leaves a straight course by herself. `sailed`: none of these."""

SHARES = ("diverged", "wrong_way", "course_unstable", "sailed")
"""Shares of ships, in the order of the statuses, as attrs name them after ``share_``."""

STANDARD = {
    zigzag(10, 10): ("first_overshoot_angle", "second_overshoot_angle"),
    turning_circle(35): ("advance", "tactical_diameter"),
}
"""Manoeuvres by which a prior is judged, and their indices that IMO MSC.137(76) limits."""

TURNED_DEG = 10.0
"""Heading change [deg] by which a ship has turned: that of the initial turning ability of IMO MSC.137(76)."""

RegressionPrior = tuple[RegressionData, Prior] | xr.DataTree
"""Prior of one degree of freedom: its data and the prior on their scaled columns, or a tree with the group prior."""


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
    """Simulate a manoeuvre with ships drawn from a prior: its predictive check in the space of trajectories.

    Parameters
    ----------
    vessel : Vessel, str or Path
    prior : CoefficientPrior, DataTree or mapping of str to (RegressionData, Prior) or DataTree
        Prior of all coefficients, whose factors tau are 1; or the prior of each DOF: a regression prior with the data
        that scale it, or a tree that has the group prior, as from :func:`pymc_ship.with_predictive`. One tree may hold
        all coefficients. A DOF that a mapping leaves out keeps the vessel's reference values.
    manoeuvre : Manoeuvre
    draws : int, optional
        Simulated ships.
    rng : int, SeedSequence or Generator
    duration : float, optional
        [s]; by default what a forecast of this kind of manoeuvre lasts, 40 L/U for the standard ones.
    **settings
        ``step``, ``method`` and ``record_interval``, as :func:`pymc_ship.forecast`; where none of them is given,
        Runge-Kutta steps of L/U / 240, of which each fourth is kept.

    Returns
    -------
    Dataset, dims (draw,)
        ``status``: how the ship ended, the first of :data:`STATUSES` that is true of her; ``diverged`` and
        ``diverged_at`` [s, NaN where she did not run away]; ``wrong_way``, whether her heading changed by 10 deg (or by
        the switching heading, where that is smaller) against the rudder first; ``course_unstable``, whether a small
        disturbance of her straight course grows, and ``growth_rate`` [U/L], the largest real part of the eigenvalues
        of her linear sway, yaw and roll at the approach speed; the indices of the manoeuvre, as
        :func:`pymc_ship.indices`, NaN where she does not reach them; ``coefficients`` (draw, coefficient). Attrs tell
        the shares ``share_diverged``, ``share_wrong_way``, ``share_course_unstable`` (a ship may count in several),
        ``share_sailed``, ``held`` (DOFs at their reference values) and ``summary``, a sentence.

    Raises
    ------
    InferenceError
        For a prior without a standard deviation, of another vessel or of no known form.
    VesselError, SimulationError, ValueError
        For a prior that lacks coefficients of the vessel, settings that cannot run or fewer than two draws.

    References
    ----------
    Gabry et al. (2019), J. R. Statist. Soc. A 182(2):389, doi:10.1111/rssa.12378; IMO (2002), resolution MSC.137(76).

    Examples
    --------
    Before a fit, the default prior of a tanker: most of its ships are none that were ever built.

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> prior = ps.coefficient_prior([trial], vessel, "order_damped")
    >>> ships = ps.prior_ships(vessel, prior, ps.zigzag(10, 10), draws=100, rng=rng)
    >>> sister = ps.coefficient_prior([trial], vessel, "sister_ship", relative_sd=0.1)
    >>> near = ps.prior_ships(vessel, sister, ps.zigzag(10, 10), draws=100, rng=rng)
    >>> ships.attrs["share_wrong_way"] > near.attrs["share_wrong_way"] == 0.0
    True
    """
    rng, vessel, manoeuvre = random_generator(rng), as_vessel(vessel), one_manoeuvre(manoeuvre)
    if draws < 2:
        raise ValueError(f"The ships of a prior are two or more, found {draws}; raise the draws.")
    ships = simulate_draws(vessel, _rows(vessel, prior, draws, rng), manoeuvre, rng, duration=duration, **settings)
    attrs = {**ships.attrs, "held": _held(vessel, prior)}
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
    """Ships of given coefficients, shape (n_draws, n_coefficients); the rest as :func:`prior_ships`, which words it."""
    if duration is None:
        duration = manoeuvre.traits.reach * vessel.particulars.ship_time
    settings = {"step": 0.02, "record_interval": 0.5} | settings if settings else simulation_settings(vessel)
    tree = pooled_forecast([(vessel, rows)], manoeuvre, duration=duration, ci_prob=0.9, rng=rng, **settings)
    ships = tree["trajectories"].to_dataset()
    growth = growth_rates(vessel, rows, ships.attrs["approach_speed"])
    flags = {
        "diverged": ships["diverged"].values,
        "wrong_way": _wrong_way(ships, manoeuvre),
        "course_unstable": growth > 0.0,
    }
    status = np.select(list(flags.values()), STATUSES[:-1], STATUSES[-1])
    found = tree["indices"].to_dataset() if "indices" in tree.children else xr.Dataset()
    found = found.assign(
        {
            **{name: ("draw", value) for name, value in ({"status": status} | flags).items()},
            "diverged_at": ships["diverged_at"],
            "growth_rate": ("draw", growth, {"units": "U/L"}),
            "coefficients": (("draw", "coefficient"), rows),
        }
    )
    counted = zip(SHARES, [*flags.values(), status == STATUSES[-1]], strict=True)
    shares = {f"share_{name}": float(np.mean(which)) for name, which in counted}
    attrs = {**ships.attrs, "label": manoeuvre.label, "draws": len(rows), **shares}
    return found.assign_coords(draw=ships["draw"], coefficient=coefficient_names(vessel)).assign_attrs(attrs)


def share_row(ships: xr.Dataset) -> dict:
    """Row of a table: how ships of :func:`prior_ships` ended.

    Returns
    -------
    dict
        ``manoeuvre``, ``ships`` and the shares ``diverged``, ``wrong_way``, ``course_unstable``, ``sailed`` [%].
    """
    shares = {name: 100.0 * ships.attrs[f"share_{name}"] for name in SHARES}
    return {"manoeuvre": ships.attrs["label"], "ships": ships.attrs["draws"], **shares}


def index_row(ships: xr.Dataset, index: str, L: float, *, ci_prob: float) -> dict:
    """Row of a table: band of an index of ships of :func:`prior_ships`.

    Returns
    -------
    dict
        ``unit`` (L, the length of the ship, for distances), ``lower``, ``median`` and ``upper`` end of the equal-tailed
        band over the ships that reach the index (NaN without any), and ``reached``, their share [%].
    """
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
            "The prior of ships is a CoefficientPrior, a tree with the group prior or a mapping of DOFs, found "
            f"{type(prior).__name__}; make one, for example with coefficient_prior."
        )
    if isinstance(prior, xr.DataTree):
        return coefficient_draws(vessel, _with_prior(prior, "The tree"), draws, rng, group="prior")
    trees = {dof: _tree(dof, given, draws, rng) for dof, given in prior.items()}
    return coefficient_draws(vessel, trees, draws, rng, group="prior")


def _tree(dof: str, given: RegressionPrior, draws: int, rng: np.random.Generator) -> xr.DataTree:
    """Tree with draws from the prior of a DOF."""
    if isinstance(given, xr.DataTree):
        return _with_prior(given, f"The tree of {dof}")
    kinds = tuple(map(type, given)) if isinstance(given, tuple) else ()
    if len(kinds) != 2 or not issubclass(kinds[0], RegressionData) or not issubclass(kinds[1], Prior):
        raise InferenceError(
            f"The prior of {dof} is a pair of RegressionData and Prior or a tree with the group prior, found "
            f"{type(given).__name__}; give the data that scale the prior."
        )
    data, prior = given
    return xr.DataTree.from_dict({"prior": prior_draws(data, prior, draws, rng=rng)})


def _with_prior(tree: xr.DataTree, name: str) -> xr.DataTree:
    if "prior" not in tree.children or "coefficients" not in tree["prior"].data_vars:
        raise InferenceError(f"{name} has no coefficients in a group prior; add the group with with_predictive.")
    return tree


def _held(vessel: Vessel, prior: CoefficientPrior | xr.DataTree | Mapping[str, RegressionPrior]) -> str:
    """Degrees of freedom that keep the vessel's reference values, with spaces between them."""
    if isinstance(prior, CoefficientPrior | xr.DataTree):
        return ""
    return " ".join(dof for dof in vessel.dofs if dof not in prior)


def _wrong_way(ships: xr.Dataset, manoeuvre: Manoeuvre) -> np.ndarray:
    """Whether each ship's heading changed against the rudder first, shape (n_draws,)."""
    delta = ships["delta"].values[0]
    moved = np.flatnonzero(delta)
    if not moved.size:
        return np.zeros(ships.sizes["draw"], dtype=bool)
    psi = ships["psi"].values[:, moved[0] :]
    change = -np.sign(delta[moved[0]]) * (psi - psi[:, :1])
    least = min(np.deg2rad(TURNED_DEG), manoeuvre.switch[0])
    turned = np.abs(change) >= least
    first = change[np.arange(len(change)), turned.argmax(axis=1)]
    return turned.any(axis=1) & (first < 0.0)


def _summary(attrs: Mapping) -> str:
    """Say the shares in one sentence."""
    away, wrong, unstable, sailed = (f"{100.0 * attrs[f'share_{name}']:.3g} %" for name in SHARES)
    held = f", {', '.join(attrs['held'].split())} at reference values" if attrs["held"] else ""
    return (
        f"Of {attrs['draws']} ships of the prior in a {attrs['label']}{held}: {away} run away, {wrong} turn the wrong "
        f"way, {unstable} are course-unstable straight ahead; {sailed} do none of this."
    )
