"""Tables of the study: errors of discretisation and noise, methods, and misprints of the paper."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.identifiability.bound import errors_on_bound
from pymc_ship.inference.regression.cross_validation import cross_validation
from pymc_ship.inference.regression.families import prior_family
from pymc_ship.inference.regression.identify import Identification, identify
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.rows.from_trials import regression_data
from pymc_ship.inference.trajectory.mode import TrajectoryMode
from pymc_ship.physics.vessel.vessel import Vessel, reference_coefficients
from pymc_ship.records.denoising.denoise import denoise
from pymc_ship.records.files.noise import LITERAL_LEVEL, pollute
from pymc_ship.replication.estimates import (
    Estimate,
    differencing_estimates,
    exact_estimate,
    trajectory_estimate,
    weak_form_estimate,
)
from pymc_ship.replication.scores import relative_error, summary_rows

PUBLISHED_PRIORS = {
    "conjugate": {
        "surge": (8742, 156e3, 26.5e12),
        "sway": (3192, 532e3, 13.4e12),
        "yaw": (5748, 564e3, 7.8e12),
        "roll": (5267, 741e3, 9.8e12),
    },
    "semiconjugate": {
        "surge": (45637, 16873e3, 4.9e12),
        "sway": (64815, 58742e3, 8.2e12),
        "yaw": (59672, 81644e3, 12.7e12),
        "roll": (85241, 9438e3, 6.1e12),
    },
}
"""A, B and kappa of Xue et al. (2020), Table 4, for the container ship; the scale of the inverse gamma is 1 / B."""

PAPER_FAMILIES = tuple(PUBLISHED_PRIORS)  # prior families that the paper compares, and the study with it

AS_PUBLISHED: dict[str, Any] = {"ci_prob": 0.9, "step": 0.02, "record_interval": 0.5, "method": "euler"}
"""Settings of a forecast in the steps of the paper."""

BOUND = "Cramer-Rao bound"  # name of the bound among the methods


def published_prior(vessel: Vessel, family: str, dof: str) -> Prior | None:
    """Prior of the paper's Table 4; None for a vessel without published estimates of the DOF."""
    if not np.isfinite(vessel.published_estimates(dof, family)).any():
        return None
    shape, reciprocal, kappa = PUBLISHED_PRIORS[family][dof]
    return prior_family(family)(kappa=kappa, shape=shape, scale=1.0 / reciprocal)


def prior_rows(vessel: Vessel, identification: Identification) -> list[dict]:
    """Table 4: hyperparameters by how they were chosen, with cross-validated score and log evidence.

    Keys: family, dof, choice, shape, scale, kappa, score and its standard error (per held-out row), log_evidence. The
    published choice is shown where the vessel has published estimates.
    """
    rows = []
    for family, by_dof in identification.tuned.items():
        for dof, tuned in by_dof.items():
            choices = {
                "best point evaluated": tuned.evaluated_prior,
                "optimum of the surrogate": tuned.surrogate_prior,
                "evidence maximum": tuned.evidence_prior,
            }
            if (published := published_prior(vessel, family, dof)) is not None:
                choices["published"] = published
            validation = cross_validation(identification.data[dof])
            for choice, prior in choices.items():
                score = validation.score(prior)
                values = {name: getattr(prior, name) for name in ("shape", "scale", "kappa")}
                evidence = prior.exact(identification.data[dof]).log_evidence
                more = {"score": score.mean, "score_se": score.se, "log_evidence": evidence}
                rows.append({"family": family, "dof": dof, "choice": choice, **values, **more})
    return rows


def discretisation_rows(trial: xr.Dataset, vessel: Vessel, *, interval: float = 1.0) -> list[dict]:
    """Least squares on a clean trial: median error of each DOF [%] by sampling and differencing.

    The trial, dims (time,), is at the integration step; ``interval`` [s] is that of the coarse record. Keys:
    ``differences``, every DOF, and ``worst`` over all coefficients.
    """
    step = float(trial.attrs["step"])
    coarse = trial.isel(time=slice(None, None, round(interval / step)))
    cases = {
        f"Euler difference at {step:g} s": (trial, "euler"),
        f"forward difference at {interval:g} s": (coarse, "euler"),
        f"central difference at {interval:g} s": (coarse, "central"),
    }
    rows = []
    for name, (record, derivative) in cases.items():
        row: dict = {"differences": name}
        worst = 0.0
        for dof in vessel.dofs:
            data = regression_data(record, vessel, dof, interval=interval, derivative=derivative)
            errors = relative_error(data.least_squares, vessel.coefficients(dof).values)
            row[dof] = float(np.nanmedian(errors))
            worst = max(worst, float(np.nanmax(errors)))
        rows.append({**row, "worst": worst})
    return rows


