"""Denoising in the study: comparison of the methods, and posterior draws of the denoised record in the regression."""

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.identify import CI_PROB, pooled_coefficients, regression_draws
from pymc_ship.inference.regression.tune import maximise_evidence
from pymc_ship.inference.rows.from_trials import regression_data
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.denoising.denoise import METHODS, denoise
from pymc_ship.replication.estimates import regression_estimate
from pymc_ship.replication.scores import error_summary, relative_error
from pymc_ship.trial.channels import default_channels

N_DRAWS = 20  # draws of the denoised record used in the regression: Rubin's rule then adds 1/20 for their number

DERIVATIVES = ("euler", "savgol")  # derivatives compared: the paper's forward difference, and Savitzky-Golay


def denoiser_rows(trial: xr.Dataset, noisy: xr.Dataset, vessel: Vessel, *, interval: float) -> list[dict]:
    """Signal-to-noise ratio of each channel and error summary of the coefficients by method of denoising.

    ``trial`` is clean and ``noisy`` as measured, dims (time,); ``interval`` of the regression rows in s. Keys:
    ``method``, ``snr_<channel>`` [dB], and the error summary over all DOFs with ``coverage`` [%] of the conjugate
    posterior from forward differences.
    """
    records = {"none": noisy} | {method: denoise(noisy, method=method) for method in METHODS}
    return [
        {
            "method": method,
            **{f"snr_{name}": signal_to_noise(trial[name].values, record[name].values) for name in default_channels()},
            **regression_estimate(record, vessel, interval=interval).scores(vessel),
        }
        for method, record in records.items()
    ]


def signal_to_noise(clean: np.ndarray, record: np.ndarray) -> float:
    """Variance of the clean signal over the mean squared error of a record [dB]; infinite without an error."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(10.0 * np.log10(np.var(clean) / np.mean((record - clean) ** 2)))


def channel_rows(trial: xr.Dataset, drawn: xr.Dataset) -> list[dict]:
    """Pointwise intervals of draws: ``coverage`` [%] of the clean channel, mean ``sd`` and ``rmse`` of the mean."""
    rows = []
    for name in default_channels():
        clean, values = trial[name].values, drawn[name].transpose("draw", "time").values
        lower, upper = np.quantile(values, [0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB], axis=0)
        rows.append(
            {
                "channel": f"{name} [{trial[name].attrs['units']}]",
                "coverage": 100.0 * float(np.mean((lower <= clean) & (clean <= upper))),
                "sd": float(values.std(axis=0).mean()),
                "rmse": float(np.sqrt(np.mean((values.mean(axis=0) - clean) ** 2))),
            }
        )
    return rows


def draw_rows(
    smooth: xr.Dataset, drawn: xr.Dataset, vessel: Vessel, *, interval: float, rng: np.random.Generator
) -> list[dict]:
    """Errors of each DOF from the denoised record taken as known, and pooled over its draws.

    ``smooth``, dims (time,), and ``drawn``, dims (draw, time), are denoised; ``interval`` of the rows in s. Keys:
    ``derivative``, ``dof``; ``median`` error [%] and ``coverage`` [%] of the intervals of 90 %, the same ``_pooled``,
    and ``widened``, the median ratio of the standard deviations. Both use the conjugate prior of largest evidence.
    """
    rows = []
    for derivative in DERIVATIVES:
        for dof in vessel.dofs:
            data = regression_data(smooth, vessel, dof, interval=interval, derivative=derivative)
            prior, _ = maximise_evidence(data, "conjugate")
            known = prior.exact(data)
            draws = regression_draws(drawn, vessel, dof, interval=interval, derivative=derivative)
            pooled = pooled_coefficients(draws, prior, rng=rng)
            ends = known.quantiles([0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB])
            reference = vessel.coefficients(dof).values
            scores = _scores(reference, known.mean, *ends)
            mixture = _scores(reference, *(pooled[name].values for name in ("mean", "lower", "upper")))
            more = {f"{name}_pooled": value for name, value in mixture.items()}
            widened = float(np.median(pooled["sd"].values / known.sd))
            rows.append({"derivative": derivative, "dof": dof, **scores, **more, "widened": widened})
    return rows


def _scores(reference: np.ndarray, mean: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> dict[str, float]:
    inside = (lower <= reference) & (reference <= upper)
    return {
        "median": error_summary(relative_error(mean, reference))["median"],
        "coverage": 100.0 * float(inside.mean()),
    }
