"""Hyperparameters of a prior by Bayesian optimisation of its cross-validated elpd, or by maximum evidence."""

import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy

from pymc_ship.inference.regression.cross_validation import cross_validation
from pymc_ship.inference.regression.families import prior_family
from pymc_ship.inference.regression.priors import Prior, check_data
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_kind, real_array
from pymc_ship.machine.errors import InferenceError
from pymc_ship.machine.seeds import Seed, random_generator

_STARTS = 12  # points of the Latin hypercube
_RESOLUTION = 0.1  # nat, where the loss of the search turns from linear to logarithmic


class BoundWarning(UserWarning):
    """The search of a prior ended at a bound of its box."""


@dataclass(frozen=True, eq=False, repr=False)
class TunedPrior:
    """Prior of the best cross-validated elpd, with the search; a score is the elpd per held-out row, mean over folds.

    Attributes
    ----------
    prior, score, score_se
        The better of the evaluated and the surrogate prior, its score and standard error over the folds.
    evaluated_prior, surrogate_prior, evidence_prior
        Best point evaluated, optimum of the surrogate's mean, prior of :func:`maximise_evidence`; with their scores.
    points, scores : ndarray, shape (evaluations, 3), (evaluations,)
        Shape, scale and kappa of the points evaluated, in order, and their scores.
    """

    prior: Prior
    score: float
    score_se: float
    evaluated_prior: Prior
    evaluated_score: float
    surrogate_prior: Prior
    surrogate_score: float
    points: np.ndarray
    scores: np.ndarray
    evidence_prior: Prior
    log_evidence: float
    evidence_score: float
    box: Mapping[str, tuple[float, float]]

    def __repr__(self) -> str:
        others = [("best point", self.evaluated_prior, self.evaluated_score)]
        others += [("surrogate", self.surrogate_prior, self.surrogate_score)]
        others += [("evidence", self.evidence_prior, self.evidence_score)]
        head = f"TunedPrior of the {self.prior.family} family, {len(self.scores)} evaluations"
        lines = [f"  {'prior':12}{_numbers(self.prior)}, score {self.score:.5g} ± {self.score_se:.2g}"]
        lines += [f"  {name:12}{_numbers(prior)}, score {score:.5g}" for name, prior, score in others]
        edges = [f"  {name:12}on an edge of its box: {', '.join(at)}" for name, at in self.edges.items()]
        return "\n".join([head, *lines, *edges])

    @property
    def edges(self) -> dict[str, tuple[str, ...]]:
        """Hyperparameters on a bound of the box, by ``prior`` or ``evidence``; empty if there are none."""
        names = {"prior": on_edge(self.prior, self.box), "evidence": on_edge(self.evidence_prior, self.box)}
        return {name: at for name, at in names.items() if at}


def tune_prior(
    data: RegressionData,
    family: str = "conjugate",
    *,
    evaluations: int = 40,
    folds: int = 5,
    split: str = "blocks",
    box: dict[str, tuple[float, float]] | None = None,
    rng: Seed,
) -> TunedPrior:
    """Hyperparameters by Bayesian optimisation of the K-fold log predictive density; the prior mean is zero.

    A Latin hypercube of 12 points (at most a third of the evaluations), then expected improvement under a Gaussian
    process over log hyperparameters. The loss is asinh(10 (r - score)), r the score of the prior of maximum evidence.
    ``family`` is a registered one; ``folds`` and ``split`` as :func:`.cross_validation`; ``box`` has bounds of
    ``shape``, ``noise_variance`` (scale / shape) and ``kappa``, by default those of the family. BoundWarning for a
    prior at a bound, InferenceError for an unknown family, impossible folds, fewer than 6 evaluations, or a box as
    :func:`maximise_evidence`. Xue et al. (2020), Algorithm 2; Jones, Schonlau & Welch (1998),
    doi:10.1023/A:1008306431147.
    """
    rng = random_generator(rng)
    prior_type = prior_family(family)
    bounds = _log_bounds(prior_type, box)
    if evaluations < 6:
        raise InferenceError(f"The search evaluates at least 6 points, found {evaluations}; raise evaluations.")
    validation = cross_validation(data, folds, split=split, rng=rng)
    evidence_prior, log_evidence = _evidence_maximum(data, prior_type, bounds)
    evidence_score = validation.score(evidence_prior).mean

    def loss(point: np.ndarray) -> float:
        return float(np.arcsinh((evidence_score - validation.score(_prior(prior_type, point)).mean) / _RESOLUTION))

    points, losses, surrogate_point = _search(loss, bounds, evaluations, rng)
    evaluated, surrogate = (_prior(prior_type, point) for point in (points[np.argmin(losses)], surrogate_point))
    evaluated_score, surrogate_score = validation.score(evaluated), validation.score(surrogate)
    candidates = [(evaluated, evaluated_score), (surrogate, surrogate_score)]
    best, score = max(candidates, key=lambda candidate: candidate[1].mean)
    priors = [_prior(prior_type, point) for point in points]
    _warn_of_search(best, box, data)
    return TunedPrior(
        prior=best,
        score=score.mean,
        score_se=score.se,
        evaluated_prior=evaluated,
        evaluated_score=evaluated_score.mean,
        surrogate_prior=surrogate,
        surrogate_score=surrogate_score.mean,
        points=np.array([[prior.shape, prior.scale, prior.kappa] for prior in priors]),
        scores=evidence_score - _RESOLUTION * np.sinh(losses),
        evidence_prior=evidence_prior,
        log_evidence=log_evidence,
        evidence_score=evidence_score,
        box=dict(prior_type.box if box is None else box),
    )


