"""Priors of all coefficients: Student's t whose scales the records choose, or fixed normal laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.inference.rows.weak_form import coefficient_scales
from pymc_ship.inference.trajectory.scale_law import FACTOR_SD, FREEDOM, ScaleLaw
from pymc_ship.machine.arguments import check_kind, number_or_nan, short_repr
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.fields import field_text
from pymc_ship.physics.forces.terms import order
from pymc_ship.physics.vessel.hull_database import is_symmetric, particulars_prior
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, reference_coefficients
from pymc_ship.trial.record import trial_list

KINDS = ("flat", "order_damped", "sister_ship")  # kinds of prior that need no table

ASYMMETRY = float(np.log(0.1))
"""Prior mean of the log factor of terms that a ship alike on both sides does not have: a tenth of the others."""


class GaussianLikelihood(NamedTuple):
    """Gaussian likelihood of all coefficients theta: ``response - design @ theta`` is standard normal."""

    design: np.ndarray
    response: np.ndarray

    def residuals(self, coefficients: np.ndarray) -> np.ndarray:
        """Standardised residuals at these coefficients, (n_rows,)."""
        return self.response - self.design @ coefficients


@dataclass(frozen=True, eq=False, repr=False)
class CoefficientPrior:
    """Independent priors of all coefficients, prime, in the vessel's order, with the likelihood of other data.

    Attributes
    ----------
    mean : ndarray, shape (n_coefficients,)
    scale : ndarray, shape (n_coefficients,); of Student's t before its factors, or sd; infinite for a flat prior
    unit : ndarray, shape (n_coefficients,); typical size of a coefficient, the scale where it is finite
    kind : str
    law : ScaleLaw or None; of the factors of the scales; normal priors have none
    likelihood : GaussianLikelihood or None; likelihood of other data, such as captive tests
    """

    mean: np.ndarray
    scale: np.ndarray
    unit: np.ndarray
    kind: str
    law: ScaleLaw | None = None
    likelihood: GaussianLikelihood | None = None

    __repr__ = field_text

    @property
    def likelihood_or_flat(self) -> GaussianLikelihood:
        """Likelihood of other data; without rows where there are none."""
        return self.likelihood or GaussianLikelihood(np.empty((0, self.mean.size)), np.empty(0))

    @property
    def fixed(self) -> CoefficientPrior:
        """Normal prior with the factors of the scales at their prior means."""
        if self.law is None:
            return self
        return replace(self, scale=self.scale * np.exp(self.law.exponents @ self.law.center), law=None)

    def as_normal_at(self, coefficients: np.ndarray, sd: np.ndarray) -> CoefficientPrior:
        """Normal prior equivalent to Student's t at a posterior mean and sd, each (n_coefficients,).

        Mean precision of the scale mixture (Lange, Little & Taylor 1989, doi:10.1080/01621459.1989.10478852).
        """
        square = ((coefficients - self.mean) ** 2 + sd**2) / self.scale**2
        return replace(self, scale=self.scale * np.sqrt((FREEDOM + square) / (FREEDOM + 1.0)))

    def draw(self, draws: int, rng: np.random.Generator) -> np.ndarray:
        """Draws of the prior with its factors, (draws, n_coefficients); InferenceError where a scale is infinite."""
        flat = int(np.sum(~np.isfinite(self.scale)))
        if flat:
            raise InferenceError(
                f"Draws need a prior with a standard deviation of every coefficient, found {flat} of {self.scale.size} "
                f"without (prior {self.kind}); use order_damped or sister_ship, or give them in a table."
            )
        standard = rng.standard_normal((draws, self.mean.size))
        if self.law is None:
            return self.mean + self.scale * standard
        eta = self.law.center + FACTOR_SD * rng.standard_normal((draws, self.law.center.size))
        heavy = standard * np.sqrt(FREEDOM / rng.chisquare(FREEDOM, standard.shape))
        factor = np.exp(eta @ self.law.exponents.T)
        return self.mean + self.scale * np.where(self.law.is_scaled, heavy * factor, standard)


def coefficient_dofs(vessel: Vessel) -> np.ndarray:
    """Index of the DOF of each coefficient among ``vessel.dofs``, (n_coefficients,); parameters of parts count as 0."""
    linear = [np.full(len(vessel.terms(dof)), g) for g, dof in enumerate(vessel.dofs)]
    return np.concatenate([*linear, np.zeros(len(vessel.parameters), dtype=int)])


def coefficient_prior(
    trials: Sequence[xr.Dataset],
    vessel: VesselLike,
    kind: str = "order_damped",
    *,
    table: Mapping[str, tuple[float, float]] | None = None,
    relative_sd: float = 0.3,
) -> CoefficientPrior:
    """Prior of all coefficients of a vessel, by kind.

    Parameters
    ----------
    trials : sequence of Dataset
        Typical size of each coefficient, rms force of the DOF over rms term, for ``"sister_ship"`` and ``"flat"``.
    vessel : Vessel, str or Path
        Its particulars; reference coefficients with an ``sd`` in the file are N(value, sd); the others are used by
        ``"sister_ship"``.
    kind : {"order_damped", "sister_ship", "flat"}, optional
        Student's t with mean and scale from the particulars (:func:`.particulars_prior`) and factors that the records
        choose: tau of each degree of freedom for the terms of the hull, its other symmetric terms and its asymmetric
        terms, and a damping for each order above the first; mean at the reference value c, scale ``relative_sd`` times
        hypot(c, typical size / 20) and tau; or no prior.
    table : mapping of str to (float, float), optional
        Mean and sd of single coefficients by name, prime values; overrides the vessel file.
    relative_sd : float, optional
        Relative scale of a sister ship's coefficients.

    Returns
    -------
    CoefficientPrior

    Raises
    ------
    InferenceError
        For an unknown kind, a relative sd or a table's sd that is not positive, or unknown names.
    """
    vessel, trials = as_vessel(vessel), trial_list(trials)
    if not (isinstance(kind, str) and kind in KINDS and 0.0 < number_or_nan(relative_sd) < np.inf):
        raise InferenceError(
            f"A prior of coefficients is one of {', '.join(KINDS)} with a positive relative sd, found "
            f"{short_repr(kind)} and {short_repr(relative_sd)}; correct them."
        )
    known = np.array([parameter.sd for parameter in vessel.parameters])
    if kind == "order_damped":
        mean, scale, groups = _of_particulars(vessel)
        mean, scale = np.append(mean, np.zeros(known.size)), np.append(scale, known)
        return _with_table(CoefficientPrior(mean, scale, scale, kind), groups, vessel, table)
    typical = _typical_sizes(trials, vessel)
    mean = reference_coefficients(vessel) if kind == "sister_ship" else np.zeros(typical.size)
    if kind == "flat":
        return _with_table(CoefficientPrior(mean, np.full(typical.size, np.inf), typical, kind), [], vessel, table)
    scale = relative_sd * np.hypot(mean, 0.05 * typical)
    groups = [_Group(f"tau {dof}", coefficient_dofs(vessel) == g) for g, dof in enumerate(vessel.dofs)]
    return _with_table(CoefficientPrior(mean, scale, scale, kind), groups, vessel, table)


def wide_prior(trials: Sequence[xr.Dataset], vessel: Vessel) -> CoefficientPrior:
    """Prior about 0 with twice the typical size as scale of every order, and the values of the vessel file."""
    scale = 2.0 * _typical_sizes(trials, vessel)
    scale[scale.size - len(vessel.parameters) :] /= 2.0
    return _with_table(CoefficientPrior(np.zeros(scale.size), scale, scale, "wide"), [], vessel, None)


def _typical_sizes(trials: Sequence[xr.Dataset], vessel: Vessel) -> np.ndarray:
    """Typical size of all coefficients: rms force of the DOF over rms term; the sd of parameters of parts."""
    sizes = coefficient_scales(trials, vessel) if any(vessel.forces.values()) else np.empty(0)
    return np.append(sizes, [parameter.sd for parameter in vessel.parameters])


class _Group(NamedTuple):
    """Coefficients with a factor in common: name, its power for each coefficient, and the prior mean of its log."""

    name: str
    power: np.ndarray
    center: float = 0.0


def _of_particulars(vessel: Vessel) -> tuple[np.ndarray, np.ndarray, list[_Group]]:
    """Mean, scale and groups of the terms by the particulars, for the degrees of freedom with terms."""
    if not any(vessel.forces.values()):
        return np.empty(0), np.empty(0), []
    known, none = particulars_prior(vessel), np.zeros(len(vessel.parameters), dtype=bool)
    terms = [(term, dof) for dof in vessel.dofs for term in vessel.terms(dof)]
    symmetric = np.append([is_symmetric(*pair) for pair in terms], none)
    orders = np.append([max(order(term) - 1, 0) for term, _ in terms], none)
    hull = np.append(known.of_hull, none)
    groups = []
    for g, dof in enumerate(vessel.dofs):
        belongs = coefficient_dofs(vessel) == g
        groups += [
            _Group(f"tau {dof} hull", belongs & hull),
            _Group(f"tau {dof}", belongs & symmetric & ~hull),
            _Group(f"tau {dof} asymmetric", belongs & ~symmetric, ASYMMETRY),
            _Group(f"damping {dof}", belongs * orders * ~hull),
        ]
    return known.mean, known.scale, groups


def _with_table(
    prior: CoefficientPrior, groups: Sequence[_Group], vessel: Vessel, table: Mapping[str, tuple[float, float]] | None
) -> CoefficientPrior:
    """Prior with the values of a table and of the vessel file, and the law of the scales of the other coefficients."""
    mean, scale, unit, names = prior.mean.copy(), prior.scale.copy(), prior.unit.copy(), coefficient_names(vessel)
    is_fixed = np.zeros(mean.size, dtype=bool)
    is_fixed[mean.size - len(vessel.parameters) :] = True
    in_file = [*(c for force in vessel.forces.values() for c in force), *vessel.parameters]
    known = {c.name: (c.value, c.sd) for c in in_file if c.sd > 0.0}
    table = {} if table is None else table
    check_kind("The table of a prior", table, Mapping, "give a dict by name of coefficient", InferenceError)
    for name, pair in (known | dict(table)).items():
        is_pair = isinstance(pair, tuple | list | np.ndarray) and len(pair) == 2
        center, sd = map(number_or_nan, pair if is_pair else (pair, None))
        if name not in names or not 0.0 < sd < np.inf or not np.isfinite(center):
            raise InferenceError(
                f"A table gives a finite mean and a positive sd of coefficients of {vessel.name!r}, found "
                f"{name}: {center}, {sd}; correct it."
            )
        k = names.index(name)
        mean[k], scale[k], unit[k], is_fixed[k] = center, sd, sd, True
    powers = [np.where(is_fixed, 0.0, group.power) for group in groups]
    chosen = [k for k, power in enumerate(powers) if power.any()]
    law = None
    if chosen:
        law = ScaleLaw(
            np.column_stack([powers[k] for k in chosen]),
            np.array([groups[k].center for k in chosen]),
            tuple(groups[k].name for k in chosen),
        )
    return replace(prior, mean=mean, scale=scale, unit=unit, law=law)
