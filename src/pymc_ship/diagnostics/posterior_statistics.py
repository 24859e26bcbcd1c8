"""Statistics of any posterior: convergence, correlation, whiteness, cross-validation, sensitivity to the prior."""

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy
import xarray as xr

from pymc_ship.inference.regression.tree import SAMPLE
from pymc_ship.inference.trajectory.posterior import KHAT_LIMIT
from pymc_ship.machine.errors import ShipError

if TYPE_CHECKING:
    from arviz_stats.utils import ELPDData

CI_PROB = 0.95  # probability of the equal-tailed intervals
TAILS = (0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB)  # probabilities of the ends of these intervals
R_HAT_LIMIT = 1.01  # R-hat of chains that have mixed lies below (Vehtari et al. 2021)
ESS_LIMIT = 400.0  # bulk and tail effective sample size of a posterior to be reported lie above (Vehtari et al. 2021)
E_BFMI_LIMIT = 0.3  # E-BFMI of every chain of a Hamiltonian sampler lies above (Betancourt 2018)
CONTRACTION_LIMIT = 0.9  # contraction of a determined coefficient is larger
SD_LIMIT = 1.96  # standard deviations between zero and the mean of a determined coefficient
WHITENESS_LEVEL = 0.01  # the residuals are taken for autocorrelated where the p-value of the Ljung-Box test lies below
ENVELOPE = 0.99  # probability of the simultaneous envelopes of ranks and LOO-PIT

PSENSE_LIMIT = 0.05
"""Sensitivity above which a quantity depends on power-scaling of prior or likelihood (Kallioinen et al. 2024)."""

DETERMINATIONS = ("determined", "prior", "includes zero")  # by the data, by the prior, or zero within 1.96 sd


def check_draws(tree: xr.DataTree, name: str, required: Mapping[str, tuple], attrs: Sequence[str]) -> None:
    """Raise a ValueError when draws or attrs are missing, or the draws are fewer than four a chain or not finite."""
    draws = tree["posterior"].dataset if "posterior" in tree.children else xr.Dataset()
    lacking = [key for key, dims in required.items() if key not in draws or draws[key].dims != dims]
    lacking += [f"attrs[{key!r}]" for key in attrs if key not in tree.attrs]
    if lacking:
        raise ShipError(
            f"{name} is no posterior of this package, it lacks {', '.join(lacking)}; give one that a posterior "
            "function or `pymc-ship identify` made."
        )
    broken = [key for key in required if draws[key].size == 0 or not np.isfinite(draws[key].values).all()]
    if broken or draws.sizes["draw"] < 4:
        what = f"infinity, NaN or nothing in {broken[0]}" if broken else f"{draws.sizes['draw']} draws a chain"
        raise ShipError(f"A posterior to diagnose holds four finite draws a chain or more, found {what} in {name}.")


def has(tree: xr.DataTree, path: str) -> bool:
    """Whether a tree has a variable ``"group/variable"``."""
    group, variable = path.split("/")
    return group in tree.children and variable in tree[group].dataset


def missing(tree: xr.DataTree, *wanted: str) -> list[str]:
    """Those variables ``"group/variable"`` that a tree does not have."""
    return [path for path in wanted if not has(tree, path)]


def quantities(tree: xr.DataTree) -> xr.DataArray:
    """Draws of coefficients, noise variance, initial states and sensor offsets, dims (chain, draw, quantity)."""
    posterior = tree["posterior"].dataset
    values = [posterior["coefficients"].transpose(*SAMPLE, "coefficient").values]
    names = [str(name) for name in posterior["coefficient"].values]
    if "noise_variance" in posterior:
        values.append(posterior["noise_variance"].transpose(*SAMPLE).values[:, :, None])
        names.append("noise_variance")
    for name, of, template in (("initial_state", "state", "initial {}"), ("sensor_offset", "channel", "offset of {}")):
        if name not in posterior:
            continue
        draws = posterior[name].transpose(*SAMPLE, "run", of)
        for run, label in np.argwhere(np.isfinite(draws.values).all((0, 1))):
            values.append(draws.values[:, :, run, label, None])
            names.append(f"{template.format(draws[of].values[label])}, run {run + 1}")
    coords = {name: posterior[name].values for name in SAMPLE} | {"quantity": names}
    return xr.DataArray(np.concatenate(values, axis=2), coords, (*SAMPLE, "quantity"))


