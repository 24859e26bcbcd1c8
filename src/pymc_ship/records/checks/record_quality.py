"""Checks of a record as such: sampling, noise, resolution, spikes, frozen channels, wraps of the heading, gaps."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pymc_ship.physics.motion.equations import STATE
from pymc_ship.records.checks.rudder import measured_rate
from pymc_ship.records.checks.verdicts import Check, Numbers, ShipScale, not_checked
from pymc_ship.trial.channels import CHANNELS, SIMULATED
from pymc_ship.trial.record import sampling_interval, second_difference_sd

SAMPLES_DOUBTFUL, SAMPLES_BAD = 10.0, 4.0
"""Samples in L/U: a ship answers within a fraction of it, and accelerations need several samples to an answer."""

RUDDER_STEP = 0.25
"""Rudder travel between samples over its range, beyond which its moves are not resolved."""

FASTEST_GEAR = 300.0
"""Rudder angle [deg] in L/U that no steering gear moves: rules ask for 2.3 deg/s of ships, quick models reach 150."""

NOISE_DOUBTFUL, NOISE_BAD = 1.0 / 3.0, 1.0
"""Noise of a sample over the spread of the signal: at 1 the channel is noise as much as signal."""

DISTINCT_DOUBTFUL, DISTINCT_BAD = 50, 10
"""Distinct values of a channel: fewer than 50 stand for steps of 2 % of its range."""

SPIKE = 6.0
"""Robust standard deviations, of the record and of the surroundings, from the local median that make a spike."""

LEAST_SPIKE = 0.02
"""Share of a channel's range below which a spike does no harm."""

FROZEN = 0.25
"""Share of L/U from which equal values are a frozen sensor."""

ROUNDED = 0.8
"""Share of distinct neighbours below which a channel is rounded: it then has runs of equal values of its own."""

_HALF_WINDOW, _LONGEST_SPIKE, _SURROUNDINGS = 4, 2, 51  # samples


def present(trial: xr.Dataset, names: tuple[str, ...] = SIMULATED) -> list[str]:
    """Channels of a record; roll that is 0 throughout counts as not measured."""
    there = [name for name in names if name in trial]
    return [name for name in there if not CHANNELS[name].rolling or trial[name].values.any()]


