"""Base classes of priors and exact posteriors, and the coordinates g in which a posterior is diagonal.

With X diag(kappa)^(1/2) = U S R', g = R' diag(kappa)^(-1/2) (b - mean) enters the likelihood by z - s g, z = U' (y - X
mean). Inverse gamma densities are ~ x^(-shape-1) exp(-scale/x); the B of Xue et al. (2020) is 1 / scale.
"""

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pymc_ship.inference.rows.data import FEWEST_ROWS, UNEVEN, RegressionData
from pymc_ship.inference.rows.frames import Formula, check_same_rows, new_design, row_labels
from pymc_ship.machine.arguments import check_counts, check_kind, real_array, short_repr
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.fields import field_text
from pymc_ship.machine.seeds import Seed, random_generator

_LOG_2PI = math.log(2.0 * math.pi)
_SMALLEST_GAMMA = 1e-200  # keeps draws of the noise variance finite for shapes near 0
# largest sizes: squares stay finite, and the rows are not lost to rounding
_LARGEST = {"mean": 1e100, "kappa": 1e200, "shape": 1e15, "scale": math.inf}
_FAR = 10.0  # prior standard deviations of a fitted response
_MOST_ROWS = 8  # coefficients in the text of a posterior


@dataclass(frozen=True, eq=False, repr=False)
class Prior(ABC):
    """Prior of scaled coefficients and noise variance.

    Given sigma2 the scaled coefficients are independent and normal, with variance ``kappa sigma2^noise_power``. A new
    family defines the attributes and ``exact``; :func:`~pymc_ship.inference.regression.families.register_family`.

    Parameters
    ----------
    mean, kappa : float or array_like, shape (n_terms,)
        Prior mean and variance factor (V = kappa I or diag(kappa)) of each scaled coefficient.
    shape, scale : float
        Noise variance sigma2 ~ InverseGamma(shape, scale): alpha and beta of PyMC. InferenceError unless the
        hyperparameters are finite and, but for the mean, positive.

    Attributes
    ----------
    family, colour, citation : str
        Name of the family, its hex colour in figures, and further source of its exact posterior.
    noise_power : float
        1 if the prior variance of the coefficients is proportional to the noise variance, 0 if independent of it.
    box : mapping of str to (float, float)
        Bounds of the hyperparameters in a search, by argument of :meth:`from_box`, for z-scored data.
    hyperprior_rate : float
        Rate of the exponential law of ``shape`` in a search by evidence, which else has no maximum.
    """

    mean: float | np.ndarray = 0.0
    kappa: float | np.ndarray = 100.0
    shape: float = 2.0
    scale: float = 1.0

    family: ClassVar[str] = ""
    noise_power: ClassVar[float]
    box: ClassVar[Mapping[str, tuple[float, float]]]
    hyperprior_rate: ClassVar[float] = 1.0
    colour: ClassVar[str] = "#6b7680"
    citation: ClassVar[str] = ""

    __repr__ = field_text

    def __post_init__(self) -> None:
        for name in ("mean", "kappa", "shape", "scale"):
            value = _numbers(name, getattr(self, name))
            if rule := _broken_rule(name, value):
                found = np.asarray(value).tolist()
                raise InferenceError(f"The prior's {name} must be {rule[0]}, found {found}; {rule[1]}.")
            object.__setattr__(self, name, value)

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, Prior) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple:
        values = (np.asarray(getattr(self, field.name)) for field in fields(self))
        return (self.family, *((value.shape, *value.ravel().tolist()) for value in values))

    @classmethod
    def from_box(cls, *, shape: float, noise_variance: float, kappa: float) -> "Prior":
        """Prior of mean zero at a point of the box; ``noise_variance`` is scale / shape."""
        return cls(shape=shape, scale=shape * noise_variance, kappa=kappa)

    @abstractmethod
    def exact(self, data: RegressionData) -> "ExactPosterior":
        """Exact posterior of regression data under this prior."""

    def means(self, n_terms: int) -> np.ndarray:
        """Prior means, shape (n_terms,)."""
        return self._vector("mean", n_terms)

    def kappas(self, n_terms: int) -> np.ndarray:
        """Prior variance factors, shape (n_terms,)."""
        return self._vector("kappa", n_terms)

    def _vector(self, name: str, n_terms: int) -> np.ndarray:
        value = np.asarray(getattr(self, name))
        if value.ndim == 1 and value.shape != (n_terms,):
            raise InferenceError(
                f"The prior's {name} is one value or {n_terms}, one for each term; found {value.size}."
            )
        return np.full(n_terms, value) if value.ndim == 0 else value

    def hyperparameters(self) -> dict:
        """Family and hyperparameters as a plain dict (lists for vectors)."""
        names = [field.name for field in fields(self) if field.init]
        return {"family": self.family, **{name: np.asarray(getattr(self, name)).tolist() for name in names}}

    @property
    def noise_variance_mean(self) -> float:
        """Prior mean of the noise variance on the scaled response; infinite where the shape is not above 1."""
        return self.scale / (self.shape - 1.0) if self.shape > 1.0 else math.inf

    def variance_factor[Given: (float, np.ndarray)](self, noise_variance: Given) -> Given:
        """Prior variance of the scaled coefficients over kappa, given the noise variance; same shape."""
        return noise_variance**self.noise_power

    def coefficient_variance[Given: (float, np.ndarray)](self, noise_variance: Given, n_terms: int) -> np.ndarray:
        """Prior variance of the scaled coefficients given the noise variance, a number or of shape (..., 1)."""
        return self.kappas(n_terms) * self.variance_factor(noise_variance)

    def draw_noise_variance(self, rng: Seed, size: tuple[int, ...] = ()) -> np.ndarray:
        """Draws of the noise variance on the scaled response from the prior, of the given shape."""
        rng = random_generator(rng)
        return self.scale / np.maximum(rng.standard_gamma(self.shape, size), _SMALLEST_GAMMA)

    def draw(self, n_terms: int, rng: Seed, size: tuple[int, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Draws from the prior: scaled coefficients, shape (..., n_terms), and noise variance, shape ``size``."""
        rng = random_generator(rng)
        noise_variance = self.draw_noise_variance(rng, size)
        spread = np.sqrt(self.coefficient_variance(noise_variance[..., None], n_terms))
        return self.means(n_terms) + spread * rng.standard_normal((*size, n_terms)), noise_variance

    def log_noise_variance(self, noise_variance: np.ndarray) -> np.ndarray:
        """Log prior density of the noise variance on the scaled response, same shape."""
        return log_inverse_gamma(noise_variance, self.shape, self.scale)

    def log_coefficients(self, coefficients: np.ndarray, noise_variance: np.ndarray) -> np.ndarray:
        """Log prior density of scaled coefficients, shape (..., n_terms), given the noise variance, shape (...)."""
        n_terms = coefficients.shape[-1]
        kappa = self.kappas(n_terms)
        distance = np.sum((coefficients - self.means(n_terms)) ** 2 / kappa, axis=-1)
        factor = self.variance_factor(noise_variance)
        return -0.5 * (n_terms * (_LOG_2PI + np.log(factor)) + np.sum(np.log(kappa)) + distance / factor)


def rescaled_prior(prior: Prior, data: RegressionData, rows: RegressionData) -> Prior:
    """Prior of the same original coefficients on the scales of other rows, if it has a vector, made for the data.

    A prior of one number for all terms is of any scaled columns, and stays; so does that of a centred constant.
    """
    if not (np.ndim(prior.mean) or np.ndim(prior.kappa)):
        return prior
    ratio = (data.response_scale / data.column_scale) / (rows.response_scale / rows.column_scale)
    if data.constant >= 0 and data.column_center.any():
        ratio[data.constant] = 1.0
    return replace(prior, mean=prior.means(data.n_terms) * ratio, kappa=prior.kappas(data.n_terms) * ratio**2)


class ExactPosterior(ABC):
    """Exact posterior of coefficients and noise variance, on the original scale.

    ``coefficients`` are n_terms names, with ``mean``, shape (n_terms,), and ``covariance``, shape (n_terms, n_terms);
    ``log_evidence`` is the log density p(y) of the original response.
    """

    coefficients: tuple[str, ...]
    log_evidence: float

    if TYPE_CHECKING:  # a field or a property of the subclass

        @property
        def mean(self) -> np.ndarray: ...  # noqa: D102

        @property
        def covariance(self) -> np.ndarray: ...  # noqa: D102

        @property
        def noise_variance_mean(self) -> float: ...  # noqa: D102

        @property
        def noise_variance_sd(self) -> float: ...  # noqa: D102

    def __repr__(self) -> str:
        names = ["noise variance", *self.coefficients]
        means = [self.noise_variance_mean, *self.mean]
        width = max(map(len, names[: _MOST_ROWS + 1]))
        sds = [self.noise_variance_sd, *self.sd]
        rows = [f"  {name:{width}}  {mean:.4g} ± {sd:.2g}" for name, mean, sd in zip(names, means, sds, strict=True)]
        more = len(self.coefficients) - _MOST_ROWS
        head = f"{type(self).__name__} of {len(self.coefficients)} coefficients, log evidence {self.log_evidence:.6g}"
        return "\n".join([head, *rows[: _MOST_ROWS + 1], *([f"  and {more} more"] if more > 0 else [])])

    @property
    def sd(self) -> np.ndarray:
        """Posterior standard deviation of each coefficient, shape (n_terms,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def evidence_gradient(self) -> np.ndarray | None:
        """Derivative of the log evidence by the logs of shape, noise variance and kappa; None if not worked out."""
        return None

    @abstractmethod
    def draw(self, draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Independent draws: coefficients, shape (draws, n_terms), and noise variance, shape (draws,)."""

    @abstractmethod
    def quantiles(self, probabilities: ArrayLike) -> np.ndarray:
        """Marginal quantiles of the coefficients, shape (n, n_terms), at n probabilities from 0 to 1."""

    @abstractmethod
    def noise_variance_quantiles(self, probabilities: ArrayLike) -> np.ndarray:
        """Quantiles of the noise variance at n probabilities, shape (n,)."""

    @abstractmethod
    def log_predictive_density(
        self, design_matrix: np.ndarray, response: np.ndarray, *, pointwise: bool = False
    ) -> float | np.ndarray:
        """Log density of new rows given the data: joint, or of each row if ``pointwise``."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class RotatedPosterior(ExactPosterior):
    """Exact posterior of coefficients = center + g basis, where g given the noise variance has independent components.

    ``center`` is the prior mean; ``prior_shape`` and ``prior_scale`` are of the prior of the noise variance.
    """

    coefficients: tuple[str, ...]
    center: np.ndarray
    basis: np.ndarray
    prior_shape: float
    prior_scale: float
    log_evidence: float
    formula: Formula | None = None

    @abstractmethod
    def _draw_rotated(self, draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draws of g, shape (draws, n_terms), and of the noise variance, shape (draws,)."""

    @abstractmethod
    def _moments(self, rotated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean, relative to that at the center, and variance of the response of rotated rows, shape (n_new,)."""

    @abstractmethod
    def _log_each(self, rotated: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """Log density of each new row; the residual is the response minus its mean at the center."""

    @abstractmethod
    def _log_joint(self, rotated: np.ndarray, residual: np.ndarray) -> float:
        """Joint log density of new rows."""

    def draw(self, draws: int, rng: Seed) -> tuple[np.ndarray, np.ndarray]:
        """Independent draws: coefficients, shape (draws, n_terms), and noise variance, shape (draws,)."""
        check_counts(InferenceError, draws=draws)
        coefficients, noise_variance = self._draw_rotated(draws, random_generator(rng))
        rotate_back(coefficients, np.ascontiguousarray(self.basis.T), self.center)
        return coefficients, noise_variance

    def prior_noise_variance_density(self, noise_variance: np.ndarray) -> np.ndarray:
        """Prior density of the noise variance at the given values, same shape."""
        return np.exp(log_inverse_gamma(noise_variance, self.prior_shape, self.prior_scale))

    def predict(self, new_rows: Any) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd, shape (n_new,), of the response of new rows, noise included; rows as for ``new_design``."""
        rotated, middle = self._rotate_rows(new_rows)
        mean, variance = self._moments(rotated)
        return middle + mean, np.sqrt(variance)

    def log_predictive_density(
        self, design_matrix: np.ndarray, response: np.ndarray, *, pointwise: bool = False
    ) -> float | np.ndarray:
        """Log predictive density of new rows; InferenceError for wrong shapes or values that are not finite."""
        rotated, middle = self._rotate_rows(design_matrix)
        check_same_rows(design_matrix, response, "response")
        y = real_array("The response", response, InferenceError)
        if y.shape != middle.shape or not np.isfinite(y).all():
            raise InferenceError(f"The response has one finite value for each of {len(middle)} rows; check it.")
        return (self._log_each if pointwise else self._log_joint)(rotated, y - middle)

    def _rotate_rows(self, new_rows: Any) -> tuple[np.ndarray, np.ndarray]:
        X = new_design(new_rows, self.coefficients, self.formula)
        return X @ self.basis.T, X @ self.center


@njit(cache=True, fastmath={"reassoc", "contract"})
def rotate_back(rotated: np.ndarray, columns: np.ndarray, center: np.ndarray) -> None:
    """Replace draws of g, shape (draws, n_terms), by coefficients in place; ``columns`` is the transposed basis."""
    g = np.empty(center.size)
    for draw in rotated:
        g[:] = draw
        for j in range(g.size):
            total = center[j]
            for i in range(g.size):
                total += columns[j, i] * g[i]
            draw[j] = total


def log_inverse_gamma(value: np.ndarray, shape: float, scale: float) -> np.ndarray:
    """Log density of an inverse gamma variable at the given values, same shape."""
    value = np.asarray(value, dtype=float)
    constant = shape * math.log(scale) - math.lgamma(shape)
    return constant - (shape + 1.0) * np.log(value) - scale / value


def check_data(data: object) -> None:
    """Raise InferenceError for anything else than :class:`RegressionData`, such as a table."""
    remedy = "make it by regression_data or RegressionData.from_arrays"
    check_kind("The data of a regression", data, RegressionData, remedy, InferenceError)


def check_prior(prior: object, data: object, *, own: str = "") -> None:
    """As :func:`check_data`, and unless the prior is a :class:`Prior`; ``own`` names what else is accepted."""
    check_data(data)
    if not isinstance(prior, Prior):
        raise InferenceError(
            f"The prior of a regression is a Prior such as ConjugatePrior(kappa=100.0){own}, found "
            f"{short_repr(prior)}; make one, or choose one by maximise_evidence."
        )


def warn_of_rows(data: RegressionData, prior: Prior) -> None:
    """Warn of repeated rows, dependent columns, or a default prior that does not suit unscaled columns or response."""
    own_kappa = np.ndim(prior.kappa) > 0 or prior.kappa != type(prior).kappa
    text = "" if own_kappa else data.uneven
    own_scale = prior.scale != type(prior).scale
    if not (text or data.is_scaled or (own_kappa and own_scale)) and data.n_rows >= FEWEST_ROWS:
        columns = float(np.sum(data.design_matrix**2)) / data.n_rows
        response = float(np.sqrt(np.mean(data.response**2)))
        faults = {
            "a response too large for it": not own_kappa
            and prior.noise_power == 0
            and response > _FAR * math.sqrt(prior.kappa * columns),
            "a response too small for it": not own_scale and 0.0 < response < 1.0 / UNEVEN,
            "columns too small for it": not own_kappa and prior.noise_power > 0 and prior.kappa * columns < 1.0,
        }
        wrong = " and ".join(fault for fault, present in faults.items() if present)
        if wrong:
            text = (
                f"The default prior must suit the units of the data, found {wrong} (root mean square {response:.2g} of "
                f"the response, {math.sqrt(columns):.2g} of a row of columns); take scaling='zscore', or kappa and "
                "scale in these units."
            )
    for fault in filter(None, (text, data.dependent, data.repeated)):
        warnings.warn(fault, UserWarning, stacklevel=3)


def _broken_rule(name: str, value: float | np.ndarray) -> tuple[str, str] | None:
    """Rule that a hyperparameter breaks, and its remedy; None if it keeps all."""
    least, most = (value, value) if isinstance(value, float) else (value.min(initial=1.0), value.max(initial=1.0))
    n_dims = 1 if name in ("mean", "kappa") else 0
    if np.ndim(value) > n_dims or not (math.isfinite(least) and math.isfinite(most)):
        return "finite", "give a plain number"
    if name != "mean" and least <= 0.0:
        return "positive", "raise it above 0"
    if max(-least, most) > _LARGEST[name]:
        return f"at most {_LARGEST[name]:g} in size", "reduce it"
    return None


def _numbers(name: str, value: object) -> float | np.ndarray:
    """Hyperparameter as a number, or as a copy that stays as it is."""
    if type(value) is float:
        return value
    try:
        if np.asarray(value).dtype.kind not in "iufO":
            raise TypeError
        numbers = real_array(name, value)
    except (TypeError, ValueError, OverflowError):
        raise InferenceError(
            f"The prior's {name} must be finite, found {short_repr(value)}; give a plain number."
        ) from None
    labels = row_labels(value)
    if labels is not None and not np.array_equal(labels, np.arange(len(labels))):
        raise InferenceError(
            f"The prior's {name} has no labels, found {short_repr(list(map(str, labels)))}; put it into the order of "
            "the terms and give it without them, by to_numpy."
        )
    numbers.setflags(write=False)
    return numbers if numbers.ndim else float(numbers)


@dataclass(frozen=True)
class Rotation:
    """Sufficient statistics of the scaled response under a prior; original coefficients = center + g basis."""

    singular_values: np.ndarray  # s; 0 for directions without information, and so z
    projection: np.ndarray  # z
    residual_square: float  # |e|^2
    center: np.ndarray
    basis: np.ndarray


def rotate(data: RegressionData, prior: Prior) -> Rotation:
    """Rotate regression data; for scalar kappa and zero mean from the decomposition that the data keep."""
    wide = data.n_terms > data.n_rows
    mean = prior.means(data.n_terms)
    decompose = np.ndim(prior.kappa) or wide
    if decompose:
        root = np.sqrt(prior.kappas(data.n_terms))
        left, s, right = np.linalg.svd(data.scaled_design_matrix * root, full_matrices=wide)
        basis = (right * root) @ data.transformation[1].T
    else:
        left, s, _ = data.svd
        s, basis = math.sqrt(prior.kappa) * s, math.sqrt(prior.kappa) * data.basis
    if decompose or mean.any():
        # the residual is formed explicitly: y'y - z'z would cancel for a response with a large offset
        error = data.scaled_response - data.scaled_design_matrix @ mean
        z = left.T @ error
        residual_square = float(np.sum((error - left @ z) ** 2))
    else:
        z, residual_square = data.projection
    if missing := data.n_terms - len(s):
        s, z = (np.pad(values, (0, missing)) for values in (s, z))
    return Rotation(s, z, residual_square, data.to_original(mean), basis)