@np.errstate(divide="ignore", invalid="ignore")
def summary(tree: xr.DataTree) -> xr.Dataset:
    """Dataset of :func:`quantities`, dims (quantity,): mean, sd, interval, MCSE, R-hat (NaN for one chain) and ESS.

    ``mean``, ``sd``, ``lower``, ``upper``, ``mcse_mean``, ``mcse_sd``, ``r_hat``, ``ess_bulk``, ``ess_tail``.
    """
    import arviz as az

    draws = quantities(tree)
    tails = draws.quantile(TAILS, SAMPLE).values
    mean, sd = draws.mean(SAMPLE), draws.std(SAMPLE, ddof=1)
    unit = (draws - mean) / sd.where(sd > 0.0, 1.0)  # ArviZ takes what varies by less than 1e-15 for constant
    values = {
        "mean": mean,
        "sd": sd,
        "lower": ("quantity", tails[0]),
        "upper": ("quantity", tails[1]),
        "mcse_mean": sd * az.mcse(unit, method="mean"),
        "mcse_sd": sd * az.mcse(unit, method="sd"),
        "ess_bulk": az.ess(unit, method="bulk"),
        "ess_tail": az.ess(unit, method="tail"),
    }
    values["r_hat"] = az.rhat(unit) if draws.sizes["chain"] > 1 else xr.full_like(values["ess_bulk"], np.nan)
    return xr.Dataset(values, attrs={"ci_prob": CI_PROB, "ci_kind": "eti"})


def convergence_diagnostics(tree: xr.DataTree) -> list[dict]:
    """Convergence diagnostics: name, worst value, where, limit, and whether it passes.

    Pareto k-hat for independent draws of a normal approximation. R-hat, bulk and tail ESS of every one of
    :func:`quantities` for chains, and from ``sample_stats`` divergences and E-BFMI. NaN fails.
    """
    if "pareto_khat" in tree.attrs:
        khat = float(tree.attrs["pareto_khat"])
        where = "importance weights of the draws"
        return [_diagnostic("Pareto k-hat", khat, where, f"≤ {KHAT_LIMIT:g}", khat <= KHAT_LIMIT)]
    import arviz as az

    table = summary(tree)
    names = table["quantity"].values

    def worst(name: str, sign: float) -> tuple[float, str]:
        values = table[name].values
        k = int(np.argmax(np.where(np.isnan(values), np.inf, sign * values)))
        return float(values[k]), str(names[k])

    value, where = worst("r_hat", 1.0)
    where = where if tree["posterior"].sizes["chain"] > 1 else "it needs two chains"
    results = [_diagnostic("largest R-hat", value, where, f"< {R_HAT_LIMIT:g}", value < R_HAT_LIMIT)]
    for name, label in (("ess_bulk", "least bulk ESS"), ("ess_tail", "least tail ESS")):
        value, where = worst(name, -1.0)
        results.append(_diagnostic(label, value, where, f"> {ESS_LIMIT:g}", value > ESS_LIMIT))
    stats = tree["sample_stats"].dataset if "sample_stats" in tree.children else xr.Dataset()
    if "diverging" in stats:
        count = int(stats["diverging"].sum())
        results.append(_diagnostic("divergences", float(count), "all chains", "= 0", count == 0))
    if "energy" in stats:
        bfmi = np.atleast_1d(az.bfmi(tree)["energy"].values)
        k = int(np.argmin(np.where(np.isnan(bfmi), -np.inf, bfmi)))
        value = float(bfmi[k])
        results.append(_diagnostic("least E-BFMI", value, f"chain {k}", f"> {E_BFMI_LIMIT:g}", value > E_BFMI_LIMIT))
    return results


def _diagnostic(label: str, value: float, where: str, limit: str, passes: bool) -> dict:
    return {"diagnostic": label, "value": value, "where": where, "limit": limit, "passes": bool(passes)}


def correlation(tree: xr.DataTree) -> xr.DataArray:
    """Posterior correlation of the coefficients, dims (coefficient, other)."""
    draws = tree["posterior"].dataset["coefficients"].stack(sample=("chain", "draw")).transpose("coefficient", "sample")
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


