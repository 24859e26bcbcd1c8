"""PyMC model of a regression and its sampling by NUTS; pymc is imported when called.

With normal errors nutpie samples a density that equals the model's (:mod:`.whitened_model`), with others the model,
both in whitened coordinates, on which the posterior does not depend.
"""

from collections.abc import Callable
from importlib.metadata import version
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeIs

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior, check_data, check_prior, warn_of_rows
from pymc_ship.inference.regression.tree import SAMPLE, draws_tree, rng_state
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.sampling.error_laws import NU_RATE, NU_SHAPE, error_law, run_parts, with_errors
from pymc_ship.inference.sampling.from_pymc import posterior_tree
from pymc_ship.inference.sampling.predictive import with_predictive
from pymc_ship.inference.sampling.whitened_model import Density, whitened_density
from pymc_ship.machine.arguments import check_choice, check_counts, check_flags, check_probabilities
from pymc_ship.machine.errors import ShipError
from pymc_ship.machine.seeds import Seed, random_generator

if TYPE_CHECKING:
    import pymc as pm

NUTS_SAMPLERS = ("nutpie", "pymc", "numpyro", "blackjax")

# sample statistics by ArviZ name, with their types
_SAMPLE_STATS: dict[str, type] = dict.fromkeys(
    ("lp", "energy", "energy_error", "step_size", "step_size_bar", "acceptance_rate"), float
)
_SAMPLE_STATS |= {"tree_depth": np.int64, "n_steps": np.int64, "reached_max_treedepth": bool, "diverging": bool}
_NUTPIE_NAMES = {"logp": "lp", "depth": "tree_depth", "mean_tree_accept": "acceptance_rate"}
_NUTPIE_NAMES |= {"maxdepth_reached": "reached_max_treedepth"}


def pymc_model(data: RegressionData, prior: Prior | Callable, errors: str | Callable = "normal") -> "pm.Model":
    """PyMC model of the regression.

    Its log density is that of prior and original response.

    Parameters
    ----------
    data : RegressionData
    prior : Prior or callable
        On the scaled columns; mean and kappa may be vectors. A custom prior is a function ``prior(data, given)``,
        called inside the model, that makes and returns the scaled coefficients (with ``**given``: dims and
        transform) and the noise variance on the scaled response.
    errors : {"normal", "student_t", "ar1"} or callable, optional
        See :mod:`pymc_ship.inference.sampling.error_laws`. A custom likelihood is a function
        ``errors(name, mu, sigma, given)`` that makes the variable ``name`` with ``**given``: observed and dims.

    Returns
    -------
    pymc.Model
        Free variables ``scaled_coefficients``, ``scaled_noise_variance`` and, by the errors, ``degrees_of_freedom`` or
        ``autocorrelation``; data ``design_matrix`` and ``observed_response``; observed ``response`` (dims row);
        deterministic ``coefficients`` (dims coefficient) and ``noise_variance`` on the original scale, the squared
        scale for Student's t.

    Raises
    ------
    ValueError
        For other errors.
    InferenceError
        For AR(1) errors on rows not uniformly spaced in time, or hyperparameter vectors of the wrong length.

    References
    ----------
    Xue et al. (2020), Eq. 12 and 18, doi:10.1016/j.oceaneng.2019.106612; Abril-Pla et al. (2023), PyMC,
    doi:10.7717/peerj-cs.1516; Papaspiliopoulos, Roberts & Skoeld (2007), doi:10.1214/088342307000000014.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> trial = ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(trial, "kvlcc2", "yaw", interval=2.0)
    >>> model = ps.pymc_model(data, ps.SemiConjugatePrior())
    >>> sorted(variable.name for variable in model.free_RVs)
    ['scaled_coefficients', 'scaled_noise_variance']
    """
    import pymc as pm
    import pytensor.tensor as pt

    from pymc_ship.inference.sampling.linear_coordinates import coefficients_from_fit, linear_coordinates

    if not _is_custom(prior, data):
        warn_of_rows(data, prior)
    if not callable(errors):
        error_law(errors, data)
    offset, transformation = data.transformation
    coords = {"coefficient": list(data.coefficients), "row": np.arange(data.n_rows)}
    with pm.Model(coords=coords) as model:
        design = pm.Data("design_matrix", data.design_matrix, dims=("row", "coefficient"))
        response = pm.Data("observed_response", data.response, dims="row")
        given = {"dims": "coefficient", "transform": linear_coordinates(data, prior, errors)}
        if callable(prior):
            scaled, variance = prior(data, given)
        else:
            variance = pm.InverseGamma("scaled_noise_variance", alpha=prior.shape, beta=prior.scale)
            spread = pt.sqrt(prior.coefficient_variance(variance, data.n_terms))
            scaled = coefficients_from_fit(prior.means(data.n_terms), spread, given)
        coefficients = pm.Deterministic("coefficients", offset + pt.dot(transformation, scaled), dims="coefficient")
        noise_variance = pm.Deterministic("noise_variance", data.response_scale**2 * variance)
        mu, sigma = pt.dot(design, coefficients), pt.sqrt(noise_variance)
        observed = {"observed": response, "dims": "row"}
        if callable(errors):
            errors("response", mu, sigma, observed)
        else:
            _row_density(errors, mu, sigma, observed, data)
    return model