def maximise_evidence(
    data: RegressionData, family: str = "conjugate", *, box: dict[str, tuple[float, float]] | None = None
) -> tuple[Prior, float]:
    """Prior of maximum evidence (empirical Bayes) in a box.

    The log of a weak hyperprior of the shape is added.

    Parameters
    ----------
    data : RegressionData
    family, box : optional
        As :func:`tune_prior`.

    Returns
    -------
    prior : Prior
        With mean zero.
    log_evidence : float

    Raises
    ------
    InferenceError
        For an unknown family, or a box with other names or with bounds not positive and increasing.

    Warns
    -----
    BoundWarning
        If the prior lies at a bound of the box.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> data = ps.regression_data(noisy, vessel, "yaw", derivative="weak")
    >>> prior, log_evidence = ps.maximise_evidence(data, family="conjugate")
    >>> print(f"{log_evidence:.0f} > {ps.ConjugatePrior().exact(data).log_evidence:.0f}")
    625 > 515
    """
    check_data(data)
    prior_type = prior_family(family)
    prior, log_evidence = _evidence_maximum(data, prior_type, _log_bounds(prior_type, box))
    _warn_of_search(prior, box, data)
    return prior, log_evidence


def _evidence_maximum(data: RegressionData, prior_type: type[Prior], bounds: np.ndarray) -> tuple[Prior, float]:
    low, width = bounds[:, 0], np.ptp(bounds, axis=1)

    def loss(fraction: np.ndarray) -> tuple[float, np.ndarray] | float:
        prior = _prior(prior_type, low + width * np.clip(fraction, 0.0, 1.0))
        posterior, penalty = prior.exact(data), prior.hyperprior_rate * prior.shape
        value, gradient = penalty - posterior.log_evidence, posterior.evidence_gradient if by_gradient else None
        return value if gradient is None else (value, width * (np.array([penalty, 0.0, 0.0]) - gradient))

    middle = _prior(prior_type, low + 0.5 * width).exact(data)
    by_gradient = tuple(prior_type.box) == ("shape", "noise_variance", "kappa") and middle.evidence_gradient is not None
    corners = [corner for corner in product((-1, 1), repeat=len(low)) if corner.count(1) % 2 == 0]
    starts = 0.5 + 0.25 * np.array([[0] * len(low), *corners])
    options = {"maxiter": 200} | ({} if by_gradient else {"eps": 1e-6})
    rough = _minimise(loss, starts, options | {"ftol": 1e-4}, by_gradient=by_gradient)
    best = _minimise(loss, rough[None], options | {"ftol": 1e-13}, by_gradient=by_gradient)
    prior = _prior(prior_type, low + width * best)
    return prior, prior.exact(data).log_evidence


def on_edge(prior: Prior, box: Mapping[str, tuple[float, float]] | None = None) -> tuple[str, ...]:
    """Names of the hyperparameters that lie on a bound of a box, the family's own by default."""
    box = prior.box if box is None else box
    values = {name: getattr(prior, name, None) for name in box} | {"noise_variance": prior.scale / prior.shape}
    return tuple(
        name
        for name, value in values.items()
        if name in box and isinstance(value, float) and np.isclose(math.log(value), np.log(box[name]), atol=1e-3).any()
    )


