"""Laws of the errors e of a regression; sigma2 is the ``noise_variance``.

``normal``: e ~ N(0, sigma2). ``student_t``: e ~ t(nu, 0, sigma) of variance sigma2 nu / (nu - 2), nu ~ Gamma(2, 0.1).
``ar1``: e_1 ~ N(0, sigma2), e_t ~ N(rho e_(t-1), (1 - rho^2) sigma2), rho ~ Uniform(-1, 1), anew for each run.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from pymc_ship.inference.regression.tree import fitted_residuals, normal_log_density
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import InferenceError, ShipError

OWN = "own"  # family of a prior, and law of errors, that the package does not know

NU_SHAPE, NU_RATE = 2.0, 0.1  # Gamma prior of the degrees of freedom
_PLUG_IN_NU = 4.0

Whitening = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class ErrorLaw:
    """Law of the errors; arrays of the parameter have shape (...), of rows (..., n_rows).

    Attributes
    ----------
    parameter, prior, citation : str; name of the parameter besides the noise variance, if any, its prior, source
    draw_parameter : callable; (rng, size) -> draws of its prior
    log_parameter : callable; parameter -> log prior density
    draw_errors : callable; (rng, noise_sd, parameter, n_rows) -> errors
    log_likelihood : callable; (residual, noise_variance, parameter) -> log density of each row, given those before,
        written over the residuals
    whiten : callable; (residual, noise_variance) -> function of rows (n_rows, ...) that whitens their errors
    """

    parameter: str = ""
    prior: str = ""
    citation: str = ""
    draw_parameter: Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]
    log_parameter: Callable[[np.ndarray], np.ndarray]
    draw_errors: Callable[[np.random.Generator, np.ndarray, np.ndarray, int], np.ndarray]
    log_likelihood: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    whiten: Callable[[np.ndarray, float], Whitening]


def _student_t_log_likelihood(residual: np.ndarray, noise_variance: np.ndarray, nu: np.ndarray) -> np.ndarray:
    constant = (
        scipy.special.gammaln(0.5 * (nu + 1.0))
        - scipy.special.gammaln(0.5 * nu)
        - 0.5 * np.log(math.pi * nu * noise_variance)
    )
    np.square(residual, out=residual)
    residual /= (nu * noise_variance)[..., None]
    np.log1p(residual, out=residual)
    residual *= -0.5 * (nu + 1.0)[..., None]
    residual += constant[..., None]
    return residual


def _ar1_log_likelihood(residual: np.ndarray, noise_variance: np.ndarray, rho: np.ndarray) -> np.ndarray:
    residual[..., 1:] -= rho[..., None] * residual[..., :-1]
    normal_log_density(residual[..., :1], noise_variance)
    normal_log_density(residual[..., 1:], noise_variance * (1.0 - rho**2))
    return residual


def _draw_normal(rng: np.random.Generator, noise_sd: np.ndarray, _: np.ndarray, n_rows: int) -> np.ndarray:
    errors = rng.standard_normal((*np.shape(noise_sd), n_rows))
    errors *= noise_sd[..., None]
    return errors


def _draw_ar1(rng: np.random.Generator, noise_sd: np.ndarray, rho: np.ndarray, n_rows: int) -> np.ndarray:
    errors = _draw_normal(rng, noise_sd, rho, n_rows)
    errors[..., 1:] *= np.sqrt(1.0 - rho**2)[..., None]
    for t in range(1, n_rows):
        errors[..., t] += rho * errors[..., t - 1]
    return errors


def _whiten_student_t(residual: np.ndarray, noise_variance: float) -> Whitening:
    weight = np.sqrt((_PLUG_IN_NU + 1.0) / (_PLUG_IN_NU + residual**2 / noise_variance))
    return lambda rows: (rows.T * weight).T


def _whiten_ar1(residual: np.ndarray, _: float) -> Whitening:
    """Prais-Winsten transformation at the lag-one autocorrelation of the residuals, clipped to +-0.995."""
    square = residual @ residual
    rho = float(np.clip(residual[1:] @ residual[:-1] / square if square > 0.0 else 0.0, -0.995, 0.995))
    root = math.sqrt(1.0 - rho**2)
    return lambda rows: np.concatenate([rows[:1], (rows[1:] - rho * rows[:-1]) / root])


ERRORS = {
    "normal": ErrorLaw(
        draw_parameter=lambda rng, size: np.zeros(size),
        log_parameter=np.zeros_like,
        draw_errors=_draw_normal,
        log_likelihood=lambda residual, noise_variance, _: normal_log_density(residual, noise_variance),
        whiten=lambda residual, noise_variance: lambda rows: rows,
    ),
    "student_t": ErrorLaw(
        parameter="degrees_of_freedom",
        prior="Gamma(shape 2, rate 0.1)",
        citation="Juarez & Steel (2010), JBES 28(1):52, doi:10.1198/jbes.2009.07145",
        draw_parameter=lambda rng, size: rng.gamma(NU_SHAPE, 1.0 / NU_RATE, size),
        log_parameter=lambda nu: 2.0 * math.log(NU_RATE) + np.log(nu) - NU_RATE * nu,
        draw_errors=lambda rng, sd, nu, n_rows: sd[..., None] * rng.standard_t(nu[..., None], (*np.shape(sd), n_rows)),
        log_likelihood=_student_t_log_likelihood,
        whiten=_whiten_student_t,
    ),
    "ar1": ErrorLaw(
        parameter="autocorrelation",
        prior="Uniform(-1, 1)",
        citation="Prais & Winsten (1954), Cowles Commission discussion paper 383",
        draw_parameter=lambda rng, size: rng.uniform(-1.0, 1.0, size),
        log_parameter=lambda rho: np.full_like(rho, -math.log(2.0)),
        draw_errors=_draw_ar1,
        log_likelihood=_ar1_log_likelihood,
        whiten=_whiten_ar1,
    ),
}


def error_law(errors: str, data: RegressionData | None = None) -> ErrorLaw:
    """Error law of a name; ValueError for an unknown name, InferenceError for AR(1) errors of unevenly spaced rows."""
    check_choice("The law of the errors", errors, ERRORS)
    if errors == "ar1" and data is not None:
        parts = run_parts(data)
        steps = np.concatenate([np.diff(data.time[part]) for part in parts])
        fault = "rows of one run apart" if len(parts) > len(set(data.run)) else ""
        if steps.size and not (steps[0] > 0.0 and np.allclose(steps, steps[0], rtol=1e-4, atol=0.0)):
            fault = f"steps from {steps.min():g} to {steps.max():g} s"
        if fault:
            raise InferenceError(
                f"AR(1) errors need contiguous rows at uniform times, found {fault}; use every row of each trial."
            )
    return ERRORS[errors]


def run_parts(data: RegressionData) -> list[slice]:
    """Rows of each run."""
    starts = np.flatnonzero(np.r_[True, data.run[1:] != data.run[:-1]])
    return [slice(start, stop) for start, stop in zip(starts, [*starts[1:], data.n_rows], strict=True)]


def _parts(data: RegressionData, errors: str) -> list[slice]:
    """Rows whose errors are independent of those of the other parts, as far as the law needs them apart."""
    return run_parts(data) if errors == "ar1" else [slice(0, data.n_rows)]


def draw_errors(
    data: RegressionData, errors: str, rng: np.random.Generator, noise_sd: np.ndarray, parameter: np.ndarray
) -> np.ndarray:
    """Errors (..., n_rows) of the rows of the data, given noise sd and parameter (...)."""
    drawn = [
        error_law(errors).draw_errors(rng, noise_sd, parameter, part.stop - part.start) for part in _parts(data, errors)
    ]
    return np.concatenate(drawn, axis=-1) if len(drawn) > 1 else drawn[0]


def log_likelihood(data: RegressionData, errors: str, posterior: xr.Dataset) -> np.ndarray:
    """Log density (chain, draw, row) of the rows, given those before in their run, under draws of the parameters."""
    law, given = error_law(errors), posterior.transpose("chain", "draw", ...)
    variance = given["noise_variance"].to_numpy()
    parameter = given[law.parameter].to_numpy() if law.parameter else np.zeros_like(variance)
    rows = fitted_residuals(data, given["coefficients"].to_numpy())
    for part in _parts(data, errors):
        law.log_likelihood(rows[..., part], variance, parameter)
    return rows


def log_likelihood_group(data: RegressionData, errors: str, posterior: xr.Dataset) -> xr.Dataset:
    """Group log_likelihood of a tree: ``response`` with dims chain, draw, row; as :func:`log_likelihood`."""
    coords = {name: posterior[name] for name in ("chain", "draw")} | {"row": np.arange(data.n_rows)}
    return xr.Dataset({"response": (("chain", "draw", "row"), log_likelihood(data, errors, posterior))}, coords)


def law_of_draws(data: RegressionData, posterior: xr.Dataset, density: xr.Dataset) -> str:
    """Name of the law that gives the log density of the rows but for a constant; "own" if none does or without it."""
    few = posterior.isel(draw=slice(10))
    if "response" not in density or density["response"].shape[:2] != posterior["noise_variance"].shape:
        return OWN
    found = density["response"].transpose("chain", "draw", "row").to_numpy()[:, : few.sizes["draw"]]
    for errors, law in ERRORS.items():
        if not law.parameter or law.parameter in posterior:
            difference = found - log_likelihood(data, errors, few)
            if np.ptp(difference) <= 1e-6 * (1.0 + np.abs(found).max()):
                return errors
    return OWN


def errors_of(tree: xr.DataTree) -> str:
    """Name of the error law of a posterior."""
    return tree.attrs.get("errors", "normal")


def known_errors_of(tree: xr.DataTree) -> str:
    """Name of the error law of a posterior; ValueError if the package does not know it."""
    errors = errors_of(tree)
    if errors == OWN:
        raise ShipError(
            f"A prediction needs errors of a known law, {', '.join(ERRORS)}, found another one or no log_likelihood "
            "that shows it; give posterior_tree the model, or predict by pm.sample_posterior_predictive."
        )
    return errors


def with_errors(tree: xr.DataTree, data: RegressionData, errors: str, parameter: np.ndarray) -> xr.DataTree:
    """Copy of a posterior tree with the parameter (n_chains, n_draws) of an error law and the densities by it."""
    law, sample = error_law(errors, data), ("chain", "draw")
    groups = {name: group.to_dataset() for name, group in tree.children.items()}
    groups["posterior"] = posterior = groups["posterior"].assign({law.parameter: (sample, parameter)})
    groups["log_likelihood"] = log_likelihood_group(data, errors, posterior)
    groups["log_prior"] = groups["log_prior"].assign({law.parameter: (sample, law.log_parameter(parameter))})
    cited = json.dumps([*json.loads(tree.attrs["citations"]), law.citation])
    attrs = tree.attrs | {"errors": errors, "error_prior": f"{law.parameter} ~ {law.prior}", "citations": cited}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **groups})
