"""A measured manoeuvre beside its forecast: begun where the forecast begins, and its indices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from pymc_ship.denoising.denoise import MIN_LENGTH, denoise
from pymc_ship.manoeuvre.helm import base_course
from pymc_ship.manoeuvre.indices import indices
from pymc_ship.manoeuvre.registry import kind_named
from pymc_ship.trial.channels import CHANNELS, SIMULATED
from pymc_ship.trial.record import is_uniform

_STILL = 0.05
"""A rudder counts as still while neighbouring samples differ by less than this share of its first travel."""


def aligned(measured: xr.Dataset, rudder_deg: float = 0.0) -> xr.Dataset:
    """Measured trial from the rudder's execution on, as a forecast begins: time 0, base course 0, position 0.

    Parameters
    ----------
    measured : Dataset, dims (time,)
        Any of the channels of a trial, SI and rad, from any time, course and position.
    rudder_deg : float, optional
        First rudder angle of the manoeuvre [deg], a magnitude; the largest of the record by default.

    Returns
    -------
    Dataset, dims (time,)
        The channels it has, those at time 0 interpolated. The execution is where the straight line through the moments
        at which the rudder has done a quarter and a half of its first travel begins; it is the first instant of a
        record without a rudder or with one that is over already. A track without a heading is left out.
    """
    time = measured["time"].values.astype(float)
    channels = {name: measured[name].values.astype(float) for name in SIMULATED if name in measured}
    known = {name: np.isfinite(values) for name, values in channels.items() if np.isfinite(values).any()}
    if "psi" in known:
        channels["psi"][known["psi"]] = np.unwrap(channels["psi"][known["psi"]])
    start = _execution(time, channels["delta"], np.deg2rad(rudder_deg)) if "delta" in known else time[0]
    found = {
        name: np.append(np.interp(start, time[good], channels[name][good]), channels[name][time > start])
        for name, good in known.items()
    }
    if "psi" in found:
        steered = {"psi", "r", "delta"} <= channels.keys()
        whole = steered and all(known[name].all() for name in ("psi", "r", "delta") if name in known)
        course = base_course(measured) if whole else found["psi"][0]
        found["psi"] = found["psi"] - course
    if {"psi", "x", "y"} <= found.keys():
        north, east = found["x"] - found["x"][0], found["y"] - found["y"][0]
        c, s = np.cos(course), np.sin(course)
        found |= {"x": c * north + s * east, "y": c * east - s * north}
    else:
        found = {name: values for name, values in found.items() if name not in ("x", "y")}
    kept = np.append(start, time[time > start])
    variables = {name: ("time", values, {"units": CHANNELS[name].unit.name}) for name, values in found.items()}
    return xr.Dataset(variables, {"time": kept - start}, measured.attrs)


def _execution(time: np.ndarray, delta: np.ndarray, travel: float) -> float:
    """Time at which the rudder begins to move to its first angle, which differs by ``travel`` from the angle before."""
    known = np.isfinite(delta)
    time, delta = time[known], delta[known]
    moves = np.ptp(delta[:3]) > _STILL * (travel or np.ptp(delta))
    way = np.abs(delta - (delta[0] if moves else np.median(delta[:3])))
    first, travel = delta[0], travel or float(way.max())
    half = np.flatnonzero(way >= 0.5 * travel)
    if abs(first) >= 0.5 * travel or not half.size or half[0] == 0:
        return float(time[0])
    quarter = int(np.flatnonzero(way[: half[0]] < 0.25 * travel)[-1]) + 1
    (t_half, t_quarter) = (
        float(np.interp(share * travel, way[k - 1 : k + 1], time[k - 1 : k + 1]))
        for share, k in ((0.5, half[0]), (0.25, quarter))
    )
    return max(float(time[0]), 2.0 * t_quarter - t_half)


def measured_indices(measured: xr.Dataset, attrs: Mapping) -> dict[str, float]:
    """Indices of a measured trial of the manoeuvre that ``attrs`` tell, as far as its channels allow.

    Parameters
    ----------
    measured : Dataset, dims (time,)
        See :func:`aligned`.
    attrs : mapping
        ``manoeuvre``, ``rudder_deg``, ``heading_deg`` and ``side`` of the forecast.

    Returns
    -------
    dict of str to float
        Indices [deg, s, m, m/s, deg/s] by name, as of :func:`pymc_ship.indices`; NaN where the record does not reach
        the event or lacks a channel. Yaw rate and heading are denoised first, as the yaw rate of a noisy record changes
        sign before the peak; a missing yaw rate is the slope of the heading, missing velocities are those of the track.
    """
    trial = aligned(_smooth(measured), attrs.get("rudder_deg", 0.0)).dropna("time")
    if "psi" not in trial or trial.sizes["time"] < 3:
        return {}
    time, psi = trial["time"].values, trial["psi"].values
    has = set(trial.data_vars)
    channels = {name: trial[name].values for name in trial.data_vars}
    x, y = (channels.setdefault(name, np.zeros(time.size)) for name in ("x", "y"))
    if "r" not in has:
        channels["r"] = np.gradient(psi, time)
    if not {"u", "v"} <= has:
        north, east = np.gradient(x, time), np.gradient(y, time)
        channels["u"] = north * np.cos(psi) + east * np.sin(psi)
        channels["v"] = east * np.cos(psi) - north * np.sin(psi)
        has |= {"u", "v"} if {"x", "y"} <= has else set()
    channels.setdefault("phi", np.zeros(time.size))
    found = indices(xr.Dataset({n: ("time", v) for n, v in channels.items()}, {"time": time}, dict(attrs)))
    table = kind_named(attrs["manoeuvre"]).indices
    return {name: float(found[name]) if has.issuperset(index.needs) else np.nan for name, index in table.items()}


def _smooth(measured: xr.Dataset) -> xr.Dataset:
    """Trial with heading and yaw rate denoised where it is sampled uniformly, without gaps and long enough."""
    names = [name for name in ("psi", "r") if name in measured and np.isfinite(measured[name].values).all()]
    if not names or measured.sizes["time"] < MIN_LENGTH or not is_uniform(measured["time"].values):
        return measured
    unwrapped = {"psi": ("time", np.unwrap(measured["psi"].values))} if "psi" in names else {}
    return denoise(measured.assign(unwrapped), channels=names)
