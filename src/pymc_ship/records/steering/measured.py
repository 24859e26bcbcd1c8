"""Measured manoeuvre from its first execute on, and its indices."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.physics.forces.surroundings import WIND
from pymc_ship.physics.manoeuvre.events import Record
from pymc_ship.physics.manoeuvre.indices import indices_of_run
from pymc_ship.physics.manoeuvre.registry import kind_named
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.manoeuvre.steering_record import (
    base_course,
    first_execute,
    fixed_rudder_intervals,
    is_manoeuvre,
    rudder_reversals,
)
from pymc_ship.physics.manoeuvre.zigzags import BY_HAND
from pymc_ship.physics.motion.inputs import recorded_wind, revolutions_measured, takes_revolutions
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.denoising.denoise import MIN_LENGTH, denoise
from pymc_ship.records.denoising.draws import denoise_draws
from pymc_ship.trial.channels import CHANNELS, SIMULATED, channel_names
from pymc_ship.trial.record import Channels, is_uniform, unwrapped

_RATIOS = (10.0, 30.0)  # s, L over the approach speed beyond which the limits of IMO MSC.137(76) are constant
_MOTION = channel_names(lambda channel: channel.part == "motion")


def align_to_first_execute(measured: xr.Dataset) -> xr.Dataset:
    """Measured trial from the first execute on, with time, base course and position counted from there.

    Values at time 0 are interpolated. A record without a rudder begins at its first instant; a track without a heading
    is left out.
    """
    aligned = _aligned(measured)
    time = aligned.pop("time")
    variables = {name: ("time", values, {"units": CHANNELS[name].unit.name}) for name, values in aligned.items()}
    return xr.Dataset(variables, {"time": time}, measured.attrs)


def _aligned(measured: Channels) -> dict[str, np.ndarray]:
    """Time and channels of :func:`align_to_first_execute`."""
    time = measured["time"].values.astype(float)
    channels = {name: measured[name].values.astype(float) for name in SIMULATED if name in measured}
    known = {name: np.isfinite(values) for name, values in channels.items()}
    known = {name: good for name, good in known.items() if good.any()}
    if "psi" in known:
        channels["psi"][known["psi"]] = unwrapped(channels["psi"][known["psi"]])
    start = first_execute(measured) if "delta" in known else time[0]
    later = slice(int(np.searchsorted(time, start, side="right")), None)
    shifted = {}
    for name, good in known.items():
        values = channels[name]
        first = np.interp(start, time, values) if good.all() else np.interp(start, time[good], values[good])
        shifted[name] = np.append(first, values[later])
    if "psi" in shifted:
        has_steering = {"psi", "r", "delta"} <= channels.keys()
        whole = has_steering and all(known[name].all() for name in ("psi", "r", "delta") if name in known)
        course = base_course(measured) if whole else shifted["psi"][0]
        shifted["psi"] = shifted["psi"] - course
    if {"psi", "x", "y"} <= shifted.keys():
        north, east = shifted["x"] - shifted["x"][0], shifted["y"] - shifted["y"][0]
        c, s = np.cos(course), np.sin(course)
        shifted |= {"x": c * north + s * east, "y": c * east - s * north}
    else:
        shifted = {name: values for name, values in shifted.items() if name not in ("x", "y")}
    return {"time": np.append(start, time[later]) - start} | shifted


def measured_indices(measured: xr.Dataset, attrs: Mapping[Any, Any]) -> dict[str, float]:
    """Indices of a measured trial of the manoeuvre in ``attrs`` (as for :func:`pymc_ship.indices`), else NaN.

    The motion is denoised first, as peaks of noisy values are too large. A missing yaw rate is the slope of the
    heading, missing velocities are those of the track. Overshoots of a zigzag steered by hand count from its own rudder
    reversals.
    """
    return indices_of_denoised(denoise_motion(measured), attrs)


def measured_criteria(
    trial: xr.Dataset, manoeuvre: Manoeuvre, vessel: Vessel | None, delay: float = 0.0
) -> list[dict[str, Any]]:
    """Rows of the measured indices: index, value, unit, limit of IMO MSC.137(76) and verdict, empty without one.

    Without a vessel, limits that depend on L over the approach speed are given for ships of 10 s and 30 s. ``delay``:
    as for :func:`order_delay`, where the order is not recorded.
    """
    L, speed = (vessel.particulars.L if vessel else np.nan), manoeuvre.approach_speed or np.nan
    ratios = (L / speed, L / speed) if vessel else _RATIOS
    attrs = manoeuvre.attrs | {"approach_speed": speed, "rudder_delay": delay}
    ends = [{name: (limit, unit) for name, limit, unit in manoeuvre.traits.limits(attrs, ratio)} for ratio in ratios]
    rows = []
    for name, value in measured_indices(trial, attrs).items():
        if not np.isfinite(value):
            continue
        row = {"index": name.replace("_", " "), "value": value, "unit": manoeuvre.traits.indices[name].units}
        limit, verdict = "", ""
        if name in ends[0]:
            (low, unit), (high, _) = (end[name] for end in ends)
            limit = f"{low:.4g} {unit}" if low == high else f"{low:.4g} to {high:.4g} {unit} by L/U"
            limit += f" = {low * L:.4g} m" if unit == "L" and vessel else ""
            size = L if unit == "L" else 1.0
            verdict = "met" if value <= low * size else "not met" if value > high * size else "needs --vessel"
        rows.append(row | {"limit": limit, "verdict": verdict})
    return rows


def indices_of_denoised(smooth: Channels, attrs: Mapping[Any, Any]) -> dict[str, float]:
    """Indices of a denoised trial, as :func:`measured_indices`."""
    kind = kind_named(attrs["manoeuvre"])
    channels = _aligned(smooth)
    gaps = np.isnan([*channels.values()]).any(axis=0)
    if gaps.any():
        channels = {name: values[~gaps] for name, values in channels.items()}
    if "psi" not in channels or gaps.size - gaps.sum() < 3:
        return {}
    has = channels.keys() - {"time"}
    settings = dict(attrs) | {"rudder_delay": order_delay(smooth, attrs.get("rudder_delay", 0.0)), "base_course": 0.0}
    trial = {name: xr.Variable("time", values) for name, values in channels.items()}
    if "delta" in has and kind.swings:
        settings |= _hand_steered_reversals(trial, settings)
    elif "delta" in has and kind.circles:
        end = int(np.flatnonzero(is_manoeuvre(trial))[-1]) + 1
        channels = {name: values[:end] for name, values in channels.items()}
    time, psi = channels.pop("time"), channels["psi"]
    x, y = (channels.setdefault(name, np.zeros(time.size)) for name in ("x", "y"))
    if "r" not in has:
        channels["r"] = np.gradient(psi, time)
    if not {"u", "v"} <= has:
        north, east = np.gradient(x, time), np.gradient(y, time)
        channels["u"] = north * np.cos(psi) + east * np.sin(psi)
        channels["v"] = east * np.cos(psi) - north * np.sin(psi)
        has |= {"u", "v"} if {"x", "y"} <= has else set()
    channels.setdefault("phi", np.zeros(time.size))
    reached = indices_of_run(Record(time, channels, settings["rudder_delay"]), kind, settings)
    return {name: value if has.issuperset(kind.indices[name].needs) else np.nan for name, value in reached.items()}


def order_delay(trial: Channels, stated: float) -> float:
    """Time [s] from the order of the first execute to the movement: recorded as ``delta_command``, else as stated or 0.

    The recorded order is the last step of the command, by half the largest angle or more, before the rudder is over.
    """
    intervals = fixed_rudder_intervals(trial["delta"].values) if "delta" in trial else []
    if intervals and "delta_command" in trial:
        command, time = trial["delta_command"].values, trial["time"].values
        steps = np.abs(np.diff(command)) >= 0.5 * np.nanmax(np.abs(command), initial=1e-9)
        orders = time[1:][steps & (time[1:] <= time[intervals[0][0]])]
        if orders.size:
            return max(first_execute(trial) - float(orders[-1]), 0.0)
    return float(np.nan_to_num(stated))


def wind_off_bow(trial: xr.Dataset) -> tuple[float, float] | None:
    """Mean true wind from the first execute on: speed [m/s], and origin from the base course [deg]; None without."""
    if recorded_wind(trial) is None:
        return None
    wind = recorded_wind(trial.isel(time=trial["time"].values >= first_execute(trial))) or 0j
    return abs(wind), float(np.rad2deg(np.angle(wind) - base_course(trial))) % 360.0


def recorded_settings(trial: xr.Dataset, vessel: Vessel) -> dict[str, Any]:
    """Measured revolutions ``n`` [1/s] and ``wind`` (speed [m/s], origin to base course [deg]), if modelled."""
    settings: dict[str, Any] = {}
    if takes_revolutions(vessel) and revolutions_measured(trial):
        settings["n"] = float(np.median(trial["n"].values[trial["time"].values >= first_execute(trial)]))
    wind = wind_off_bow(trial) if WIND.name in vessel.parts else None
    return settings if wind is None else settings | {"wind": wind}


def order_sentence(delay: float, speed: float) -> str:
    """Sentence on the begin of times and distances; ``speed`` [m/s] of the approach."""
    return (
        f"Advance, transfer, distances and times count from the rudder order, {delay:.3g} s ({delay * speed:.3g} m) "
        "before the rudder moves."
        if delay > 0.0
        else "Advance, transfer, distances and times count from the first movement of the rudder."
    )


def _hand_steered_reversals(trial: Channels, attrs: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
    """Times [s] of the ordered reversals of a zigzag that was steered by hand; empty for another record."""
    reversals = rudder_reversals(trial)
    if not reversals:
        return {}
    ordered = [reversal.time - attrs.get("rudder_delay", 0.0) for reversal in reversals]
    headings = np.abs(np.interp(ordered, trial["time"].values, trial["psi"].values))
    return {"reversal_times": tuple(ordered)} if np.abs(headings - headings.mean()).max() > BY_HAND else {}


def denoisable_channels(measured: xr.Dataset) -> list[str]:
    """Motion channels without gaps, in a uniform record of sufficient length; otherwise empty."""
    names = [name for name in _MOTION if name in measured and np.isfinite(measured[name].values).all()]
    whole = measured.sizes["time"] >= MIN_LENGTH and is_uniform(measured["time"].values)
    return names if whole else []


def unwrap_heading(measured: xr.Dataset) -> xr.Dataset:
    """Trial with an unwrapped heading, if the heading has no gaps."""
    known = "psi" in measured and np.isfinite(measured["psi"].values).all()
    return measured.assign(psi=("time", np.unwrap(measured["psi"].values))) if known else measured


def denoise_motion(measured: xr.Dataset) -> xr.Dataset:
    """Trial with an unwrapped heading and, in its :func:`denoisable_channels`, denoised motion."""
    names = denoisable_channels(measured)
    return denoise(unwrap_heading(measured), channels=names) if names else measured


def index_draws(
    measured: xr.Dataset,
    attrs: Mapping[str, Any],
    *,
    draws: int,
    rng: np.random.Generator,
    corrected: Callable[[xr.Dataset], xr.Dataset] = lambda drawn: drawn,
) -> dict[str, np.ndarray]:
    """Draws of each index from draws of the denoised motion, ``corrected``; empty if it cannot be denoised."""
    names = denoisable_channels(measured)
    if not names:
        return {}
    drawn = denoise_draws(unwrap_heading(measured), draws=draws, rng=rng, channels=names)
    return indices_of_draws(corrected(drawn), attrs)


def indices_of_draws(drawn: xr.Dataset, attrs: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Finite values of each index over the draws of a denoised trial; an index without any is left out.

    Channels have dims (draw, time), or (time,) where all draws share them.
    """
    variables = {name: variable.to_base_variable() for name, variable in drawn.variables.items() if name != "draw"}
    shared = {name: variable for name, variable in variables.items() if "draw" not in variable.dims}
    by_draw = {name: variables[name].transpose("draw", "time") for name in variables.keys() - shared.keys()}
    rows = [
        indices_of_denoised(shared | {name: draws[k] for name, draws in by_draw.items()}, attrs)
        for k in range(drawn.sizes["draw"])
    ]
    values = {name: np.array([row.get(name, np.nan) for row in rows]) for name in rows[0]}
    finite = {name: column[np.isfinite(column)] for name, column in values.items()}
    return {name: column for name, column in finite.items() if column.size}
