"""Checks of a record as such: sampling, noise, resolution, spikes, jumps, frozen channels, wraps, signs, gaps."""

import numpy as np
import scipy
import xarray as xr

from pymc_ship.physics.motion.equations import STATE
from pymc_ship.records.checks.rudder import rudder_rate
from pymc_ship.records.checks.verdicts import SLOW, Check, Numbers, balance, not_checked, pieces
from pymc_ship.records.files.columns import MISSING_CODES, standing_out
from pymc_ship.records.files.ship_scale import ShipScale
from pymc_ship.records.files.sides import raw_signal_text, rudder_middle
from pymc_ship.trial.channels import CHANNELS, SIMULATED
from pymc_ship.trial.record import sampling_interval, second_difference_sd

SAMPLES_DOUBTFUL, SAMPLES_BAD = 10.0, 4.0  # samples in L/U; a ship answers within a fraction of it
MOST_SAMPLES = 1e5  # samples in L/U from which time has another unit; 1 kHz on the slowest ship are 6e4
LOST_DOUBTFUL, LOST_BAD = 0.1, 0.5  # fraction of the rows of a file that its reading leaves out
REPEATED = 1.5  # samples of one reading, from which the readings stand several times in the record
RUDDER_STEP = 0.25  # rudder travel between samples over its range, beyond which its moves are not resolved
FASTEST_GEAR = 300.0  # rudder angle [deg] in L/U beyond any steering gear; quick models reach 150
NOISE_DOUBTFUL, NOISE_BAD = 1.0 / 3.0, 1.0  # noise of a sample over the spread of the signal
DISTINCT_DOUBTFUL, DISTINCT_BAD = 50, 10  # distinct values of a channel; 50 are steps of 2 % of its range
SPIKE = 6.0  # robust standard deviations of a spike from the local median
LEAST_SPIKE = 0.02  # fraction of a channel's range below which a spike does no harm
FROZEN = 0.25  # fraction of L/U from which equal values are a frozen sensor
ALONG = 0.02  # sine of the heading below which a ship moves along an axis, and the other coordinate may stand still
ROUNDED = 0.8  # fraction of distinct neighbours below which a channel is rounded, with runs of equal values
_LOST = ("gap", "missing", "out of the order", "time goes back", "without a time")  # rows, in the notes of the reading
_HALF_WINDOW, _LONGEST_SPIKE, _SURROUNDINGS = 4, 2, 51  # samples
ABRUPT, NOISY = 5.0, 8.0  # change at a jump over those around it, and over the noise of a sample
LEAST_JUMP, BAD_JUMP = 0.1, 0.25  # fraction of a channel's range
LEAST_JUMPS = {"psi": 0.05, "x": 0.05, "y": 0.05}  # rad; ship lengths
_STILL = 0.1  # fraction of a step within which a rudder stays
TOGETHER = 3  # channels that jump at once where two runs stand in one file
DEFLECTED, BEGUN, ENDED = 0.05, 0.5, 0.15  # rudder angle [rad]; r/U over its largest of a turn begun, and ended
_ANY_ZERO = ("psi", "x", "y")  # channels that count from an arbitrary zero
_FEWEST_READINGS, _ABRUPT_MOVE, _SHORTEST_HOLD = 20, 3, 10  # samples of a channel; of a rudder's move; of its rest
_MOST_JUMPS = 0.02  # fraction of the samples; more are noise
ONE_SIDED, BOTH_SIDES = 0.05, 0.3  # lesser over larger extreme of a channel without sign; of another, to both sides
UNSIGNED = {"v": "r", "r": "v", "delta": "r"}  # channels that change sign with another one


def recorded(trial: xr.Dataset, names: tuple[str, ...] = SIMULATED) -> list[str]:
    """Channels of a record; roll that is 0 throughout counts as not measured."""
    return [name for name in names if name in trial and (not CHANNELS[name].rolling or trial[name].values.any())]