def sampling_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Sampling interval against L/U and against the travel of the rudder."""
    interval = sampling_interval(trial)
    samples = scale.time / interval
    numbers: Numbers = (("interval", interval, "s"), ("samples in L/U", samples, ""))
    travel = rate = 0.0
    if "delta" in trial and np.ptp(trial["delta"].values) > 0.0:
        rate, _ = measured_rate(trial)
        travel = float(np.nan_to_num(np.deg2rad(rate) * interval / np.ptp(trial["delta"].values)))
        numbers += (("rudder travel between samples over its range", travel, ""),)
    text = f"{interval:.3g} s between samples, {samples:.3g} samples in L/U."
    if samples < SAMPLES_BAD:
        return Check("sampling", "bad", f"{text} Accelerations cannot be estimated; sample faster.", numbers)
    if samples < SAMPLES_DOUBTFUL:
        return Check("sampling", "doubtful", f"{text} That is few; use the trajectory fit, or sample faster.", numbers)
    if travel > RUDDER_STEP and rate * scale.time > FASTEST_GEAR:
        text = (
            f"The rudder moves by {travel:.0%} of its range between samples, {rate:.3g} deg/s: that is an ordered "
            "angle, or a gear far quicker than the ship; a fit takes it for the angle itself."
        )
        return Check("sampling", "doubtful", text, numbers)
    if travel > RUDDER_STEP:
        text = f"The rudder moves by {travel:.0%} of its range between samples; sample faster."
        return Check("sampling", "doubtful", text, numbers)
    return Check("sampling", "good", text, numbers)


def noise_check(trial: xr.Dataset) -> Check:
    """Noise of single samples of each channel, from second differences, over the spread of its signal."""
    names = [name for name in present(trial) if np.ptp(trial[name].values) > 0.0 and trial.sizes["time"] >= 10]
    if not names:
        return not_checked("noise", "no channel that changes, or fewer than 10 samples")
    sd = second_difference_sd(np.array([trial[name].values for name in names], dtype=float))
    spread = np.sqrt(np.maximum([np.var(trial[name].values) for name in names] - sd**2, 1e-6 * sd**2))
    shares = dict(zip(names, (sd / np.maximum(spread, np.finfo(float).tiny)).tolist(), strict=True))
    numbers = tuple(
        (f"sd {name}", float(s), trial[name].attrs.get("units", "")) for name, s in zip(names, sd, strict=True)
    )
    worst = max(shares, key=shares.__getitem__)
    numbers += ((f"noise over signal, {worst}", shares[worst], ""),)
    text = f"The noise is at most {shares[worst]:.2g} of the signal ({worst})."
    if shares[worst] > NOISE_BAD:
        return Check("noise", "bad", f"{text} That channel is noise; leave it out or mend the sensor.", numbers)
    if shares[worst] > NOISE_DOUBTFUL:
        return Check("noise", "doubtful", f"{text} Denoise it, and steer harder.", numbers)
    return Check("noise", "good", text, numbers)


def resolution_check(trial: xr.Dataset) -> Check:
    """Distinct values of the motion channels, which rounding makes few."""
    counts = {name: np.unique(trial[name].values).size for name in present(trial, STATE)}
    counts = {name: count for name, count in counts.items() if count > 1}
    if not counts or trial.sizes["time"] < 2 * DISTINCT_DOUBTFUL:
        return not_checked("resolution", "no motion channel that changes, or a very short record")
    worst = min(counts, key=counts.__getitem__)
    numbers = ((f"distinct values, {worst}", float(counts[worst]), ""),)
    if counts[worst] >= DISTINCT_DOUBTFUL:
        text = f"Every channel has {counts[worst]} distinct values or more ({worst})."
        return Check("resolution", "good", text, numbers)
    step = np.ptp(trial[worst].values) / (counts[worst] - 1)
    verdict = "bad" if counts[worst] < DISTINCT_BAD else "doubtful"
    unit = trial[worst].attrs.get("units", "")
    text = f"{worst} has {counts[worst]} distinct values, steps of about {step:.2g} {unit}; export more digits."
    return Check("resolution", verdict, text, numbers)


def spikes(values: np.ndarray) -> np.ndarray:
    """Indices of isolated samples (one or two in a row) that stand out of their surroundings, see :data:`SPIKE`."""
    from scipy.ndimage import median_filter

    if values.size < 4 * _HALF_WINDOW:
        return np.empty(0, dtype=int)
    away = values - median_filter(values, 2 * _HALF_WINDOW + 1, mode="nearest")
    low, high = np.quantile(values, [0.001, 0.999])
    sd = np.maximum(second_difference_sd(values[None])[0], median_filter(np.abs(away), _SURROUNDINGS) / 0.6745)
    limit = np.maximum(SPIKE * sd, LEAST_SPIKE * (high - low))
    out = np.flatnonzero((np.abs(away) > limit) & (limit > 0.0))
    spikes: list[int] = []
    for group in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1):
        if 0 < group.size <= _LONGEST_SPIKE:
            sides = values[[k for k in (group[0] - 1, group[-1] + 1) if 0 <= k < values.size]]
            steps = values[group][:, None] - sides
            least = limit[group][:, None]
            if (steps > least).all() or (steps < -least).all():
                spikes.extend(group)
    return np.array(spikes, dtype=int)


def spike_check(trial: xr.Dataset) -> Check:
    """Spikes of every channel."""
    counts = {name: spikes(_unwrapped(trial, name)).size for name in present(trial)}
    numbers = tuple((f"spikes, {name}", float(count), "") for name, count in counts.items())
    hit = {name: count for name, count in counts.items() if count}
    if not hit:
        return Check("spikes", "good", "No channel has spikes.", numbers)
    notes = ", ".join(f"{count} on {name}" for name, count in hit.items())
    if max(hit.values()) > 0.02 * trial.sizes["time"]:
        text = f"Spikes: {notes}, more than 2 % of the samples; mend the sensor or leave the channel out."
        return Check("spikes", "bad", text, numbers)
    text = f"Spikes: {notes}; replace them by interpolation (the other checks are made without them)."
    return Check("spikes", "doubtful", text, numbers, mendable=True)


def without_spikes(trial: xr.Dataset) -> xr.Dataset:
    """Trial whose spikes are replaced by straight lines between their neighbours."""
    mended = trial.copy()
    for name in present(trial):
        values = _unwrapped(trial, name)
        bad = spikes(values)
        if bad.size:
            good = np.setdiff1d(np.arange(values.size), bad)
            smooth = trial[name].values + 0.0
            smooth[bad] += np.interp(bad, good, values[good]) - values[bad]
            mended[name] = ("time", smooth, trial[name].attrs)
    return mended


def _unwrapped(trial: xr.Dataset, name: str) -> np.ndarray:
    return unwrapped_heading(trial) if name == "psi" else np.asarray(trial[name].values, dtype=float)


def unwrapped_heading(trial: xr.Dataset) -> np.ndarray:
    """Heading without its jumps of 2 pi; other jumps stay."""
    psi = np.asarray(trial["psi"].values, dtype=float)
    turns = np.diff(psi) / (2.0 * np.pi)
    wraps = np.where(np.abs(np.abs(turns) - 1.0) < 0.03, np.rint(turns), 0.0)
    return psi - 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(wraps)])


def wrap_check(trial: xr.Dataset) -> Check:
    """Jumps of the heading by a whole turn."""
    if "psi" not in trial:
        return not_checked("heading wraps", "no psi in the record")
    count = int(np.count_nonzero(np.abs(np.diff(unwrapped_heading(trial) - trial["psi"].values)) > 1.0))
    numbers = (("jumps", float(count), ""),)
    if count:
        text = f"psi jumps by a whole turn {count} times; unwrap it."
        return Check("heading wraps", "doubtful", text, numbers, mendable=True)
    return Check("heading wraps", "good", "psi is continuous.", numbers)


def frozen_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Longest run of equal values of a motion channel while the ship moves."""
    names = present(trial, STATE)
    stuck = [name for name in names if np.ptp(trial[name].values) == 0.0]
    if stuck:
        text = f"{', '.join(stuck)} never change{'s' if len(stuck) == 1 else ''}; find the right column or the sensor."
        return Check("frozen channels", "bad", text, tuple((f"frozen, {name}", np.inf, "s") for name in stuck))
    interval = sampling_interval(trial)
    longest = {name: interval * _longest_frozen(trial, name, names, scale.time / interval) for name in names}
    hit = {name: duration for name, duration in longest.items() if duration > 0.0}
    numbers = tuple((f"frozen, {name}", duration, "s") for name, duration in hit.items())
    if not hit:
        return Check("frozen channels", "good", "No channel stands still while the ship moves.", numbers)
    worst = max(hit, key=hit.__getitem__)
    verdict = "bad" if hit[worst] > scale.time else "doubtful"
    text = f"{worst} stands still for {hit[worst]:.3g} s while the ship moves; cut that part out or mend the sensor."
    return Check("frozen channels", verdict, text, numbers)