def autocorrelation(values: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation of a series about its mean at lags 1, 2, ..., shape (lags,)."""
    centred = np.asarray(values, dtype=float) - np.mean(values)
    products = np.array([centred[lag:] @ centred[:-lag] for lag in range(1, lags + 1)])
    return products / (centred @ centred)


def whiteness(values: np.ndarray) -> dict[str, float]:
    """Ljung-Box test that a series is white noise: ``r1``, ``lags``, ``statistic``, ``p_value`` and ``band``.

    Q = n (n + 2) sum r_k^2/(n - k) over h = min(10, n/5) lags is compared with chi-square of h degrees of freedom;
    ``band`` is 1.96/sqrt(n), half the width of the white-noise band. ValueError for fewer than ten values. Ljung & Box
    (1978), Biometrika 65(2):297, doi:10.1093/biomet/65.2.297.
    """
    n = len(values)
    if n < 10:
        raise ShipError(f"A test of whiteness needs ten values or more, found {n}; use a longer trial.")
    lags = min(10, n // 5)
    r = autocorrelation(values, lags)
    statistic = n * (n + 2.0) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    p_value = float(scipy.stats.chi2.sf(statistic, lags))
    return {"r1": float(r[0]), "lags": lags, "statistic": statistic, "p_value": p_value, "band": 1.96 / np.sqrt(n)}


def cross_validation(tree: xr.DataTree) -> "ELPDData":
    """PSIS leave-one-out cross-validation of ArviZ, pointwise; needs the group log_likelihood."""
    import arviz as az

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Estimated shape parameter of Pareto", category=UserWarning)
        return az.loo(tree, pointwise=True, var_name="response")


@np.errstate(divide="ignore", invalid="ignore")
def prior_sensitivity(tree: xr.DataTree) -> list[dict]:
    """Power-scaling sensitivity of every quantity to prior and likelihood; needs log_prior and log_likelihood."""
    import arviz as az

    scalars, results = [name for name in ("noise_variance",) if has(tree, f"posterior/{name}")], {}
    for group in ("prior", "likelihood"):
        moved = az.psense(tree, group=group, var_names=["coefficients", *scalars])
        results[group] = [*map(float, moved["coefficients"].values), *(float(moved[name]) for name in scalars)]
    names = [*map(str, tree["posterior"].dataset["coefficient"].values), *scalars]
    rows = []
    for name, prior, likelihood in zip(names, results["prior"], results["likelihood"], strict=True):
        row = {"quantity": name, "prior": prior, "likelihood": likelihood}
        rows.append(row | {"diagnosis": _sensitivity_diagnosis(prior, likelihood)})
    return rows


def _sensitivity_diagnosis(prior: float, likelihood: float) -> str:
    if np.isnan(prior):
        return "does not vary"
    if prior <= PSENSE_LIMIT:
        return "not moved by the prior"
    if likelihood > PSENSE_LIMIT:
        return "possible prior-data conflict"
    return "strong prior or weak likelihood"


def contraction(draws: xr.DataArray, prior_sd: xr.DataArray) -> xr.Dataset:
    """Contraction of each coefficient, 1 - (posterior variance)/(prior variance), and which ones the data determine.

    A coefficient is determined when the contraction exceeds 0.9 and the mean lies more than 1.96 posterior standard
    deviations from zero. Dims (coefficient,): ``mean``, ``sd``, ``prior_sd``, ``contraction``, ``is_contracted``,
    ``determined``.
    """
    mean, sd = draws.mean(SAMPLE), draws.std(SAMPLE, ddof=1)
    by_variance = 1.0 - (sd / prior_sd) ** 2
    is_contracted = by_variance > CONTRACTION_LIMIT
    values = {"mean": mean, "sd": sd, "prior_sd": prior_sd, "contraction": by_variance, "is_contracted": is_contracted}
    return xr.Dataset({**values, "determined": is_contracted & (np.abs(mean) > SD_LIMIT * sd)})


def determination_labels(results: xr.Dataset) -> np.ndarray:
    """One of :data:`DETERMINATIONS` for each coefficient of :func:`contraction`."""
    return np.where(results["determined"], "determined", np.where(results["is_contracted"], "includes zero", "prior"))


def loadings(vector: np.ndarray, names: Sequence[str]) -> str:
    """The four largest loadings of a direction with their names; the sign makes the largest positive."""
    order = np.argsort(-np.abs(vector))[:4]
    turned = vector * np.sign(vector[order[0]])
    return " ".join(f"{turned[k]:+.2f} {names[k]}" for k in order)
