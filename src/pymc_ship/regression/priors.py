"""The two prior families of the regression and their hyperparameters.

Both live on the scaled columns of :class:`~pymc_ship.regression.data.RegressionData` and use the standard
parametrisation of the inverse gamma, density proportional to x^(-shape-1) exp(-scale/x) (``scale`` of scipy, ``beta``
of PyMC). The B of Xue et al. (2020) is its reciprocal: ``scale = 1 / B``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pymc_ship.machine.arguments import check_choice

_LOG_2PI = math.log(2.0 * math.pi)


class PriorError(ValueError):
    """Hyperparameters that define no prior."""


@dataclass(frozen=True, eq=False)
class _Prior:
    """Hyperparameters shared by both families; priors of one family with the same hyperparameters are equal.

    Parameters
    ----------
    mean : float or array_like, shape (n_terms,)
        Prior mean of the scaled coefficients.
    kappa : float or array_like, shape (n_terms,)
        Prior variance factor of each scaled coefficient (V = kappa I or diag(kappa)).
    shape, scale : float
        sigma2 ~ InverseGamma(shape, scale).

    Raises
    ------
    PriorError
        When a value is no finite number, or kappa, shape or scale is not positive.
    """

    mean: float | np.ndarray = 0.0
    kappa: float | np.ndarray = 100.0
    shape: float = 2.0
    scale: float = 1.0

    family: ClassVar[str] = ""

    def __post_init__(self):
        for name in ("mean", "kappa", "shape", "scale"):
            value = _numbers(name, getattr(self, name))
            if value.ndim > (1 if name in ("mean", "kappa") else 0) or not np.isfinite(value).all():
                raise PriorError(f"The prior's {name} must be finite, found {value.tolist()}; give a plain number.")
            if name != "mean" and (value <= 0.0).any():
                raise PriorError(f"The prior's {name} must be positive, found {value.tolist()}; raise it above 0.")
            value.setflags(write=False)
            object.__setattr__(self, name, float(value) if value.ndim == 0 else value)

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, _Prior) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple:
        values = (np.asarray(getattr(self, name)) for name in ("mean", "kappa", "shape", "scale"))
        return (self.family, *((value.shape, *value.ravel().tolist()) for value in values))

    def means(self, n_terms: int) -> np.ndarray:
        """Prior means, shape (n_terms,)."""
        return self._vector("mean", n_terms)

    def kappas(self, n_terms: int) -> np.ndarray:
        """Prior variance factors, shape (n_terms,)."""
        return self._vector("kappa", n_terms)

    def _vector(self, name: str, n_terms: int) -> np.ndarray:
        value = np.asarray(getattr(self, name))
        if value.ndim == 1 and value.shape != (n_terms,):
            raise PriorError(f"The prior's {name} is one value or {n_terms}, one for each term; found {value.size}.")
        return np.full(n_terms, value) if value.ndim == 0 else value

    def hyperparameters(self) -> dict:
        """Plain dict of the hyperparameters (lists for vectors), with the family."""
        plain = {name: np.asarray(getattr(self, name)).tolist() for name in ("mean", "kappa", "shape", "scale")}
        return {"family": self.family, **plain}

    def log_noise_variance(self, noise_variance: np.ndarray) -> np.ndarray:
        """Log prior density of the noise variance on the scaled response, same shape."""
        A, b = self.shape, self.scale
        return A * math.log(b) - math.lgamma(A) - (A + 1.0) * np.log(noise_variance) - b / noise_variance

    def log_coefficients(self, coefficients: np.ndarray, noise_variance: np.ndarray) -> np.ndarray:
        """Log prior density of scaled coefficients, shape (..., n_terms), given the noise variance, shape (...)."""
        n_terms = coefficients.shape[-1]
        kappa = self.kappas(n_terms)
        distance = np.sum((coefficients - self.means(n_terms)) ** 2 / kappa, axis=-1)
        factor = noise_variance if isinstance(self, ConjugatePrior) else 1.0
        return -0.5 * (n_terms * (_LOG_2PI + np.log(factor)) + np.sum(np.log(kappa)) + distance / factor)


@dataclass(frozen=True, eq=False)
class ConjugatePrior(_Prior):
    """Normal inverse gamma: beta | sigma2 ~ N(mean, sigma2 V), sigma2 ~ IG(shape, scale); see the base for parameters.

    References
    ----------
    Xue et al. (2020), Eq. 12; doi:10.1016/j.oceaneng.2019.106612.

    Examples
    --------
    The prior mean of the noise variance, on the scale of the z-scored response:

    >>> import pymc_ship as ps
    >>> prior = ps.ConjugatePrior(kappa=1e4, shape=3.0, scale=0.1)
    >>> prior.scale / (prior.shape - 1)
    0.05
    """

    family: ClassVar[str] = "conjugate"


@dataclass(frozen=True, eq=False)
class SemiConjugatePrior(_Prior):
    """Independent: beta ~ N(mean, V), sigma2 ~ IG(shape, scale); see the base for parameters.

    References
    ----------
    Xue et al. (2020), Eq. 18; doi:10.1016/j.oceaneng.2019.106612.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> ps.SemiConjugatePrior(kappa=1e4, shape=3.0, scale=0.1)
    SemiConjugatePrior(mean=0.0, kappa=10000.0, shape=3.0, scale=0.1)
    """

    family: ClassVar[str] = "semiconjugate"


def _numbers(name: str, value: object) -> np.ndarray:
    """Copy of a hyperparameter as floats."""
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufO":
            raise TypeError
        return np.array(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise PriorError(f"The prior's {name} must be finite, found {value!r}; give a plain number.") from None


FAMILIES = {"conjugate": ConjugatePrior, "semiconjugate": SemiConjugatePrior}
"""Prior families by name."""


def prior_family(family: str) -> type[_Prior]:
    """Class of a prior family; a PriorError names the families when there is none of that name."""
    check_choice("A prior family", family, FAMILIES, PriorError)
    return FAMILIES[family]