def bound_text(what: str, names: Iterable[str]) -> str:
    """Sentence on a prior with hyperparameters on a bound of the box; ``what`` is its subject."""
    return f"{what} lies at a bound of {' and '.join(names)}: the bound, not the data, ended the search"


def _warn_of_search(prior: Prior, box: Mapping[str, tuple[float, float]] | None, data: RegressionData) -> None:
    for text in filter(None, (data.uneven, data.repeated)):
        warnings.warn(text, UserWarning, stacklevel=3)
    if names := on_edge(prior, box):
        text = bound_text(f"The {prior.family} prior{f' of the {data.dof}' * bool(data.dof)}", names)
        warnings.warn(f"{text}; check terms and units, or give a wider box.", BoundWarning, stacklevel=3)


def _search(
    loss: Callable[[np.ndarray], float], bounds: np.ndarray, evaluations: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points evaluated (log hyperparameters), the loss there, and the optimum of the surrogate's mean."""
    from sklearn.exceptions import ConvergenceWarning
    from skopt import Optimizer
    from skopt.utils import cook_estimator, normalize_dimensions
    from threadpoolctl import threadpool_limits

    seed, space = int(rng.integers(2**31)), [tuple(map(float, pair)) for pair in bounds]
    dimensions = normalize_dimensions(space)
    surrogate = cook_estimator("GP", space=dimensions, random_state=seed, noise=1e-6, n_restarts_optimizer=0)
    optimizer = Optimizer(
        space,
        base_estimator=surrogate,
        acq_func="EI",
        acq_optimizer_kwargs={"n_points": 2000, "n_restarts_optimizer": 2},
        n_initial_points=min(_STARTS, evaluations // 3),
        initial_point_generator="lhs",
        random_state=seed,
    )
    points, losses = np.empty((evaluations, len(bounds))), np.empty(evaluations)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The objective has been evaluated at point", UserWarning)
        warnings.filterwarnings("ignore", category=ConvergenceWarning)
        for k in range(evaluations):
            points[k] = optimizer.ask()
            losses[k] = loss(points[k])
            optimizer.tell(list(points[k]), losses[k])
        low, width = bounds[:, 0], np.ptp(bounds, axis=1)
        fraction = _surrogate_optimum(optimizer.models[-1], (points - low) / width, rng)
    return points, losses, low + width * fraction


def _surrogate_optimum(surrogate: Any, evaluated: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    candidates = np.vstack([rng.random((4096, evaluated.shape[1])), np.clip(evaluated, 0.0, 1.0)])
    best = candidates[np.argsort(surrogate.predict(candidates))[:5]]
    return _minimise(lambda x: float(surrogate.predict(x[None])[0]), best)


def _minimise(
    loss: Callable[[np.ndarray], Any],
    starts: np.ndarray,
    options: dict[str, float] | None = None,
    *,
    by_gradient: bool = False,
) -> np.ndarray:
    """Minimum of a loss in the unit cube by L-BFGS-B from several starts; the loss may come with its gradient."""
    bounds = [(0.0, 1.0)] * starts.shape[1]
    results = [
        scipy.optimize.minimize(loss, x, jac=by_gradient or None, method="L-BFGS-B", bounds=bounds, options=options)
        for x in starts
    ]
    return np.clip(min(results, key=lambda result: result.fun).x, 0.0, 1.0)


def _log_bounds(prior_type: type[Prior], box: Mapping[str, tuple[float, float]] | None) -> np.ndarray:
    names = tuple(prior_type.box)
    box = prior_type.box if box is None else box
    check_kind("A box", box, Mapping, "give a dict of bounds by name of hyperparameter", InferenceError)
    if set(box) != set(names):
        raise InferenceError(f"A box bounds {', '.join(names)}, found {', '.join(box) or 'nothing'}; name these.")
    bounds = real_array("Bounds", [box[name] for name in names], InferenceError)
    if bounds.shape != (len(names), 2) or not (bounds[:, 0] > 0.0).all() or not (bounds[:, 0] < bounds[:, 1]).all():
        raise InferenceError(f"Bounds are pairs that rise and lie above 0, found {bounds.tolist()}; mend them.")
    return np.log(bounds)


def _numbers(prior: Prior) -> str:
    return f"shape {prior.shape:.4g}, scale {prior.scale:.4g}, kappa {prior.kappa:.4g}"


def _prior(prior_type: type[Prior], point: np.ndarray) -> Prior:
    return prior_type.from_box(**dict(zip(prior_type.box, np.exp(point).tolist(), strict=True)))