def _row_density(errors: str, mu: Any, sigma: Any, observed: dict, data: RegressionData) -> None:
    """Likelihood of the rows under an error law, with its parameter; for AR(1) each row given that before, by run."""
    import pymc as pm
    import pytensor.tensor as pt

    if errors == "student_t":
        nu = pm.Gamma("degrees_of_freedom", alpha=NU_SHAPE, beta=NU_RATE)
        pm.StudentT("response", nu=nu, mu=mu, sigma=sigma, **observed)
        return
    if errors == "ar1":
        rho = pm.Uniform("autocorrelation", -1.0, 1.0)
        before = pt.as_tensor(observed["observed"])[:-1] - mu[:-1]
        first, starts = pt.arange(mu.shape[0]) < 1, [part.start for part in run_parts(data)]
        if len(starts) > 1:  # else new rows may be set, of any number
            first = pt.as_tensor(np.isin(np.arange(data.n_rows), starts))
        mu = pt.inc_subtensor(mu[1:], rho * pt.switch(first[1:], 0.0, before))
        sigma = sigma * pt.switch(first, 1.0, pt.sqrt(1.0 - rho**2))
    pm.Normal("response", mu=mu, sigma=sigma, **observed)


def nuts_posterior(
    data: RegressionData,
    prior: Prior | Callable,
    *,
    draws: int = 1000,
    chains: int = 4,
    tune: int = 1000,
    rng: Seed,
    errors: str | Callable = "normal",
    sampler: str | None = None,
    target_accept: float = 0.8,
    cores: int | None = None,
    progress: bool = False,
) -> xr.DataTree:
    """Posterior by the No-U-Turn sampler, as a DataTree.

    Parameters
    ----------
    data : RegressionData
    prior : Prior or callable
        As :func:`pymc_model`.
    draws : int, optional
        Draws of each chain after the warm-up.
    chains, tune : int, optional
        Chains, and warm-up draws of each, which adapt step size and mass matrix.
    rng : int, SeedSequence or Generator
        Seed of the sampler and of predictive draws.
    errors : {"normal", "student_t", "ar1"} or callable, optional
        See :func:`pymc_model`.
    sampler : {"nutpie", "pymc", "numpyro", "blackjax"}, optional
        Installed sampler; default nutpie if installed, else pymc.
    target_accept : float, optional
        Target acceptance rate in (0, 1); closer to 1 against divergences.
    cores : int, optional
        Parallel chains; default all cores for a model that nutpie compiled, else 1.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    DataTree
        As :func:`~pymc_ship.inference.regression.tree.draws_tree`, with the group sample_stats (dims chain, draw):
        ``lp``, ``energy``, ``energy_error``, ``tree_depth``, ``reached_max_treedepth``, ``n_steps``, ``step_size``,
        ``step_size_bar``, ``acceptance_rate``, ``diverging``, as far as the sampler has them; the groups of
        :func:`~pymc_ship.inference.sampling.predictive.with_predictive`; and the parameter of the errors. The log
        likelihood of AR(1) errors is that of a row given those before it. Under a custom prior or likelihood as
        :func:`~pymc_ship.inference.sampling.from_pymc.posterior_tree`.

    Raises
    ------
    ValueError, InferenceError
        As :func:`pymc_model`; for counts that are not positive, an acceptance rate outside 0 to 1, or a sampler that is
        unknown or not installed.

    References
    ----------
    Hoffman & Gelman (2014), JMLR 15:1593; those of :func:`pymc_model`.
    """
    rng, sampler = random_generator(rng), _installed_sampler(sampler)
    state, seed = rng_state(rng), int(rng.integers(2**31))
    settings = {"draws": draws, "chains": chains, "tune": tune, "target_accept": target_accept, "cores": cores}
    check_settings(settings)
    if _is_custom(prior, data) or callable(errors):
        model = pymc_model(data, prior, errors)
        sampled = sample_model(model, settings, seed, progress, sampler)
        return posterior_tree(sampled, data, model, rng=np.random.default_rng([seed, 1]))
    if sampler == "nutpie" and errors == "normal":
        warn_of_rows(data, prior)
        sampled = sample_density(whitened_density(data, prior), settings, seed, progress)
    else:
        sampled = sample_model(pymc_model(data, prior, errors), settings, seed, progress, sampler)
    posterior, law = sampled["posterior"].dataset.transpose("chain", "draw", ...), error_law(errors, data)
    values = (posterior[name].to_numpy() for name in ("coefficients", "noise_variance"))
    groups = {"sample_stats": sampled["sample_stats"].to_dataset()}
    tree = draws_tree(data, prior, *values, method="nuts", rng_state=state, groups=groups)
    if law.parameter:
        tree = with_errors(tree, data, errors, posterior[law.parameter].to_numpy())
    return with_predictive(tree, data, prior, rng=np.random.default_rng([seed, 1]))