def _longest_frozen(trial: xr.Dataset, name: str, names: list[str], ship_time: float) -> int:
    """Samples in the longest run of equal values during which another velocity changes by 5 % of its range."""
    edges = np.flatnonzero(np.diff(trial[name].values, prepend=np.nan, append=np.nan) != 0.0)
    rounded = edges.size < ROUNDED * (trial.sizes["time"] - np.diff(edges).max())
    least = max(10, round(ship_time * (1.0 if rounded else FROZEN)))
    longest = 0
    others = [trial[other].values for other in names if other in STATE[:3] and other != name]
    for run in np.flatnonzero(np.diff(edges) >= least):
        start, stop = edges[run], edges[run + 1]
        moving = any(np.ptp(_quiet(values[start:stop])) > 0.05 * np.ptp(values) for values in others)
        longest = max(longest, int(stop - start)) if moving else longest
    return longest


def _quiet(values: np.ndarray) -> np.ndarray:
    """Means of five equal parts of a record; noise averages out in them and is not mistaken for motion."""
    return np.array([part.mean() for part in np.array_split(values, 5)])


def gap_check(trial: xr.Dataset) -> Check:
    """Gaps and missing cells from the notes of the reading, ``attrs["reading"]``, a line for each."""
    notes = trial.attrs.get("reading")
    if notes is None:
        return not_checked("gaps", "the record has no notes of its reading")
    gaps = [line for line in notes.splitlines() if "gap" in line.lower() or "missing" in line.lower()]
    numbers = (("remarks", float(len(gaps)), ""),)
    if not gaps:
        return Check("gaps", "good", "No gap was met in the file.", numbers)
    return Check("gaps", "doubtful", f"{' '.join(gaps)} Look at these places before a fit.", numbers)
