"""What a saved posterior says about itself: convergence, what the data determine, residuals, cross-validation.

Every function takes a posterior laid out by :func:`~pymc_ship.regression.tree.posterior_tree` and returns numbers.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from pymc_ship.diagnostics.tables import CI_PROB
from pymc_ship.regression.data import RegressionData
from pymc_ship.regression.priors import ConjugatePrior, SemiConjugatePrior, prior_family

R_HAT_LIMIT = 1.01
"""R-hat of chains that have mixed lies below (Vehtari et al. 2021)."""

ESS_LIMIT = 400.0
"""Bulk and tail effective sample size of a posterior to be reported lie above (Vehtari et al. 2021)."""

E_BFMI_LIMIT = 0.3
"""E-BFMI of every chain of a Hamiltonian sampler lies above (Betancourt 2018)."""

CONTRACTION_LIMIT = 0.9
"""Share of the prior variance that the data of a determined coefficient have taken away."""

SD_LIMIT = 1.96
"""Standard deviations between zero and the mean of a determined coefficient."""

WHITENESS_LEVEL = 0.01
"""The residuals are taken for autocorrelated where the p-value of the Ljung-Box test lies below."""

ENVELOPE = 0.99
"""Probability of the simultaneous envelopes of ranks and LOO-PIT."""


PSENSE_LIMIT = 0.05
"""Sensitivity above which a quantity depends on power-scaling of prior or likelihood (Kallioinen et al. 2024)."""

REQUIRED = {"coefficients": ("chain", "draw", "coefficient"), "noise_variance": ("chain", "draw")}
_ATTRS = ("method", "dof", "vessel", "prior", "scaling")


def check_posterior(tree: xr.DataTree, name: str = "The tree") -> None:
    """Raise a ValueError that says what a tree lacks to be a posterior of this package."""
    check_draws(tree, name, REQUIRED, _ATTRS)
    try:
        prior_of(tree)
        json.loads(tree.attrs["scaling"])["response_scale"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{name} is no posterior of this package, its prior or scaling is broken: {error}.") from None


def check_draws(tree: xr.DataTree, name: str, required: Mapping[str, tuple], attrs: Sequence[str]) -> None:
    """Raise a ValueError when a tree lacks draws of some dims, or attrs, or its draws are few or not finite."""
    draws = tree["posterior"].dataset if "posterior" in tree.children else xr.Dataset()
    lacking = [key for key, dims in required.items() if key not in draws or draws[key].dims != dims]
    lacking += [f"attrs[{key!r}]" for key in attrs if key not in tree.attrs]
    if lacking:
        raise ValueError(
            f"{name} is no posterior of this package, it lacks {', '.join(lacking)}; give one that a posterior "
            "function or `pymc-ship identify` made."
        )
    broken = [key for key in required if draws[key].size == 0 or not np.isfinite(draws[key].values).all()]
    if broken or draws.sizes["draw"] < 4:
        what = f"infinity, NaN or nothing in {broken[0]}" if broken else f"{draws.sizes['draw']} draws a chain"
        raise ValueError(f"A posterior to diagnose holds four finite draws a chain or more, found {what} in {name}.")


def has(tree: xr.DataTree, path: str) -> bool:
    """Whether a tree has a variable, given as ``"group/variable"``."""
    group, variable = path.split("/")
    return group in tree.children and variable in tree[group].dataset


def missing(tree: xr.DataTree, *wanted: str) -> list[str]:
    """Those of the wanted variables (``"log_likelihood/response"``) that a tree does not have."""
    return [path for path in wanted if not has(tree, path)]


DESIGN = ("constant_data/design_matrix", "observed_data/response")
"""Variables of a tree that its regression data are made from."""


def prior_of(tree: xr.DataTree) -> ConjugatePrior | SemiConjugatePrior:
    """Prior that a posterior records."""
    hyperparameters = json.loads(tree.attrs["prior"])
    return prior_family(hyperparameters.pop("family"))(**hyperparameters)


def data_of(tree: xr.DataTree) -> RegressionData:
    """Regression data of a posterior, from its constant_data, observed_data and scaling."""
    constant, scaling = tree["constant_data"].dataset, json.loads(tree.attrs["scaling"])
    names = [str(name) for name in tree["posterior"]["coefficient"].values]
    data = RegressionData.from_arrays(
        constant["design_matrix"].transpose("row", "coefficient").values,
        tree["observed_data"]["response"].values,
        names,
        time=constant["time"].values if "time" in constant else None,
        dof=tree.attrs["dof"],
        vessel=tree.attrs["vessel"],
    )
    centers = {name: np.array(scaling[name], dtype=float) for name in ("column_center", "column_scale")}
    return replace(data, **centers, **{name: float(scaling[name]) for name in ("response_center", "response_scale")})


def quantities(tree: xr.DataTree) -> xr.DataArray:
    """Draws of every coefficient and of the noise variance, dims (chain, draw, quantity)."""
    posterior = tree["posterior"].dataset
    noise_variance = posterior["noise_variance"].expand_dims(coefficient=["noise_variance"])
    draws = xr.concat([posterior["coefficients"], noise_variance], "coefficient")
    return draws.rename(coefficient="quantity").transpose("chain", "draw", "quantity")


@np.errstate(divide="ignore", invalid="ignore")
def summary(tree: xr.DataTree, draws: xr.DataArray | None = None) -> xr.Dataset:
    """Mean, sd, equal-tailed interval, MCSE, R-hat and effective sample sizes of :func:`quantities` or other draws.

    Returns
    -------
    Dataset, dims (quantity,)
        ``mean``, ``sd``, ``lower``, ``upper``, ``mcse_mean``, ``mcse_sd``, ``r_hat``, ``ess_bulk``, ``ess_tail``;
        ``attrs["ci_prob"]``. R-hat is NaN for a single chain.
    """
    import arviz as az

    draws = quantities(tree) if draws is None else draws
    tails = draws.quantile([0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB], ("chain", "draw")).values
    values = {
        "mean": draws.mean(("chain", "draw")),
        "sd": draws.std(("chain", "draw"), ddof=1),
        "lower": ("quantity", tails[0]),
        "upper": ("quantity", tails[1]),
        "mcse_mean": az.mcse(draws, method="mean"),
        "mcse_sd": az.mcse(draws, method="sd"),
        "ess_bulk": az.ess(draws, method="bulk"),
        "ess_tail": az.ess(draws, method="tail"),
    }
    values["r_hat"] = az.rhat(draws) if draws.sizes["chain"] > 1 else xr.full_like(values["ess_bulk"], np.nan)
    return xr.Dataset(values, attrs={"ci_prob": CI_PROB, "ci_kind": "eti"})


def gates(tree: xr.DataTree, draws: xr.DataArray | None = None) -> list[dict]:
    """Convergence gates: what is measured, its worst value, where, the limit, and whether the gate holds.

    R-hat below 1.01, bulk and tail ESS above 400 (of :func:`quantities` or other draws); no divergence and E-BFMI above
    0.3 where ``sample_stats`` has ``diverging`` and ``energy``. NaN (a single chain, one that stands still) fails.
    """
    import arviz as az

    table = summary(tree, draws)
    names = table["quantity"].values

    def worst(name: str, sign: float) -> tuple[float, str]:
        values = table[name].values
        k = int(np.argmax(np.where(np.isnan(values), np.inf, sign * values)))
        return float(values[k]), str(names[k])

    value, where = worst("r_hat", 1.0)
    found = [_gate("largest R-hat", value, where, f"< {R_HAT_LIMIT:g}", value < R_HAT_LIMIT)]
    for name, label in (("ess_bulk", "least bulk ESS"), ("ess_tail", "least tail ESS")):
        value, where = worst(name, -1.0)
        found.append(_gate(label, value, where, f"> {ESS_LIMIT:g}", value > ESS_LIMIT))
    stats = tree["sample_stats"].dataset if "sample_stats" in tree.children else xr.Dataset()
    if "diverging" in stats:
        count = int(stats["diverging"].sum())
        found.append(_gate("divergences", float(count), "all chains", "= 0", count == 0))
    if "energy" in stats:
        bfmi = np.atleast_1d(az.bfmi(tree)["energy"].values)
        k = int(np.argmin(np.where(np.isnan(bfmi), -np.inf, bfmi)))
        value = float(bfmi[k])
        found.append(_gate("least E-BFMI", value, f"chain {k}", f"> {E_BFMI_LIMIT:g}", value > E_BFMI_LIMIT))
    return found


def _gate(label: str, value: float, where: str, limit: str, holds: bool) -> dict:
    return {"gate": label, "value": value, "where": where, "limit": limit, "holds": bool(holds)}


def contraction(tree: xr.DataTree) -> xr.Dataset:
    """How far the data have narrowed each coefficient, and which coefficients they determine.

    The contraction is 1 - (posterior variance)/(prior variance), both on the original scale; the conjugate family,
    whose prior variance is sigma2 kappa, takes it at the posterior mean of sigma2, since the marginal one may be
    infinite. A coefficient is determined when its contraction exceeds 0.9 and its mean lies more than 1.96 posterior
    standard deviations from zero.

    Returns
    -------
    Dataset, dims (coefficient,)
        ``mean``, ``sd``, ``prior_sd``, ``contraction`` and the flags ``narrowed``, ``determined``.
    """
    data, posterior = data_of(tree), tree["posterior"].dataset
    mean = posterior["coefficients"].mean(("chain", "draw"))
    sd = posterior["coefficients"].std(("chain", "draw"), ddof=1)
    _, T = data.transformation
    prior_sd = xr.zeros_like(sd) + np.sqrt(np.sum(T**2 * _prior_variance(tree, data), axis=1))
    shrunk = 1.0 - (sd / prior_sd) ** 2
    narrowed = shrunk > CONTRACTION_LIMIT
    determined = narrowed & (np.abs(mean) > SD_LIMIT * sd)
    values = {"mean": mean, "sd": sd, "prior_sd": prior_sd, "contraction": shrunk}
    return xr.Dataset({**values, "narrowed": narrowed, "determined": determined})


def _scaled_noise_variance(tree: xr.DataTree, data: RegressionData) -> float:
    return float(tree["posterior"]["noise_variance"].mean()) / data.response_scale**2


def _prior_variance(tree: xr.DataTree, data: RegressionData) -> np.ndarray:
    """Prior variance of the scaled coefficients at the posterior mean of sigma2, shape (n_terms,)."""
    prior = prior_of(tree)
    factor = _scaled_noise_variance(tree, data) if isinstance(prior, ConjugatePrior) else 1.0
    return factor * prior.kappas(data.n_terms)


def singular_directions(tree: xr.DataTree, loadings: int = 4) -> list[dict]:
    """Directions of the scaled design from the weakest to the strongest.

    The columns are weighted with the prior standard deviations, so that the prior is round; the data's share of the
    posterior precision along a direction of singular value s is s^2/(s^2 + sigma2), at the posterior mean of sigma2.
    A direction whose share does not exceed 0.9 follows the prior.

    Returns
    -------
    list of dict
        ``singular_value`` (of the weighted design over sigma), ``share`` and ``direction``, the largest loadings.
    """
    data = data_of(tree)
    sigma2 = _scaled_noise_variance(tree, data)
    weighted = data.scaled_design_matrix * np.sqrt(_prior_variance(tree, data) / sigma2)
    _, s, right = np.linalg.svd(weighted, full_matrices=True)
    s = np.append(s, np.zeros(data.n_terms - s.size))
    rows = []
    for value, vector in zip(s[::-1], right[::-1], strict=True):
        order = np.argsort(-np.abs(vector))[:loadings]
        turned = vector * np.sign(vector[order[0]])
        text = " ".join(f"{turned[j]:+.2f} {data.coefficients[j]}" for j in order)
        rows.append({"singular_value": float(value), "share": float(value**2 / (value**2 + 1.0)), "direction": text})
    return rows


def correlation(tree: xr.DataTree) -> xr.DataArray:
    """Posterior correlation of the coefficients, dims (coefficient, other)."""
    draws = tree["posterior"]["coefficients"].stack(sample=("chain", "draw")).transpose("coefficient", "sample")
    names = draws["coefficient"].values
    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = np.atleast_2d(np.corrcoef(draws.values))
    return xr.DataArray(matrix, {"coefficient": names, "other": names}, ("coefficient", "other"))


def correlated_pairs(tree: xr.DataTree, count: int = 8) -> list[dict]:
    """The pairs of coefficients of largest absolute correlation: ``first``, ``second``, ``correlation``."""
    matrix = correlation(tree)
    names = [str(name) for name in matrix["coefficient"].values]
    first, second = np.triu_indices(len(names), 1)
    values = np.nan_to_num(matrix.values[first, second])
    order = np.argsort(-np.abs(values), kind="stable")[:count]
    return [{"first": names[first[k]], "second": names[second[k]], "correlation": float(values[k])} for k in order]


def residuals(tree: xr.DataTree) -> xr.DataArray:
    """Response minus design times posterior mean, dims (row,) with time [s] where the tree has it."""
    data = data_of(tree)
    fitted = data.design_matrix @ tree["posterior"]["coefficients"].mean(("chain", "draw")).values
    return xr.DataArray(data.response - fitted, {"time": ("row", data.time)}, ("row",))


def autocorrelation(values: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation of a series about its mean at lags 1, 2, ..., shape (lags,)."""
    centred = np.asarray(values, dtype=float) - np.mean(values)
    products = np.array([centred[lag:] @ centred[:-lag] for lag in range(1, lags + 1)])
    return products / (centred @ centred)


