"""Priors of all coefficients of a vessel at once, for fits of whole trajectories.

theta_j ~ N(mean_j, (tau_g scale_j)^2) with one tau for each degree of freedom g, found by evidence, or 1. Fits
to windows take the same mean and scale for those of Student's t.
"""

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

KINDS = ("flat", "order_damped", "sister_ship")
"""Priors that need no numbers of the user's own."""

FREEDOM = 4.0
"""Degrees of freedom of a prior that is Student's t."""


class GaussianLikelihood(NamedTuple):
    """Gaussian likelihood of all coefficients theta: ``response - design @ theta`` is standard normal.

    ``design`` (n_rows, n_coefficients), ``response`` (n_rows,).
    """

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
    mean : ndarray, shape (n_coefficients,)
    scale : ndarray, shape (n_coefficients,)
        Standard deviation before the factor tau of the degree of freedom; infinite for a flat prior.
    unit : ndarray, shape (n_coefficients,)
        Typical size of a coefficient: the scale where it is finite.
    tuned : ndarray of bool, shape (n_coefficients,)
        Whether the scale is multiplied by the factor tau found by evidence; the others are taken as stated.
    kind : str
    likelihood : GaussianLikelihood or None
        Likelihood of other data, such as captive tests.
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
        """Likelihood of other data; one without rows where there are none."""
        return self.likelihood or GaussianLikelihood(np.empty((0, self.mean.size)), np.empty(0))

    def as_normal_at(self, coefficients: np.ndarray, sd: np.ndarray) -> CoefficientPrior:
        """Normal prior that stands for Student's t of these scales at a posterior.

        Student's t is a mixture of normal laws; their mean precision at the posterior is (FREEDOM + 1) / (FREEDOM +
        E z^2), z the distance from the mean in scales (Lange, Little & Taylor 1989,
        doi:10.1080/01621459.1989.10478852). What the data leave open keeps its scale, as E z^2 is 1 there: tails that
        no data cut are left out.

        Parameters
        ----------
        coefficients, sd : ndarray, shape (n_coefficients,)
            Posterior mean and standard deviation.
        """
        square = ((coefficients - self.mean) ** 2 + sd**2) / self.scale**2
        return replace(self, scale=self.scale * np.sqrt((FREEDOM + square) / (FREEDOM + 1.0)))

    def draw(self, draws: int, rng: np.random.Generator) -> np.ndarray:
        """Draws of the prior alone, every factor tau at 1, shape (draws, n_coefficients).

        Raises
        ------
        InferenceError
            Where a scale is infinite.
        """
        flat = int(np.sum(~np.isfinite(self.scale)))
        if flat:
            raise InferenceError(
                f"Draws need a prior with a standard deviation of every coefficient, found {flat} of {self.scale.size} "
                f"without (prior {self.kind}); use order_damped or sister_ship, or state them in a table."
            )
        return self.mean + self.scale * rng.standard_normal((draws, self.mean.size))


def coefficient_dofs(vessel: Vessel) -> np.ndarray:
    """Index of the degree of freedom of each coefficient among ``vessel.dofs``, shape (n_coefficients,).

    Parameters of parts act in all of them and count among the first; no factor tau changes them.
    """
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
    """Prior of all coefficients from general knowledge and, where there is any, from a table or the vessel file.

    Parameters
    ----------
    trials : sequence of Dataset
        Give the typical size of each coefficient: rms force of the DOF over rms term.
    vessel : Vessel, str or Path
        Its reference coefficients are looked at for ``"sister_ship"`` only, but for those with an ``sd`` in the file:
        they are N(value, sd) whatever the kind.
    kind : {"order_damped", "sister_ship", "flat"}, optional
        Centred on 0 with a scale of twice the typical size that falls with the order of the term; centred on the
        vessel's reference values with ``relative_sd`` of them (and of a 20th of the typical size, so that a
        coefficient near 0 is not taken as known); or no prior.
    table : mapping of str to (float, float), optional
        Mean and standard deviation of single coefficients by name, prime values; goes before the vessel file.
    damping : float, optional
        Factor of the scale for each order above the first.
    relative_sd : float, optional
        Relative standard deviation of a sister ship's coefficients.

    Returns
    -------
    CoefficientPrior
        With factors tau left to the evidence, but for a flat prior and for the table.

    Raises
    ------
    InferenceError
        For an unknown kind, a damping outside (0, 1], a relative sd or a table's sd that is not positive, or unknown
        names.

    Examples
    --------
    A sister ship's coefficients, but for one that a table states and that no factor tau changes:

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
        terms = [term for dof in vessel.dofs for term in vessel.terms(dof)]
        scale = 2.0 * typical[: len(terms)] * np.array([damping ** max(order(term) - 1, 0) for term in terms])
        scale = np.concatenate([scale, known])
    elif kind == "sister_ship":
        mean = reference_coefficients(vessel)
        scale = relative_sd * np.hypot(mean, 0.05 * typical)
    else:
        scale = np.full(typical.size, np.inf)
    tuned = np.isfinite(scale)
    for name, (center, sd) in (_stated(vessel) | dict(table or {})).items():
        if name not in names or not 0.0 < sd < np.inf or not np.isfinite(center):
            raise InferenceError(
                f"A table gives a finite mean and a positive sd of coefficients of {vessel.name!r}, found "
                f"{name}: {center}, {sd}; correct it."
            )
        mean[names.index(name)], scale[names.index(name)], tuned[names.index(name)] = center, sd, False
    unit = np.where(np.isfinite(scale), scale, typical)
    return CoefficientPrior(mean, scale, unit, tuned, kind)


def _stated(vessel: Vessel) -> dict[str, tuple[float, float]]:
    """Mean and sd of the coefficients that the vessel file knows beforehand."""
    every = [*(c for force in vessel.forces.values() for c in force), *vessel.parameters]
    return {c.name: (c.value, c.sd) for c in every if c.sd > 0.0}
