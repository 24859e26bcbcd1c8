"""Contraction, directions and residuals by channel of a trajectory fit."""

import json

import numpy as np
import xarray as xr

from pymc_ship.diagnostics import posterior_statistics
from pymc_ship.diagnostics.posterior_statistics import SD_LIMIT, check_draws, whiteness
from pymc_ship.inference.identifiability.information import UNKNOWN
from pymc_ship.inference.regression.tree import SAMPLE
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import whiten
from pymc_ship.machine.errors import ShipError
from pymc_ship.physics.vessel.vessel import LETTER
from pymc_ship.trial.channels import CHANNELS

MODULAR_GROUP = "parts"  # group of the parameters of a ship of parts, which act in several degrees of freedom

METHODS = ("trajectory", "trajectory_nuts")
"""Methods whose posteriors are of whole trajectories: the normal approximation, and the sampler."""

_RECORDED = ("time", "run", "fitted", "block_sd", "correlation")
RESIDUAL_VARIABLES = (*(f"constant_data/{name}" for name in _RECORDED), "observed_data/response")
PRIOR_VARIABLES = ("constant_data/prior_sd",)  # variables of a tree for the comparison of posterior and prior
_ATTRS = ("dof", "vessel", "prior", "integrator", "noise_model", "noise_sentence", "starts", "starts_agreeing")


def check_trajectory(tree: xr.DataTree, name: str = "The tree") -> None:
    """Raise a ValueError that names what a tree lacks to be a posterior of a trajectory fit."""
    needed = (*_ATTRS, *(["pareto_khat"] if tree.attrs["method"] == "trajectory" else []))
    check_draws(tree, name, {"coefficients": (*SAMPLE, "coefficient")}, needed)
    try:
        prior = json.loads(tree.attrs["prior"])
        sizes = {len(prior[key]) for key in ("mean", "scale")} | {tree["posterior"].sizes["coefficient"]}
        complete = len(sizes) == 1 and isinstance(prior["factors"], dict) and isinstance(prior["family"], str)
    except (ValueError, KeyError, TypeError):
        complete = False
    if not complete:
        raise ShipError(
            f"{name} is no posterior of this package: its prior is to give family, factors, and mean and scale of "
            "every coefficient; give one that `pymc-ship fit` made."
        )


def contraction(tree: xr.DataTree) -> xr.Dataset:
    """Contraction of each coefficient, with ``prior_mean`` and the coordinate ``dof``."""
    posterior, constant = tree["posterior"].dataset, tree["constant_data"].dataset
    dataset = posterior_statistics.contraction(posterior["coefficients"], constant["prior_sd"])
    dataset = dataset.assign(prior_mean=("coefficient", json.loads(tree.attrs["prior"])["mean"]))
    return dataset.assign_coords(dof=("coefficient", dofs(tree)))


def prior_of(tree: xr.DataTree) -> CoefficientPrior:
    """Normal prior of the same mean and sd as the prior of a posterior at its median factors."""
    recorded, sd = json.loads(tree.attrs["prior"]), tree["constant_data"].dataset["prior_sd"].values
    return CoefficientPrior(np.array(recorded["mean"], dtype=float), sd, sd, recorded["family"])


def dofs(tree: xr.DataTree) -> list[str]:
    """Degree of freedom of every coefficient by its first letter; ``MODULAR_GROUP`` for a ship of parts."""
    letters = {letter: dof for dof, letter in LETTER.items()}
    begins = [str(name)[0] for name in tree["posterior"].dataset["coefficient"].values]
    return [MODULAR_GROUP] * len(begins) if not letters.keys() >= {*begins} else [letters[letter] for letter in begins]


def directions(tree: xr.DataTree) -> xr.Dataset:
    """Directions of the coefficients, the least known first, with the remaining prior variance along each.

    Principal directions of one half of the draws, in prior standard deviations, and the variance of the other half
    along them, which is not too extreme. Coefficients with a flat prior are left out. Lam (2016), Annals of Statistics
    44(3):928, doi:10.1214/15-AOS1393; MacKay (1992), doi:10.1162/neco.1992.4.3.415, for the effective number of
    directions.

    Returns
    -------
    Dataset, dims (direction,)
        ``remaining_variance``, relative to the prior, ``text`` with the largest loadings; attrs ``n_unknown``, the
        directions with more than half of it, ``n_effective``, the sum of the contractions, and ``n_flat``.
    """
    dataset = contraction(tree)
    proper = np.isfinite(dataset["prior_sd"].values)
    names = dataset["coefficient"].values[proper].tolist()
    draws = tree["posterior"].dataset["coefficients"].stack(sample=SAMPLE).transpose("sample", "coefficient").values
    scaled = (draws[:, proper] - draws[:, proper].mean(axis=0)) / dataset["prior_sd"].values[proper]
    _, _, right = np.linalg.svd(scaled[::2], full_matrices=True)
    remaining = np.var(scaled[1::2] @ right.T, axis=0, ddof=1)
    order = np.argsort(-remaining, kind="stable")
    attrs = {
        "n_unknown": int(np.sum(remaining > UNKNOWN)),
        "n_effective": float(dataset["contraction"].values[proper].sum()),
        "n_flat": int(np.sum(~proper)),
    }
    text = [posterior_statistics.loadings(right[k], names) for k in order]
    return xr.Dataset({"remaining_variance": ("direction", remaining[order]), "text": ("direction", text)}, attrs=attrs)