def whiteness(values: np.ndarray) -> dict[str, float]:
    """Ljung-Box test that a series is white noise.

    Q = n (n + 2) sum r_k^2/(n - k) over h = min(10, n/5) lags, held against chi-square of h degrees of freedom; for
    residuals of a regression that is the usual approximation.

    Returns
    -------
    dict
        ``r1``, ``lags``, ``statistic``, ``p_value`` and ``band``, the half width 1.96/sqrt(n) of the white-noise band.

    Raises
    ------
    ValueError
        For fewer than ten values.

    References
    ----------
    Ljung & Box (1978), Biometrika 65(2):297, doi:10.1093/biomet/65.2.297.
    """
    from scipy.stats import chi2

    n = len(values)
    if n < 10:
        raise ValueError(f"A test of whiteness needs ten values or more, found {n}; use a longer trial.")
    lags = min(10, n // 5)
    r = autocorrelation(values, lags)
    statistic = n * (n + 2.0) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    p_value = float(chi2.sf(statistic, lags))
    return {"r1": float(r[0]), "lags": lags, "statistic": statistic, "p_value": p_value, "band": 1.96 / np.sqrt(n)}


def cross_validation(tree: xr.DataTree):
    """PSIS leave-one-out cross-validation of ArviZ, pointwise; needs the group log_likelihood."""
    import arviz as az

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Estimated shape parameter of Pareto", category=UserWarning)
        return az.loo(tree, pointwise=True, var_name="response")


def loo_pit_coverage(tree: xr.DataTree, probabilities: tuple[float, ...] = (0.5, CI_PROB)) -> list[float]:
    """Share of the rows inside central leave-one-out intervals; needs log_likelihood and posterior_predictive."""
    import arviz as az

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Estimated shape parameter of Pareto", category=UserWarning)
        pit = az.loo_pit(tree, var_names="response")
    distance = np.abs(pit["response"].values - 0.5)
    return [float(np.mean(distance <= 0.5 * probability)) for probability in probabilities]


@np.errstate(divide="ignore", invalid="ignore")
def prior_sensitivity(tree: xr.DataTree) -> list[dict]:
    """Power-scaling sensitivity of every quantity to prior and likelihood; needs log_prior and log_likelihood."""
    import arviz as az

    scalars, found = [name for name in ("noise_variance",) if has(tree, f"posterior/{name}")], {}
    for group in ("prior", "likelihood"):
        moved = az.psense(tree, group=group, var_names=["coefficients", *scalars])
        found[group] = [*map(float, moved["coefficients"].values), *(float(moved[name]) for name in scalars)]
    names = [*map(str, tree["posterior"]["coefficient"].values), *scalars]
    return [
        {"quantity": name, "prior": prior, "likelihood": likelihood, "diagnosis": _sensed(prior, likelihood)}
        for name, prior, likelihood in zip(names, found["prior"], found["likelihood"], strict=True)
    ]


def _sensed(prior: float, likelihood: float) -> str:
    if np.isnan(prior):
        return "does not vary"
    if prior <= PSENSE_LIMIT:
        return "not moved by the prior"
    if likelihood > PSENSE_LIMIT:
        return "possible prior-data conflict"
    return "strong prior or weak likelihood"


def predictive(tree: xr.DataTree, rng: np.random.Generator) -> xr.DataTree:
    """Copy of a posterior that has posterior_predictive, drawn from its own draws and design where it had none."""
    if has(tree, "posterior_predictive/response"):
        return tree
    data, posterior = data_of(tree), tree["posterior"].dataset
    sample = {name: posterior[name].values for name in ("chain", "draw")}
    sd = np.sqrt(posterior["noise_variance"].values)[..., None]
    response = posterior["coefficients"].values @ data.design_matrix.T
    response += sd * rng.standard_normal(response.shape)
    drawn = xr.Dataset(
        {"response": (("chain", "draw", "row"), response)}, sample | {"row": tree["observed_data"]["row"]}
    )
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    return xr.DataTree.from_dict({"/": tree.to_dataset(), **groups, "posterior_predictive": drawn})


def prior_noise_variance(tree: xr.DataTree, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Draws of sigma2 from the prior, on the scale of the original response, shape (draws,)."""
    prior, scale = prior_of(tree), json.loads(tree.attrs["scaling"])["response_scale"]
    with np.errstate(divide="ignore"):
        return prior.scale * scale**2 / rng.gamma(prior.shape, size=draws)


def noise_variance_widths(tree: xr.DataTree, rng: np.random.Generator, draws: int = 20000) -> tuple[float, float]:
    """Widths of the central 95 % of log10 sigma2 under the prior and under the posterior."""
    tails = [0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB]
    both = prior_noise_variance(tree, draws, rng), tree["posterior"]["noise_variance"].values
    return tuple(float(np.diff(np.log10(np.quantile(values, tails)))[0]) for values in both)


def prior_predictive_ratio(tree: xr.DataTree, rng: np.random.Generator, draws: int = 400) -> np.ndarray:
    """Root mean square of the response under prior draws over that of the record, 5, 50 and 95 %, shape (3,)."""
    data, prior = data_of(tree), prior_of(tree)
    sigma2 = prior_noise_variance(tree, draws, rng) / data.response_scale**2
    factor = sigma2 if isinstance(prior, ConjugatePrior) else np.ones(draws)
    spread = np.sqrt(factor[:, None] * prior.kappas(data.n_terms))
    scaled = prior.means(data.n_terms) + spread * rng.standard_normal((draws, data.n_terms))
    response = scaled @ data.scaled_design_matrix.T + np.sqrt(sigma2)[:, None] * rng.standard_normal(
        (draws, data.n_rows)
    )
    observed = np.sqrt(np.mean(data.scaled_response**2))
    return np.quantile(np.sqrt(np.mean(response**2, axis=1)) / observed, [0.05, 0.5, 0.95])
