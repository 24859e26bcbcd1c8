"""The PyMC model of the regression and its sampling by NUTS; pymc is imported only when called.

Two parametrisations of one posterior. ``direct`` states it as the paper does: coefficients with their prior, one normal
per row. ``whitened`` states the same density in coordinates that NUTS finds isotropic, at O(n_terms) an evaluation.
With X diag(kappa)^(1/2) = U S R' the data speak of the rotated coefficients g = R' diag(kappa)^(-1/2) (b - mean) only
through z = U' (y - X mean), and of the noise also through the square of y - X mean - U z. Given the noise variance,
prior times likelihood gives g a centre and a spread; the coordinates are (g - centre) / spread. They are no more than
coordinates: were centre and spread wrong, NUTS would be slower, not biased. Errors that are not normal have no such
summary; their models are in :mod:`pymc_ship.sampling.rows_model`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.regression.conjugate import ConjugatePrior
from pymc_ship.regression.priors import Prior, Rotation, rotate
from pymc_ship.regression.tree import posterior_tree, rng_state
from pymc_ship.rows.data import RegressionData
from pymc_ship.sampling import rows_model as error_models
from pymc_ship.sampling.error_laws import error_law, with_errors
from pymc_ship.sampling.predictive import with_predictive

if TYPE_CHECKING:
    import pymc as pm


class Summary(NamedTuple):
    """Scalars that the whitened model knows of data and prior.

    The noise variance is a priori inverse gamma of ``shape`` and ``scale``, and its power ``power`` is the prior
    variance of the rotated coefficients; ``level`` and ``width`` standardise its logarithm.
    """

    shape: float
    scale: float
    power: float
    level: float
    width: float
    n_rows: float
    residual_square: float
    response_scale: float


_SAMPLE_STATS = dict.fromkeys(("lp", "energy", "energy_error", "step_size", "step_size_bar", "acceptance_rate"), float)
_SAMPLE_STATS |= {"tree_depth": np.int64, "n_steps": np.int64, "reached_max_treedepth": bool, "diverging": bool}
"""Statistics that are kept, by their ArviZ names."""

_NUTPIE_NAMES = {"logp": "lp", "depth": "tree_depth", "mean_tree_accept": "acceptance_rate"}
_NUTPIE_NAMES |= {"maxdepth_reached": "reached_max_treedepth"}


def pymc_model(
    data: RegressionData,
    prior: Prior,
    parametrisation: str = "whitened",
    errors: str = "normal",
) -> pm.Model:
    """PyMC model of the regression; its log density is exactly that of prior and original response.

    Parameters
    ----------
    data : RegressionData
    prior : Prior
        On the scaled columns; mean and kappa may be vectors.
    parametrisation : {"whitened", "direct"}, optional
        ``direct``: free variables ``scaled_coefficients`` and ``scaled_noise_variance``, observed ``response`` (dims
        row). ``whitened``: free variables ``direction_coordinate`` (dims direction) and ``noise_coordinate``, which
        are close to independent standard normal a posteriori, and the data as sufficient statistics (normal errors) or
        as rotated rows.
    errors : {"normal", "student_t", "ar1"}, optional
        Student-t errors have the free variable ``degrees_of_freedom``, AR(1) errors ``autocorrelation``; see
        :mod:`pymc_ship.sampling.error_laws` for their priors.

    Returns
    -------
    pymc.Model
        With dims coefficient and row, and the deterministic variables ``coefficients`` (dims coefficient) and
        ``noise_variance`` on the original scale.

    Raises
    ------
    ValueError
        For another parametrisation or other errors.
    RegressionDataError
        For AR(1) errors on rows that are not uniformly spaced in time.
    PriorError
        For hyperparameter vectors of the wrong length.

    References
    ----------
    Xue et al. (2020), Eq. 12 and 18, doi:10.1016/j.oceaneng.2019.106612; Abril-Pla et al. (2023), PyMC,
    doi:10.7717/peerj-cs.1516; Papaspiliopoulos, Roberts & Skoeld (2007), A general framework for the parametrization
    of hierarchical models, doi:10.1214/088342307000000014.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(trial, vessel, "yaw", interval=2.0)
    >>> model = ps.pymc_model(data, ps.SemiConjugatePrior(), "direct")
    >>> sorted(variable.name for variable in model.free_RVs)
    ['scaled_coefficients', 'scaled_noise_variance']
    """
    if parametrisation not in ("whitened", "direct"):
        raise ValueError(f"A parametrisation is whitened or direct, found {parametrisation!r}; choose one of these.")
    error_law(errors, data)
    if parametrisation == "direct":
        return error_models.direct_model(data, prior, errors)
    return _whitened_model(data, prior) if errors == "normal" else error_models.whitened_rows_model(data, prior, errors)


def _whitened_model(data: RegressionData, prior: Prior) -> pm.Model:
    import pymc as pm
    import pytensor.tensor as pt

    n_terms = data.n_terms
    with pm.Model(coords=_coords(data) | {"direction": np.arange(n_terms), "quantity": list(Summary._fields)}) as model:
        statistics = _whitened_statistics(data, prior)
        summary = pm.Data("summary", statistics["summary"], dims="quantity")
        known = Summary._make(summary[k] for k in range(len(Summary._fields)))
        singular_values = pm.Data("singular_values", statistics["singular_values"], dims="direction")
        projection = pm.Data("projection", statistics["projection"], dims="direction")
        basis = pm.Data("basis", statistics["basis"], dims=("coefficient", "basis_column"))

        noise = (known.shape, known.scale, known.level, known.width)
        coordinate = pm.CustomDist("noise_coordinate", *noise, dist=error_models.noise_coordinate, initval=0.0)
        variance = pt.exp(known.level + known.width * coordinate)
        prior_variance = variance**known.power
        spread = 1.0 / pt.sqrt(1.0 / prior_variance + singular_values**2 / variance)
        center = spread**2 * singular_values * projection / variance
        direction_coordinate = pm.Normal(
            "direction_coordinate",
            mu=-center / spread,
            sigma=pt.sqrt(prior_variance) / spread,
            dims="direction",
            initval=np.zeros(n_terms),
        )
        rotated = center + spread * direction_coordinate
        # Directions that no row sees have singular value and projection 0; they are taken off again by the rest, whose
        # count of rows may be negative. So one model serves more rows than terms and fewer.
        pm.Normal("projection_density", mu=singular_values * rotated, sigma=pt.sqrt(variance), observed=projection)
        rest = (known.n_rows - n_terms) * pt.log(2.0 * math.pi * variance) + known.residual_square / variance
        pm.Potential("rest_density", -0.5 * rest - known.n_rows * pt.log(known.response_scale))
        # a product summed by row: the same as a matrix product here, and 2 s faster to compile
        pm.Deterministic("coefficients", basis[:, -1] + (basis[:, :-1] * rotated).sum(axis=1), dims="coefficient")
        pm.Deterministic("noise_variance", known.response_scale**2 * variance)
    return model


def _whitened_statistics(data: RegressionData, prior: Prior) -> dict[str, np.ndarray]:
    """All that the whitened model knows of data and prior, by the names of its pm.Data.

    ``basis`` ends with the prior mean of b.
    """
    rotation = rotate(data, prior)
    level, width = _noise_level(prior, rotation, data.n_rows)
    summary = Summary(
        shape=prior.shape,
        scale=prior.scale,
        power=prior.noise_power,
        level=level,
        width=width,
        n_rows=data.n_rows,
        residual_square=rotation.residual_square,
        response_scale=data.response_scale,
    )
    basis = np.column_stack([rotation.basis.T, rotation.center])
    return {
        "summary": np.array(summary, dtype=float),
        "singular_values": rotation.singular_values,
        "projection": rotation.projection,
        "basis": basis,
    }


def _noise_level(prior: Prior, rotation: Rotation, n_rows: int) -> tuple[float, float]:
    """Mode of the log noise variance, coefficients integrated out, and about its standard deviation."""
    from scipy.optimize import brentq

    s, z = rotation.singular_values, rotation.projection
    rate, excess = prior.scale + 0.5 * rotation.residual_square, 0.5 * (n_rows - len(s))
    power = prior.noise_power

    def slope(level: float) -> float:
        variance = math.exp(level)
        factor = prior.variance_factor(variance)
        ratio = variance / factor
        marginal = factor * (ratio + s**2)
        share = power + (1.0 - power) * ratio / (ratio + s**2)
        return prior.shape + excess - rate / variance + 0.5 * np.sum(share * (1.0 - z**2 / marginal))

    low = math.log(rate / (prior.shape + 0.5 * n_rows)) - 1.0
    high = math.log((rate + 0.5 * np.sum(z**2)) / (prior.shape + max(excess, 0.0))) + 1.0
    return brentq(slope, low, high), 1.0 / math.sqrt(prior.shape + 0.5 * n_rows)


def _coords(data: RegressionData) -> dict:
    return {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}


def nuts_posterior(
    data: RegressionData,
    prior: Prior,
    *,
    draws: int = 1000,
    chains: int = 4,
    tune: int = 1000,
    rng: np.random.Generator,
    parametrisation: str = "whitened",
    errors: str = "normal",
    nuts_sampler: str | None = None,
    progress: bool = False,
) -> xr.DataTree:
    """Draws of the No-U-Turn sampler from the posterior, laid out as a DataTree.

    Parameters
    ----------
    data : RegressionData
    prior : Prior
    draws : int, optional
        Draws of each chain that are kept.
    chains : int, optional
    tune : int, optional
        Draws of each chain that adapt step size and mass matrix and are dropped.
    rng : numpy.random.Generator
        Gives the integer seed of the sampler, from which the predictive draws are seeded too.
    parametrisation : {"whitened", "direct"}, optional
        See :func:`pymc_model`. The whitened model is compiled once for each number of terms, whatever data and prior.
    errors : {"normal", "student_t", "ar1"}, optional
        See :func:`pymc_model`.
    nuts_sampler : {"nutpie", "pymc"}, optional
        nutpie where it is installed, else the sampler of PyMC.
    progress : bool, optional
        Whether to show a progress bar; silent otherwise.

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.regression.tree.posterior_tree`, with the group sample_stats (dims chain, draw): ``lp``,
        ``energy``, ``energy_error``, ``tree_depth``, ``reached_max_treedepth``, ``n_steps``, ``step_size``,
        ``step_size_bar``, ``acceptance_rate``, ``diverging``; and prior, prior_predictive and posterior_predictive as
        :func:`~pymc_ship.sampling.predictive.with_predictive`. For errors that are not normal the posterior also holds
        ``degrees_of_freedom`` or ``autocorrelation``, and the log likelihood of AR(1) is that of a row given those
        before it.

    Raises
    ------
    ValueError
        For counts that are not positive, another parametrisation, other errors or another sampler.
    RegressionDataError
        For AR(1) errors on rows that are not uniformly spaced in time.
    PriorError
        For hyperparameter vectors of the wrong length.

    References
    ----------
    Hoffman & Gelman (2014), JMLR 15:1593; Abril-Pla et al. (2023), PyMC, doi:10.7717/peerj-cs.1516.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(trial, vessel, "yaw", interval=2.0)
    >>> tree = ps.nuts_posterior(data, ps.ConjugatePrior(), draws=200, chains=2, tune=200, rng=rng)
    >>> tree["sample_stats"]["diverging"].sum().item()
    0
    """
    sampler = nuts_sampler or ("nutpie" if find_spec("nutpie") else "pymc")
    if sampler not in ("nutpie", "pymc"):
        raise ValueError(f"The NUTS sampler is nutpie or pymc, found {nuts_sampler!r}; choose one of these.")
    if min(draws, chains, tune) < 1:
        raise ValueError(f"Counts of {draws=}, {chains=}, {tune=} must be positive; raise them to 1 or more.")
    law = error_law(errors, data)
    state, seed = rng_state(rng), int(rng.integers(2**31))
    sample = _sample_nutpie if sampler == "nutpie" else _sample_pymc
    settings = {"draws": draws, "chains": chains, "tune": tune}
    sampled = sample((data, prior, parametrisation, errors), settings, seed, progress)
    attrs = {"parametrisation": parametrisation, "tuning_steps": tune, "inference_library": sampler}
    attrs["inference_library_version"] = version(sampler)
    posterior = sampled["posterior"].dataset
    tree = posterior_tree(
        data,
        prior,
        posterior["coefficients"].transpose("chain", "draw", "coefficient").to_numpy(),
        posterior["noise_variance"].transpose("chain", "draw").to_numpy(),
        method="nuts",
        rng_state=state,
        groups={"sample_stats": nuts_sample_stats(sampled["sample_stats"].dataset, attrs)},
    )
    if law.parameter:
        tree = with_errors(tree, data, errors, posterior[law.parameter].transpose("chain", "draw").to_numpy())
    return with_predictive(tree, data, prior, rng=np.random.default_rng([seed, 1]))


def _sample_nutpie(stated: tuple, settings: dict, seed: int, progress: bool) -> xr.DataTree:
    import nutpie

    data, prior, parametrisation, errors = stated
    if parametrisation != "whitened":
        compiled = nutpie.compile_pymc_model(pymc_model(*stated))
    elif errors == "normal":
        compiled = _compiled_whitened(data.n_terms).with_data(**_whitened_statistics(data, prior))
    else:
        compiled = error_models.compiled_rows(data.n_terms, errors).with_data(
            **error_models.row_statistics(data, prior, errors)
        )
    return nutpie.sample(compiled, **settings, seed=seed, progress_bar=progress, save_warmup=False)


@lru_cache(maxsize=16)
def _compiled_whitened(n_terms: int):
    """Whitened model compiled by nutpie for placeholder data; family, prior and data enter by ``with_data``."""
    import nutpie

    placeholder = RegressionData.from_arrays(np.eye(n_terms), np.ones(n_terms))
    return nutpie.compile_pymc_model(_whitened_model(placeholder, ConjugatePrior()))


def _sample_pymc(stated: tuple, settings: dict, seed: int, progress: bool) -> xr.DataTree:
    import pymc as pm

    with pymc_model(*stated):
        return pm.sample(
            **settings,
            cores=1,
            random_seed=seed,
            nuts_sampler="pymc",
            progressbar=progress,
            quiet=not progress,
            compute_convergence_checks=False,
        )


def nuts_sample_stats(raw: xr.Dataset, attrs: dict) -> xr.Dataset:
    """Statistics of the sampler under their ArviZ names, as plain arrays of bool, int64 or float64."""
    named = raw.rename({given: name for given, name in _NUTPIE_NAMES.items() if given in raw})
    values = {name: (("chain", "draw"), named[name].to_numpy().astype(kind)) for name, kind in _SAMPLE_STATS.items()}
    coords = {dim: np.arange(raw.sizes[dim]) for dim in ("chain", "draw")}
    return xr.Dataset(values, coords, attrs)