def differencing_rows(
    smooth: xr.Dataset, vessel: Vessel, derivatives: Sequence[str], intervals: Sequence[float | None]
) -> list[dict]:
    """Error summary over all DOFs of the conjugate posterior mean, by derivative and interval of the rows."""
    rows = []
    for derivative in derivatives:
        for interval in intervals:
            identification = identify(smooth, vessel, families=("conjugate",), derivative=derivative, interval=interval)
            label = "every sample" if interval is None else f"{interval:g} s"
            rows += summary_rows(vessel, identification.exact, derivative=derivative, interval=label)
    return [row for row in rows if row["dof"] == "all"]


def level_rows(
    trial: xr.Dataset,
    vessel: Vessel,
    levels: Sequence[float],
    *,
    rng: np.random.Generator,
    progress: Callable[[str], None] = lambda _: None,
) -> list[dict]:
    """Error summary of each DOF against the noise level: denoised trial, conjugate family, evidence maximum."""
    rows = []
    for level in levels:
        progress(f"noise level {level:.0e}")
        smooth = denoise(pollute(trial, level=level, rng=rng))
        identification = identify(smooth, vessel, families=("conjugate",))
        rows += summary_rows(vessel, identification.exact, level=level)
    return rows


def level_of_error(rows: list[dict], error: float) -> float:
    """Noise level at which the median error over all DOFs passes a value, log-log interpolated; NaN beyond."""
    overall = [(row["level"], row["median"]) for row in rows if row["dof"] == "all"]
    if not overall or not error > 0.0:
        return float("nan")
    level, median = np.log(np.array(overall)).T
    above = np.flatnonzero(median >= np.log(error))
    if not above.size or above[0] == 0:
        return float("nan")
    k = int(above[0])
    fraction = (np.log(error) - median[k - 1]) / (median[k] - median[k - 1])
    return float(np.exp(level[k - 1] + fraction * (level[k] - level[k - 1])))


def method_rows(
    vessel: Vessel,
    bound: np.ndarray,
    noisy: xr.Dataset,
    smooth: xr.Dataset,
    identification: Identification,
    modes: Mapping[str, TrajectoryMode | None],
    **labels: Any,
) -> list[dict]:
    """Error summary over all DOFs of every method on one noisy trial, after that of the Cramer-Rao bound.

    ``bound``, shape (n_coefficients,), is at the noise of the trial; ``noisy`` and ``smooth``, dims (time,), are
    the trial in Euler steps, measured and denoised; ``modes`` is the trajectory fit by prior, None where it failed.
    Keys: ``method``, the error summary (of the bound: expected of unbiased estimates), ``coverage`` [%] of the
    intervals of 90 % and ``detail``. The differencing method is the one with the smallest median error.
    """
    failed = np.full(bound.size, np.nan)
    fits = {
        fit_name(prior): (Estimate(failed, failed, failed), "no start converges")
        if mode is None
        else (trajectory_estimate(mode.choice.fit), _fit_detail(mode))
        for prior, mode in modes.items()
    }
    rivals = differencing_estimates(smooth, vessel)
    best = min(rivals, key=lambda name: rivals[name].scores(vessel)["median"])
    rest = {
        "weak form": (weak_form_estimate(noisy, vessel, method="euler"), "window of 10 s each 4 s"),
        "best differencing": (rivals[best], best),
        "paper's pipeline": (exact_estimate(identification.exact["conjugate"]), "forward difference at 1 s"),
    }
    unknown = {"coverage": float("nan"), "coverage_half": float("nan"), "detail": "unbiased, normal"}
    expected = errors_on_bound(relative_bound(vessel, bound)) | unknown
    return [{**labels, "method": BOUND, **expected}] + [
        {**labels, "method": name, **estimate.scores(vessel), "detail": detail}
        for name, (estimate, detail) in (fits | rest).items()
    ]


