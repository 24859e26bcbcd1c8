"""Priors of all coefficients: theta_j ~ N(mean_j, (tau_g scale_j)^2), tau of each DOF g by evidence or 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.inference.rows.weak_form import coefficient_scales
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.fields import field_text
from pymc_ship.physics.forces.terms import order
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, reference_coefficients

KINDS = ("flat", "order_damped", "sister_ship")  # kinds of prior that need no table
FREEDOM = 4.0  # degrees of freedom of the Student-t prior of fits to windows


class GaussianLikelihood(NamedTuple):
    """Gaussian likelihood of all coefficients theta: ``response - design @ theta`` is standard normal."""

    design: np.ndarray
    response: np.ndarray

    def residuals(self, coefficients: np.ndarray) -> np.ndarray:
        """Standardised residuals at these coefficients, (n_rows,)."""
        return self.response - self.design @ coefficients


@dataclass(frozen=True, eq=False, repr=False)
class CoefficientPrior:
    """Independent normal priors of all coefficients, prime, in the vessel's order, with the likelihood of other data.

    Attributes
    ----------
    mean, scale : ndarray, shape (n_coefficients,); the sd is tau times the scale, infinite for a flat prior
    unit : ndarray, shape (n_coefficients,); typical size of a coefficient, the scale where it is finite
    tuned : ndarray of bool, shape (n_coefficients,); False where tau is 1
    kind : str
    likelihood : GaussianLikelihood or None; likelihood of other data, such as captive tests
    """

    mean: np.ndarray
    scale: np.ndarray
    unit: np.ndarray
    tuned: np.ndarray
    kind: str
    likelihood: GaussianLikelihood | None = None

    __repr__ = field_text

    @property
    def likelihood_or_flat(self) -> GaussianLikelihood:
        """Likelihood of other data; without rows where there are none."""
        return self.likelihood or GaussianLikelihood(np.empty((0, self.mean.size)), np.empty(0))

    def as_normal_at(self, coefficients: np.ndarray, sd: np.ndarray) -> CoefficientPrior:
        """Normal prior equivalent to Student's t at a posterior mean and sd, each (n_coefficients,).

        Mean precision of the scale mixture (Lange, Little & Taylor 1989, doi:10.1080/01621459.1989.10478852).
        """
        square = ((coefficients - self.mean) ** 2 + sd**2) / self.scale**2
        return replace(self, scale=self.scale * np.sqrt((FREEDOM + square) / (FREEDOM + 1.0)))

    def draw(self, draws: int, rng: np.random.Generator) -> np.ndarray:
        """Draws of the prior at tau = 1, shape (draws, n_coefficients); InferenceError where a scale is infinite."""
        flat = int(np.sum(~np.isfinite(self.scale)))
        if flat:
            raise InferenceError(
                f"Draws need a prior with a standard deviation of every coefficient, found {flat} of {self.scale.size} "
                f"without (prior {self.kind}); use order_damped or sister_ship, or give them in a table."
            )
        return self.mean + self.scale * rng.standard_normal((draws, self.mean.size))


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
    damping: float = 0.3,
    relative_sd: float = 0.3,
) -> CoefficientPrior:
    """Prior of all coefficients by kind, overridden by a table or the vessel file.

    Parameters
    ----------
    trials : sequence of Dataset
        Typical size of each coefficient: rms force of the DOF over rms term.
    vessel : Vessel, str or Path
        Reference coefficients with an ``sd`` in the file are N(value, sd); the others are used by ``"sister_ship"``.
    kind : {"order_damped", "sister_ship", "flat"}, optional
        Mean 0, scale twice the typical size times ``damping`` for each order above the first; mean at the reference
        value c, scale ``relative_sd`` times hypot(c, typical size / 20); or no prior.
    table : mapping of str to (float, float), optional
        Mean and sd of single coefficients by name, prime values; overrides the vessel file.
    damping, relative_sd : float, optional
        Factor of the scale for each order above the first; relative sd of a sister ship's coefficients.

    Returns
    -------
    CoefficientPrior
        With tau by evidence, except for a flat prior, the table and the vessel file.

    Raises
    ------
    InferenceError
        For an unknown kind, a damping outside (0, 1], a relative sd or a table's sd that is not positive, or unknown
        names.

    Examples
    --------
    Coefficients of a sister ship, one of them from a table (no factor tau):

    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> prior = ps.coefficient_prior([trial], vessel, "sister_ship", table={"XT": (0.001, 0.0001)})
    >>> prior.mean.shape, float(prior.mean[0]), bool(prior.tuned[0])
    ((29,), 0.001, False)
    """
    vessel = as_vessel(vessel)
    if kind not in KINDS or not 0.0 < damping <= 1.0 or not 0.0 < relative_sd < np.inf:
        raise InferenceError(
            f"A prior of coefficients is one of {', '.join(KINDS)} with damping in (0, 1] and a positive relative sd, "
            f"found {kind!r}, {damping} and {relative_sd}; correct them."
        )
    known = np.array([parameter.sd for parameter in vessel.parameters])
    typical = np.concatenate([coefficient_scales(trials, vessel) if any(vessel.forces.values()) else [], known])
    mean, names = np.zeros(typical.size), coefficient_names(vessel)
    if kind == "order_damped":
        damping_factors = [damping ** max(order(term) - 1, 0) for dof in vessel.dofs for term in vessel.terms(dof)]
        scale = np.concatenate([2.0 * typical[: len(damping_factors)] * np.array(damping_factors), known])
    elif kind == "sister_ship":
        mean = reference_coefficients(vessel)
        scale = relative_sd * np.hypot(mean, 0.05 * typical)
    else:
        scale = np.full(typical.size, np.inf)
    tuned = np.isfinite(scale)
    every = [*(c for force in vessel.forces.values() for c in force), *vessel.parameters]
    vessel_file = {c.name: (c.value, c.sd) for c in every if c.sd > 0.0}
    for name, (center, sd) in (vessel_file | dict(table or {})).items():
        if name not in names or not 0.0 < sd < np.inf or not np.isfinite(center):
            raise InferenceError(
                f"A table gives a finite mean and a positive sd of coefficients of {vessel.name!r}, found "
                f"{name}: {center}, {sd}; correct it."
            )
        k = names.index(name)
        mean[k], scale[k], tuned[k] = center, sd, False
    return CoefficientPrior(mean, scale, np.where(np.isfinite(scale), scale, typical), tuned, kind)