def residuals(tree: xr.DataTree) -> xr.Dataset:
    """Block means minus fitted motion and posterior mean offset, in sd of a block, dims (row, channel).

    ``residual``, and ``white`` without the autocorrelation of the noise model; NaN for channels that a run lacks.
    """
    constant, posterior = tree["constant_data"].dataset, tree["posterior"].dataset
    run, channels = constant["run"].values, constant["channel"].values
    misfit = (tree["observed_data"].dataset["response"] - constant["fitted"]).transpose("row", "channel").values
    if "sensor_offset" in posterior:
        offset = posterior["sensor_offset"].mean(SAMPLE).sel(channel=channels).transpose("run", "channel").values
        misfit = misfit - np.nan_to_num(offset)[run]
    sd, correlation = (constant[name].transpose("run_index", "channel").values for name in ("block_sd", "correlation"))
    white = np.empty_like(misfit)
    for k, c in np.ndindex(sd.shape):
        white[run == k, c] = whiten(misfit[run == k, c], float(sd[k, c]), float(np.nan_to_num(correlation[k, c])))
    values = {"residual": (("row", "channel"), misfit / sd[run]), "white": (("row", "channel"), white)}
    coords = {"row": constant["row"].values, "channel": channels}
    return xr.Dataset(values, coords | {name: ("row", constant[name].values) for name in ("time", "run")})


def channel_rows(tree: xr.DataTree) -> list[dict]:
    """Noise and residuals of every run (from 1) and channel.

    ``unit`` (deg for angles), ``blocks``; ``block_sd`` and ``offset`` (NaN without) in that unit, ``correlation``;
    ``chi2``, the mean square of the whitened residuals, and the fraction ``inside`` 1.96; ``r1``, ``p_value`` and
    ``lags`` of their Ljung-Box test; ``largest`` residual in standard deviations, and ``at`` [s].
    """
    dataset, constant = residuals(tree), tree["constant_data"].dataset
    offset = tree["posterior"].dataset.get("sensor_offset")
    rows = []
    for k, c in np.ndindex(constant["block_sd"].transpose("run_index", "channel").shape):
        mine = dataset.isel(row=dataset["run"].values == k, channel=c)
        if np.isnan(mine["white"].values).any():
            continue
        name, white, size = str(mine["channel"].item()), mine["white"].values, np.abs(mine["residual"].values)
        unit = CHANNELS[name].unit
        factor = unit.display_factor
        by_run = {key: float(constant[key].isel(run_index=k, channel=c)) for key in ("block_sd", "correlation")}
        shift = np.nan if offset is None else float(offset.isel(run=k).sel(channel=name).mean())
        test = whiteness(white)
        rows.append(
            {"run": k + 1, "channel": name, "unit": unit.display, "blocks": white.size, "offset": factor * shift}
            | {"block_sd": factor * by_run["block_sd"], "correlation": by_run["correlation"]}
            | {"chi2": float(np.mean(white**2)), "inside": float(np.mean(np.abs(white) <= SD_LIMIT))}
            | {key: test[key] for key in ("r1", "p_value", "lags")}
            | {"largest": float(size.max()), "at": float(mine["time"].values[size.argmax()])}
        )
    return rows


def without_diverged_draws(tree: xr.DataTree) -> xr.DataTree:
    """Draws whose simulation did not diverge on the records, as one chain."""
    running = np.isfinite(tree["log_likelihood"].dataset["response"].transpose(*SAMPLE, "row").values).all(axis=-1)
    if running.all():
        return tree
    chain, draw = (xr.DataArray(position, dims="draw") for position in np.nonzero(running))
    groups = {name: node.to_dataset() for name, node in tree.children.items() if set(SAMPLE) <= set(node.dims)}
    groups = {name: group.isel(chain=chain, draw=draw).drop_vars(SAMPLE) for name, group in groups.items()}
    return xr.DataTree.from_dict({name: group.expand_dims(chain=[0]) for name, group in groups.items()})