def sample_density(density: Density, settings: dict, seed: int, progress: bool) -> xr.DataTree:
    """Groups posterior and sample_stats by nutpie; settings as :func:`sample_model`."""
    from nutpie.compiled_pyfunc import from_pyfunc

    def start(seed: int) -> np.ndarray:
        return density.start + np.random.default_rng(seed).uniform(-1.0, 1.0, density.start.size)

    kept = density.parameters(density.start)
    kinds, shapes = [np.dtype(float)] * len(kept), [np.shape(value) for value in kept.values()]
    functions = (lambda: density.log_density), (lambda *_: density.parameters)
    model = from_pyfunc(density.start.size, *functions, kinds, shapes, list(kept), make_initial_point_fn=start)
    # a density in Python is evaluated by one thread at a time: several chains would only wait for each other
    return sample_with_nutpie(model, settings | {"cores": settings.get("cores") or 1}, seed, progress)


def sample_with_nutpie(model: Any, settings: dict, seed: int, progress: bool) -> xr.DataTree:
    """Groups posterior and sample_stats of a model that nutpie compiled; settings as :func:`sample_model`."""
    import nutpie

    check_flags(progress=progress)
    sampled = nutpie.sample(model, **settings, seed=seed, progress_bar=progress, save_warmup=False)
    return _groups(sampled, settings, "nutpie")


def _groups(sampled: xr.DataTree, settings: dict, sampler: str) -> xr.DataTree:
    statistics = nuts_sample_stats(sampled["sample_stats"].dataset, settings["tune"], sampler)
    return xr.DataTree.from_dict({"posterior": sampled["posterior"].to_dataset(), "sample_stats": statistics})


def sample_model(
    model: "pm.Model", settings: dict, seed: int, progress: bool, sampler: str | None = None
) -> xr.DataTree:
    """Posterior and sample_stats of a PyMC model by NUTS; ``settings``: draws, chains, tune, target_accept, cores."""
    import pymc as pm

    sampler = _installed_sampler(sampler)
    if sampler == "nutpie":
        import nutpie
        from pymc.model.transform.optimization import freeze_dims_and_data

        # data as constants compile in two thirds of the time
        compiled = nutpie.compile_pymc_model(freeze_dims_and_data(model))
        return sample_with_nutpie(compiled, settings, seed, progress)
    check_flags(progress=progress)
    settings = settings | {"cores": settings.get("cores") or 1}
    shown = {"progressbar": progress, "quiet": not progress, "compute_convergence_checks": False}
    with model:
        sampled = pm.sample(**settings, random_seed=seed, nuts_sampler=sampler, **shown)
    return _groups(sampled, settings, sampler)


def check_settings(settings: dict) -> None:
    """Check counts and acceptance rate; ValueError."""
    names = ["draws", "chains", "tune", *(["cores"] if settings.get("cores") is not None else [])]
    check_counts(**{name: settings[name] for name in names})
    check_probabilities(target_accept=settings.get("target_accept", 0.8))


def _is_custom(prior: Prior | Callable, data: RegressionData) -> TypeIs[Callable]:
    """Whether a prior is a function; InferenceError if neither prior nor function, and for other data."""
    check_data(data)
    own = callable(prior) and not isinstance(prior, type)
    if not own:
        check_prior(prior, data, own=" or a function prior(data, given)")
    return own


def _installed_sampler(sampler: str | None) -> str:
    if sampler is None:
        return "nutpie" if find_spec("nutpie") else "pymc"
    check_choice("The NUTS sampler", sampler, NUTS_SAMPLERS)
    if not find_spec(sampler):
        here = ", ".join(name for name in NUTS_SAMPLERS if find_spec(name))
        raise ShipError(f"The NUTS sampler {sampler} is not installed; install it, or use one of {here}.")
    return sampler


def nuts_sample_stats(raw: xr.Dataset, tune: int, sampler: str) -> xr.Dataset:
    """Sample statistics by ArviZ name, as arrays of bool, int64 or float64."""
    named = raw.rename({given: name for given, name in _NUTPIE_NAMES.items() if given in raw})
    types = {name: kind for name, kind in _SAMPLE_STATS.items() if name in named}
    values: dict[str, tuple] = {name: (SAMPLE, named[name].to_numpy().astype(kind)) for name, kind in types.items()}
    attrs = {"tuning_steps": tune, "inference_library": sampler, "inference_library_version": version(sampler)}
    return xr.Dataset(values, {dim: np.arange(raw.sizes[dim]) for dim in SAMPLE}, attrs)