def sampling_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Sampling interval against L/U and against the travel of the rudder."""
    interval = sampling_interval(trial)
    samples = scale.time / interval
    numbers: Numbers = (("interval", interval, "s"), ("samples in L/U", samples, ""))
    travel = rate = 0.0
    if "delta" in trial and np.ptp(trial["delta"].values) > 0.0:
        rate, _ = rudder_rate(trial)
        travel = float(np.nan_to_num(np.deg2rad(rate) * interval / np.ptp(trial["delta"].values)))
        numbers += (("rudder travel between samples over its range", travel, ""),)
    text = f"{interval:.3g} s between samples, {samples:.3g} samples in L/U."
    if samples < SAMPLES_BAD:
        return Check("sampling", "bad", f"{text} Accelerations cannot be estimated; sample faster.", numbers)
    if samples > MOST_SAMPLES:
        text += " No logger is so fast: state the unit of time in the format, such as 'days', or thin the record."
        return Check("sampling", "bad", text, numbers)
    if samples < SAMPLES_DOUBTFUL:
        return Check("sampling", "doubtful", f"{text} That is few; use the trajectory fit, or sample faster.", numbers)
    if (repeats := _repeats(trial)) > REPEATED:
        text = f"Each reading is repeated {repeats:.2g} times: thin the record to one every "
        text += f"{repeats * interval:.3g} s, else intervals are too narrow."
        return Check("sampling", "doubtful", text, numbers)
    if travel > RUDDER_STEP and rate * scale.time > FASTEST_GEAR:
        text = f"The rudder moves by {travel:.0%} of its range between samples, {rate:.3g} deg/s: that is an ordered "
        text += "angle, or a gear far quicker than the ship; a fit would use it as the angle."
        return Check("sampling", "doubtful", text, numbers)
    if travel > RUDDER_STEP:
        text = f"The rudder moves by {travel:.0%} of its range between samples; sample faster."
        return Check("sampling", "doubtful", text, numbers)
    return Check("sampling", "good", text, numbers)


def _repeats(trial: xr.Dataset) -> float:
    """Samples of one reading, on average: all channels stand still together, although the ship moves."""
    names = [name for name in ("x", "y", "psi", "u", "v", "r") if name in trial]
    values = np.array([trial[name].values for name in names]).reshape(len(names), trial.sizes["time"])
    moved = (np.diff(values, axis=1) != 0.0).any(axis=0)
    moving = np.flatnonzero(moved)
    return float(np.ptp(moving) / max(moving.size - 1, 1)) if moving.size else 1.0


def noise_check(trial: xr.Dataset) -> Check:
    """Noise of single samples of each channel, from second differences, over its signal.

    The signal of position and heading is their spread, as their zero is arbitrary; that of the others their rms.
    """
    names = [name for name in recorded(trial) if np.ptp(trial[name].values) > 0.0 and trial.sizes["time"] >= 10]
    if not names:
        return not_checked("noise", "no channel that changes, or fewer than 10 samples")
    sd = second_difference_sd(np.array([trial[name].values for name in names], dtype=float))
    values = [trial[name].values - (trial[name].values.mean() if name in _ANY_ZERO else 0.0) for name in names]
    spread = np.sqrt(np.maximum(np.mean(np.square(values), axis=1) - sd**2, 1e-6 * sd**2))
    ratios = (sd / np.maximum(spread, np.finfo(float).tiny)).tolist()
    if {"p", "phi"} <= set(names):  # the roll angle shows the roll, whose rate is nothing in a steady turn
        ratios[names.index("p")] = 0.0
    units = [trial[name].attrs.get("units", "") for name in names]
    numbers = tuple((f"sd {name}", s, unit) for name, s, unit in zip(names, sd.tolist(), units, strict=True))
    largest = max(ratios)
    worst = names[ratios.index(largest)]
    numbers += ((f"noise over signal, {worst}", largest, ""),)
    text = f"The noise is at most {largest:.2g} of the signal ({worst})."
    if largest > NOISE_BAD:
        return Check("noise", "bad", f"{text} That channel is noise; leave it out or mend the sensor.", numbers)
    if largest > NOISE_DOUBTFUL:
        return Check("noise", "doubtful", f"{text} Denoise it, and steer harder.", numbers)
    return Check("noise", "good", text, numbers)


def resolution_check(trial: xr.Dataset) -> Check:
    """Distinct values of the motion channels, which rounding makes few."""
    counts = {name: np.unique(trial[name].values).size for name in recorded(trial, STATE)}
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


def sign_check(trial: xr.Dataset) -> Check:
    """Channels to one side while another one, which goes with them, changes from side to side."""
    pairs = [(name, other) for name, other in UNSIGNED.items() if {name, other} <= set(trial)]
    if not pairs:
        return not_checked("signs", "no two of v, r and delta in the record")
    channels = {name: trial[name].values for pair in pairs for name in pair}
    lost = [
        name for name, other in pairs if _has_lost_its_sign(channels[name], channels[other], drifts=name != "delta")
    ]
    if lost:
        if lost[0] == "delta" and (middle := rudder_middle(trial)):
            return Check("signs", "bad", f"{raw_signal_text(middle)}; find the column of the angle, or calibrate it.")
        text = f"{lost[0]} stays on one side while the ship turns to both: its sign is lost; find the signed column."
        return Check("signs", "bad", text)
    return Check("signs", "good", f"{', '.join(name for name, _ in pairs)} change sign together, or not at all.")


def _has_lost_its_sign(values: np.ndarray, other: np.ndarray, *, drifts: bool) -> bool:
    """Whether values stay on one side while others change; those that drift in wind must go with their magnitude."""
    if np.ptp(values) == 0.0 or balance(values, 0.0) >= ONE_SIDED or balance(other, 0.1) <= BOTH_SIDES:
        return False
    if not drifts:
        return True
    signed, unsigned = np.corrcoef(np.array([values, other, np.abs(other)]))[0, 1:]
    return bool(abs(unsigned) > abs(signed))


def stand_ins(trial: xr.Dataset, name: str) -> dict[str, np.ndarray]:
    """Cells of a channel that a stand-in fills, by its number and unit in the file."""
    values, unit = trial[name].values.astype(float), CHANNELS[name].unit
    largest, found = float(np.abs(values).max()), {}
    flipped = f"{name} changed in sign" in trial.attrs.get("reading", "")
    for factor, spelling in {factor: text for text, factor in reversed(list(unit.spellings.items()))}.items():
        for number in (*MISSING_CODES.get(unit.name, ()), *MISSING_CODES[""]):
            if number * factor > 1.001 * largest:
                continue
            cells = np.abs(np.abs(values) - number * factor) < 1e-6 * number * factor
            if cells.any() and not cells.all() and (standing_out(values, cells) == cells).all():
                sign = -1.0 if (values[cells][0] < 0.0) != flipped else 1.0
                found[f"{sign * number:g} {spelling}"] = cells
    return found


def stand_in_check(trial: xr.Dataset) -> Check:
    """Cells of each channel that hold a number for "not available"."""
    cells = {(name, number): mask for name in recorded(trial) for number, mask in stand_ins(trial, name).items()}
    if not cells:
        return Check("stand-ins", "good", "No cell has a number that stands for a missing one.")
    numbers = tuple((f"{number}, {name}", float(mask.sum()), "") for (name, number), mask in cells.items())
    notes = ", ".join(f"{number} in {mask.sum()} cells of {name}" for (name, number), mask in cells.items())
    marks = ", ".join(f"{name} = {{ ..., missing = {number.split()[0]} }}" for name, number in cells)
    text = f"Probably missing: {notes}; mark them in the format, {marks} (the other checks are made without them)."
    return Check("stand-ins", "bad", text, numbers, mendable=True)


def without_stand_ins(trial: xr.Dataset) -> xr.Dataset:
    """Trial whose stand-ins are replaced by straight lines between their neighbours."""
    masks = {name: list(stand_ins(trial, name).values()) for name in recorded(trial)}
    return _interpolated(trial, {name: np.flatnonzero(np.any(mask, axis=0)) for name, mask in masks.items() if mask})


def _interpolated(trial: xr.Dataset, cells: dict[str, np.ndarray]) -> xr.Dataset:
    """Trial with straight lines between the neighbours of some cells of each channel."""
    mended = trial.copy()
    for name, bad in cells.items():
        values, smooth = _continuous(trial, name), trial[name].values + 0.0
        good = np.setdiff1d(np.arange(values.size), bad)
        smooth[bad] += np.interp(bad, good, values[good]) - values[bad]
        mended[name] = ("time", smooth, trial[name].attrs)
    return mended


def spikes(values: np.ndarray) -> np.ndarray:
    """Indices of isolated samples (one or two in a row) beyond their surroundings, see :data:`SPIKE`."""
    if values.size < 4 * _HALF_WINDOW:
        return np.empty(0, dtype=int)
    away = values - scipy.ndimage.median_filter(values, 2 * _HALF_WINDOW + 1, mode="nearest")
    low, high = np.quantile(values, [0.001, 0.999])
    sd = np.maximum(
        second_difference_sd(values[None])[0], scipy.ndimage.median_filter(np.abs(away), _SURROUNDINGS) / 0.6745
    )
    limit = np.maximum(SPIKE * sd, LEAST_SPIKE * (high - low))
    out = np.flatnonzero((np.abs(away) > limit) & (limit > 0.0))
    found: list[int] = []
    for group in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1):
        if 0 < group.size <= _LONGEST_SPIKE:
            sides = values[[k for k in (group[0] - 1, group[-1] + 1) if 0 <= k < values.size]]
            steps = values[group][:, None] - sides
            least = limit[group][:, None]
            if (steps > least).all() or (steps < -least).all():
                found.extend(group)
    return np.array(found, dtype=int)


def spike_check(trial: xr.Dataset) -> Check:
    """Spikes of every channel."""
    counts = {name: spikes(_continuous(trial, name)).size for name in recorded(trial)}
    numbers = tuple((f"spikes, {name}", float(count), "") for name, count in counts.items())
    if not any(counts.values()):
        return Check("spikes", "good", "No channel has spikes.", numbers)
    notes = ", ".join(f"{count} on {name}" for name, count in counts.items() if count)
    if max(counts.values()) > 0.02 * trial.sizes["time"]:
        text = f"Spikes: {notes}, more than 2 % of the samples; mend the sensor or leave the channel out."
        return Check("spikes", "bad", text, numbers)
    text = f"Spikes: {notes}; replace them by interpolation (the other checks are made without them)."
    return Check("spikes", "doubtful", text, numbers, mendable=True)


def without_spikes(trial: xr.Dataset) -> xr.Dataset:
    """Trial whose spikes are replaced by straight lines between their neighbours."""
    bad = {name: spikes(_continuous(trial, name)) for name in recorded(trial)}
    return _interpolated(trial, {name: cells for name, cells in bad.items() if cells.size})


def jump_check(trial: xr.Dataset, scale: ShipScale) -> Check:
    """Changes between two samples that no ship can make."""
    found = {name: jumps(trial, name, scale) for name in recorded(trial)}
    found = {
        name: sizes for name, sizes in found.items() if 0 < len(sizes) <= max(1.0, _MOST_JUMPS * trial.sizes["time"])
    }
    numbers = tuple((f"jumps, {name}", float(len(sizes)), "") for name, sizes in found.items())
    if not found:
        return Check("jumps", "good", "No channel jumps.")
    time, worst = trial["time"].values, {name: max(sizes, key=lambda k: abs(sizes[k])) for name, sizes in found.items()}
    texts = []
    for name, k in worst.items():
        unit = CHANNELS[name].unit
        texts.append(f"{name} by {unit.display_factor * abs(found[name][k]):.3g} {unit.display} at {time[k]:.4g} s")
    together = max(sum(abs(k - other) < _LONGEST_SPIKE for other in worst.values()) for k in worst.values())
    text = f"Jumps of {', '.join(texts)}, more than a ship can change between two samples; "
    text += "two runs in one file? Split it." if together >= TOGETHER else "mend the sensor, or cut the record there."
    unsure = ("x", "y", "delta") if "delta" in worst and _is_order(trial, worst["delta"]) else ("x", "y")
    text += " Or delta is the ordered angle." if "delta" in unsure else ""
    large = (abs(found[k][m]) > BAD_JUMP * _range(trial, k) for k, m in worst.items() if k not in unsure)
    return Check("jumps", "bad" if together >= TOGETHER or any(large) else "doubtful", text, numbers)


def _is_order(trial: xr.Dataset, before: int) -> bool:
    """Whether a jump of the rudder is its last move and away from amidships, as the order of a turning circle."""
    delta = trial["delta"].values[before:]
    delta = delta[np.flatnonzero(np.diff(delta))[0] :]  # a reading may be held until the jump
    return bool(np.ptp(delta[1:]) < _STILL * abs(delta[1] - delta[0]) and abs(delta[1]) > abs(delta[0]))


def jumps(trial: xr.Dataset, name: str, scale: ShipScale) -> dict[int, float]:
    """Changes of a channel to the next sample that stand out from those around them, by the sample before."""
    values = _continuous(trial, name)
    moved = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    kept = moved if moved.size < 0.5 * values.size else np.arange(values.size)  # a held reading is one
    if kept.size < _FEWEST_READINGS:
        return {}
    steps = np.diff(values[kept])
    padded = np.pad(steps, 2, mode="reflect")
    least = LEAST_JUMPS[name] if name in LEAST_JUMPS else LEAST_JUMP * _range(trial, name)
    least *= scale.L if name in ("x", "y") else 1.0
    if name == "delta":
        rate, samples = rudder_rate(trial)
        least = max(least, ABRUPT * np.deg2rad(rate) * sampling_interval(trial)) if samples > _ABRUPT_MOVE else np.inf
    least = max(least, NOISY * second_difference_sd(values[None])[0])
    least = max(least, ABRUPT * float(np.quantile(np.abs(np.diff(steps)), 1.0 - 2.0 * _MOST_JUMPS)))
    found = {}
    for k in np.flatnonzero(np.maximum(np.abs(steps - padded[1:-3]), np.abs(steps - padded[3:-1])) > least):
        around = padded[[k, k + 1, k + 3, k + 4]]
        excess = steps[k] - np.median(around)
        scatter = np.sort(np.abs(around - np.median(around)))[-2]  # one of the four may be another jump
        if abs(excess) > max(least, ABRUPT * scatter):
            found[int(kept[k])] = float(excess)
    return found


def _range(trial: xr.Dataset, name: str) -> float:
    return float(np.ptp(np.quantile(_continuous(trial, name), [0.01, 0.99])))


def _continuous(trial: xr.Dataset, name: str) -> np.ndarray:
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
    names = recorded(trial, STATE)
    stuck = [name for name in names if np.ptp(trial[name].values) == 0.0]
    if stuck:
        text = f"{', '.join(stuck)} never change{'s' if len(stuck) == 1 else ''}; find the right column or the sensor."
        return Check("frozen channels", "bad", text, tuple((f"frozen, {name}", np.inf, "s") for name in stuck))
    interval = sampling_interval(trial)
    if duration := interval * _rudder_at_rest(trial, scale.time / interval):
        text = f"delta stands still for {duration:.3g} s while the ship begins a turn and ends it: the "
        text += "rudder indicator is stuck; cut that part out."
        return Check("frozen channels", "bad", text, (("frozen, delta", duration, "s"),))
    runs = {name: _longest_frozen(trial, name, names, scale.time / interval) for name in names}
    longest = {name: interval * (run.stop - run.start) for name, run in runs.items()}
    numbers = tuple((f"frozen, {name}", duration, "s") for name, duration in longest.items() if duration > 0.0)
    if not numbers:
        return Check("frozen channels", "good", "No channel stands still while the ship moves.")
    worst = max(longest, key=longest.__getitem__)
    verdict = "bad" if longest[worst] > scale.time else "doubtful"
    size, lasting = np.abs(trial[worst].values), f"for {longest[worst]:.3g} s while the ship moves"
    text = f"{worst} stands still {lasting}; cut that part out or mend the sensor."
    if size[runs[worst].start] == size.max():
        text = f"{worst} stays at its largest value {lasting}: it is clipped at the range of its sensor, or stuck; "
        text += "leave it out."
    return Check("frozen channels", verdict, text, numbers)


def without_still_channels(trial: xr.Dataset, check: Check) -> xr.Dataset:
    """Trial for later checks: without channels that stand still for half of it, which are a finding of their own."""
    half = 0.5 * float(np.ptp(trial["time"].values))
    numbers = {name: value for name, value, _ in check.numbers}
    still = [name for name in ("u", "v", "r", "psi", "x", "y") if numbers.get(f"frozen, {name}", 0.0) > half]
    return trial.drop_vars(still).assign_attrs(still_channels=still)


def _longest_frozen(trial: xr.Dataset, name: str, names: list[str], ship_time: float) -> slice:
    """Longest run of equal values, in samples, during which another velocity changes by 5 % of its range."""
    edges = np.flatnonzero(np.diff(trial[name].values, prepend=np.nan, append=np.nan) != 0.0)
    rounded = edges.size < ROUNDED * (trial.sizes["time"] - np.diff(edges).max())
    least = max(10, round(ship_time * (1.0 if rounded else FROZEN)))
    longest = slice(0, 0)
    others = [trial[other].values for other in names if other in STATE[:3] and other != name]
    for run in np.flatnonzero(np.diff(edges) >= least):
        start, stop = edges[run], edges[run + 1]
        # means of five parts, so that noise is not taken for motion
        parts = ([part.mean() for part in np.array_split(values[start:stop], 5)] for values in others)
        moving = any(np.ptp(means) > 0.05 * np.ptp(values) for means, values in zip(parts, others, strict=True))
        moving &= not _along_the_other_axis(trial.isel(time=slice(start, stop)), name)
        if moving and stop - start > longest.stop - longest.start:
            longest = slice(int(start), int(stop))
    return longest


def _rudder_at_rest(trial: xr.Dataset, ship_time: float) -> int:
    """Samples of the longest fixed rudder angle at which the ship begins a turn and ends it; 0 without one."""
    if not {"delta", "r", "u"} <= set(trial):
        return 0
    delta, u = trial["delta"].values, trial["u"].values
    rate = scipy.ndimage.uniform_filter1d(trial["r"].values.astype(float), max(round(FROZEN * ship_time), 1))
    turning = rate / np.maximum(u, max(SLOW * float(np.quantile(u, 0.95)), np.finfo(float).tiny))
    turning = turning / max(float(np.quantile(np.abs(turning), 0.99)), np.finfo(float).tiny)
    longest = 0
    for hold in pieces(np.diff(delta) == 0.0):
        fixed = turning[hold.start : hold.stop + 1]
        if fixed.size < _SHORTEST_HOLD or abs(delta[hold.start]) <= DEFLECTED:
            continue
        side = np.sign(fixed) * (np.abs(fixed) > BEGUN)
        begun = np.flatnonzero((side != 0.0) & (side != side[0]))
        if begun.size and (np.abs(fixed[begun[0] :]) < ENDED).any():
            longest = max(longest, fixed.size)
    return longest


def _along_the_other_axis(trial: xr.Dataset, name: str) -> bool:
    """Whether a coordinate stays as it is because the ship heads along the other one."""
    if name not in ("x", "y") or "psi" not in trial:
        return False
    part = np.cos(trial["psi"].values) if name == "x" else np.sin(trial["psi"].values)
    return float(np.abs(part).max()) < ALONG


def gap_check(trial: xr.Dataset) -> Check:
    """Gaps and missing cells from the notes of the reading, ``attrs["reading"]``, a line for each."""
    notes = trial.attrs.get("reading")
    if notes is None:
        return not_checked("gaps", "the record has no notes of its reading")
    gaps = [line for line in notes.splitlines() if any(words in line.lower() for words in _LOST)]
    lost = float(trial.attrs.get("rows_lost", 0.0))
    numbers = (("remarks", float(len(gaps)), ""), ("rows left out over rows", lost, ""))
    if lost >= LOST_DOUBTFUL:
        verdict, text = "bad" if lost >= LOST_BAD else "doubtful", " ".join(gaps or notes.splitlines()[-1:])
        return Check("gaps", verdict, f"{lost:.0%} of the rows are left out. {text} Mend or split the file.", numbers)
    if not gaps:
        return Check("gaps", "good", "The file has no gap.", numbers)
    return Check("gaps", "doubtful", f"{' '.join(gaps)} Look at these places before a fit.", numbers)