def fit_name(prior: str) -> str:
    """Name of the trajectory fit under a prior among the methods."""
    return f"trajectory fit, {prior.replace('_', '-')} prior"


def _fit_detail(mode: TrajectoryMode) -> str:
    choice = mode.choice
    noise = choice.kind.replace("_", "-") + (" noise, offsets" if choice.offsets else " noise")
    return f"{noise}, chi2 {choice.fit.chi2:.2f}, {mode.n_agreeing}/{mode.n_starts} starts"


def relative_bound(vessel: Vessel, bound: np.ndarray) -> np.ndarray:
    """Bound of every coefficient [% of the reference], shape (n_coefficients,); NaN where that is zero."""
    reference = reference_coefficients(vessel)
    return relative_error(reference + bound, reference)


def published_bound_rows(vessel: Vessel, unit_bound: np.ndarray, families: Sequence[str]) -> list[dict]:
    """Published errors against the bound at the paper's literal noise level, by family over all DOFs.

    ``unit_bound``, shape (n_coefficients,), is the Cramer-Rao bound at a noise level of 1, to which it is proportional.
    Keys: ``family``; ``errors``, their number, ``median`` [%] and how many are ``below`` the bound; ``on_bound``, the
    median error [%] expected of unbiased estimates; ``level``, at which that is the published median.
    """
    relative, reference = relative_bound(vessel, unit_bound), reference_coefficients(vessel)
    rows = []
    for family in families:
        published = np.concatenate([vessel.published_estimates(dof, family) for dof in vessel.dofs])
        errors = relative_error(published, reference)
        known = np.isfinite(errors)
        if not known.any():
            continue
        on_bound, median = errors_on_bound(relative[known])["median"], float(np.median(errors[known]))
        rows.append(
            {
                "family": family,
                "errors": int(known.sum()),
                "median": median,
                "below": int((errors[known] < LITERAL_LEVEL * relative[known]).sum()),
                "on_bound": LITERAL_LEVEL * on_bound,
                "level": median / on_bound,
            }
        )
    return rows


def printed_error_rows(vessel: Vessel, families: Sequence[str]) -> list[dict]:
    """For each DOF how many printed errors fit the estimate of their own family, and of the other one.

    A printed error fits where it differs from the recomputed one by at most 0.6 percentage points or a tenth of it.
    """
    rows = []
    for dof in vessel.dofs:
        reference = vessel.coefficients(dof).values
        recomputed = [relative_error(vessel.published_estimates(dof, family), reference) for family in families]
        printed = [vessel.published_errors(dof, family) for family in families]
        own = sum(_fits(p, r) for p, r in zip(printed, recomputed, strict=True))
        other = sum(_fits(p, r) for p, r in zip(printed, recomputed[::-1], strict=True))
        compared = sum(int(np.isfinite(p + r).sum()) for p, r in zip(printed, recomputed, strict=True))
        rows.append({"dof": dof, "printed": compared, "fit_own": own, "fit_other": other})
    return rows


def _fits(printed: np.ndarray, recomputed: np.ndarray) -> int:
    with np.errstate(invalid="ignore"):
        return int((np.abs(printed - recomputed) <= np.maximum(0.6, 0.1 * recomputed)).sum())


def full_conditional_rows(identification: Identification, trees: dict[str, xr.DataTree]) -> list[dict]:
    """sigma2 of the conjugate family against MCMC draws, with its marginal shape and with that of the paper's Eq. 15.

    ``trees`` are the draws by DOF. Keys: ``mcmc`` mean and ``mcse``, and the z-scores of the mean under the shapes
    A + n/2 and A + (n+c)/2.
    """
    from arviz import mcse

    rows = []
    for dof, tree in trees.items():
        posterior: Any = identification.exact["conjugate"][dof]
        draws = tree["posterior"].dataset["noise_variance"]
        mean, error = float(draws.mean()), float(mcse(draws.values, method="mean"))
        slip = posterior.scale / (posterior.shape + 0.5 * len(posterior.coefficients) - 1.0)
        rows.append(
            {
                "dof": dof,
                "mcmc": mean,
                "mcse": error,
                "z_marginal": (mean - posterior.noise_variance_mean) / error,
                "z_full_conditional": (mean - slip) / error,
            }
        )
    return rows
