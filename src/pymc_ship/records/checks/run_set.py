"""Runs of one ship against each other: a motion given twice, a run cut in two, and one that contradicts the others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
import scipy
import xarray as xr

from pymc_ship.records.checks.mistakes import SIGNS, corrected_by
from pymc_ship.records.checks.plausibility import DRIFT
from pymc_ship.records.checks.verdicts import SLOW
from pymc_ship.records.files.ship_scale import SIGNIFICANT, Blocks
from pymc_ship.trial.quality_flags import quality_flags, worst_verdict
from pymc_ship.trial.record import Channels, sampling_interval, second_difference_sd

SAME = 0.02  # rms difference over the standard deviation of a channel below which, beside noise, motions are the same
CONTRADICTS = 2.4  # error of a forecast over the usual one; 1 in 200 sets of runs of one ship has more
OUTLIER_RATIO = 1.5  # ratio of the largest errors without another run and without the outlier, from which it is one
LAW_ERROR = 0.15  # of the law over the size of its terms; a regression of six ships leaves 0.07 to 0.16 of the sway
_CORRELATED = np.sqrt(5.0)  # blocks per independent one
_BLOCK, _FEWEST = 0.25, 20  # L/U; blocks of a comparison
_PRIOR_MEAN = np.array([[0.2, 0.0, -0.5, -0.4, -3.0, 0.0, 0.0], [-1.2, 0.0, -3.0, -1.5, 10.0, -1.0, 0.0]])
_PRIOR_SD = np.array([[0.2, 0.2, 1.0, 0.5, 5.0, 1.5, 0.05], [0.8, 0.8, 3.0, 2.0, 15.0, 3.0, 0.1]])
"""Mean and sd of the coefficients of sway and yaw, wider than those of the six shipped vessels."""
_CHANNELS = ("r", "delta")  # two runs of one manoeuvre differ in the times of the rudder
_STEPS = 8  # of the least-squares shift and rate of a clock
_ONE_NOISE, _FEWEST_SAMPLES = 0.7, 100  # correlation of the noise of copies, five sd of that of so many samples
_WHITE = -0.3  # correlation of neighbours among second differences, -2/3 of noise and 1 of a signal, below which noise
_ROUNDING = 1e-6
_STATE = ("psi", "u", "v", "r")  # channels that go on at the cut of a run
_TURNING = 0.1  # of the largest yaw rate, at a cut


def run_set_flags(trials: Mapping[str, xr.Dataset], L: float) -> dict[str, str]:
    """:func:`.quality_flags` of trials by name, with the sentences on the trials as runs of one ship of length L."""
    flags = quality_flags(list(trials.values()), list(trials) if len(trials) > 1 else ())
    sentences = [*repeated_runs(trials), *contradicting_runs(trials, L)]
    if not sentences:
        return flags
    remarks = "\n".join(filter(None, [flags["record_remarks"], *sentences]))
    return {"record_verdict": worst_verdict([flags["record_verdict"], "doubtful"]), "record_remarks": remarks}


def repeated_runs(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentences on pairs of runs, by name, of one motion: the same but for noise and the clock, or mirrored.

    Two runs of a symmetric ship to either side are mirror images, too, but each has its own noise.
    """
    pairs = combinations(trials.items(), 2)
    texts = {(one, other): _of_one_motion(first, second) for (one, first), (other, second) in pairs}
    return [f"Runs {one} and {other} are {text}; leave one out." for (one, other), text in texts.items() if text]


def _of_one_motion(first: xr.Dataset, second: xr.Dataset) -> str:
    """Words on two runs of one motion; empty for others."""
    shift, side = _shift_of_same_motion(first, second), _side_of_copy(first, second)
    if side < 0:
        return "mirror images with one noise: one is a copy with port for starboard, and shows a symmetry of its own"
    if shift is None and not side:
        return ""
    is_apart = shift is not None and abs(shift) > max(map(sampling_interval, (first, second)))
    apart = f", {abs(shift):.3g} s apart" if shift is not None and is_apart else ""
    text = f"the same motion but for noise{apart}: one run, or one by two loggers"
    return f"{text}, counts twice and the intervals are too narrow"


def cut_runs(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentences on runs, by name, of which one begins in the middle of a turn in which another ends."""
    return [
        f"Run {other} goes on with run {one}, cut in a turn: both have one weather and loading, and a forecast of one "
        "by the other seems too good; give them as one file."
        for one, other in permutations(trials, 2)
        if _goes_on(trials[one], trials[other])
    ]


def _side_of_copy(first: xr.Dataset, second: xr.Dataset) -> int:
    """1 for a yaw rate that is a copy of another, noise included, -1 for a mirrored copy, 0 for none.

    Unit, offset and clock of the copy are free, and so is the rudder.
    """
    if "r" not in first or "r" not in second:
        return 0
    one, other = first["r"].values, second["r"].values
    noise = [_noise(values) for values in (one, other)]
    if not all(values.any() for values in noise):
        return 0
    product = np.abs(scipy.signal.correlate(noise[1], noise[0], mode="full", method="fft"))
    lag = int(np.argmax(product)) + 1 - noise[0].size
    begin, end = max(0, -lag), min(noise[0].size, noise[1].size - lag)
    if end - begin < _FEWEST_SAMPLES:
        return 0
    same_noise, motion = (
        np.corrcoef(values[begin:end], others[begin + lag : end + lag])[0, 1]
        for values, others in (noise, (one, other))
    )
    pair = [values - values.mean() for values in (one[begin:end], other[begin + lag : end + lag])]
    left = pair[1] - (pair[0] @ pair[1]) / (pair[0] @ pair[0]) * pair[0]
    least = 0.5 * left.std() - _ROUNDING * pair[1].std()
    is_noise = second_difference_sd(left[None])[0] >= least  # not the difference of two motions
    is_copy = same_noise * motion > 0.0 and min(abs(same_noise), abs(motion)) > _ONE_NOISE and is_noise
    return int(np.sign(motion)) if is_copy else 0


def _noise(values: np.ndarray) -> np.ndarray:
    """Second differences, clipped at three robust standard deviations; 0 where they are the signal."""
    differences = np.diff(values, 2)
    limit = 3.0 * np.sqrt(6.0) * second_difference_sd(values[None])[0]
    clipped = np.clip(differences, -limit, limit)
    return clipped if clipped[1:] @ clipped[:-1] < _WHITE * (clipped @ clipped) else 0.0 * clipped


def _goes_on(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Whether a turn that the end of a run breaks off goes on at the beginning of another, in every channel."""
    step = sampling_interval(first)
    if not {*_STATE} <= {*first} & {*second} or abs(sampling_interval(second) / step - 1.0) > SAME:
        return False
    ends = np.array([np.r_[first[name].values[-2:], second[name].values[:2]] for name in _STATE])
    ends[0] = np.unwrap(ends[0])
    sd = np.array([np.std(np.diff(first[name].values, 2)) for name in _STATE])
    turns = abs(ends[-1].mean()) > max(_TURNING * float(np.abs(first["r"].values).max()), SIGNIFICANT * sd[-1])
    return bool(turns and (np.abs(np.diff(ends, 2)) <= SIGNIFICANT * sd[:, None]).all())


def _shift_of_same_motion(first: xr.Dataset, second: xr.Dataset) -> float | None:
    """Time [s] by which the second run is later, if half of the shorter run or more is of one motion; else None.

    The rudder is compared up to a zero, a sign and a range.
    """
    if not set(_CHANNELS) <= {*first} & {*second}:
        return None
    step = max(sampling_interval(first), sampling_interval(second))
    one, other = (_resampled(trial, step) for trial in (first, second))
    shift, here, there = _on_one_clock(one, other)
    here[1], there[1] = (values - values.mean() for values in (here[1], there[1]))
    there[1] *= (here[1] @ there[1]) / max(there[1] @ there[1], np.finfo(float).tiny)  # zero and range of an indicator
    sd = np.maximum(one.std(axis=1), other.std(axis=1))
    noise = np.hypot(second_difference_sd(one), second_difference_sd(other))
    if (np.sqrt(np.mean((there - here) ** 2, axis=1)) > 1.5 * noise + SAME * sd).any():
        return None
    return shift * step + float(second["time"].values[0] - first["time"].values[0])


def _on_one_clock(one: np.ndarray, other: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Shift in samples of a second run, and the overlap of both (n_channels, n) with the yaw rates nearest.

    Least squares of the shift and of the rate of the clock, which is within :data:`SAME` of 1.
    """
    lag = _closest_lag(one[0], other[0])
    k, index = np.arange(one.shape[1]), np.arange(other.shape[1])
    shift, rate = float(lag), 1.0
    for _ in range(_STEPS):
        at = shift + rate * k
        inside = (at >= 0.0) & (at <= index[-1])
        moved = np.array([np.interp(at[inside], index, values) for values in other])
        slope = np.interp(at[inside], index, np.gradient(other[0]))
        later, faster = np.linalg.lstsq(np.column_stack([slope, slope * k[inside]]), one[0, inside] - moved[0])[0]
        shift = float(np.clip(shift + later, lag - 1.0 - SAME * k.size, lag + 1.0 + SAME * k.size))
        rate = float(np.clip(rate + faster, 1.0 - SAME, 1.0 + SAME))
    return shift, one[:, inside], moved


def _closest_lag(one: np.ndarray, other: np.ndarray) -> int:
    """Lag in samples at which other[k + lag] is nearest to one[k] in the mean square, of overlaps of half a run."""
    lags = np.arange(1 - one.size, other.size)
    begin, end = np.maximum(0, -lags), np.minimum(one.size, other.size - lags)  # of the overlap, in the first
    energy = [np.append(0.0, np.cumsum(values**2)) for values in (one, other)]
    square = energy[0][end] - energy[0][begin] + energy[1][end + lags] - energy[1][begin + lags]
    square -= 2.0 * scipy.signal.correlate(other, one, mode="full", method="fft")
    enough = end - begin >= 0.5 * min(one.size, other.size)
    return int(lags[np.argmin(np.where(enough, square / np.maximum(end - begin, 1), np.inf))])


def _resampled(trial: xr.Dataset, step: float) -> np.ndarray:
    """Channels at even steps, shape (n_channels, n_time)."""
    time = trial["time"].values
    at = np.arange(time[0], time[-1] + 0.5 * step, step)
    return np.array([np.interp(at, time, trial[name].values) for name in _CHANNELS])


@dataclass(frozen=True)
class _Response:
    """Block means with the ship ahead: regressors (n_blocks, 7), prime accelerations of sway and yaw (n_blocks, 2)."""

    regressors: np.ndarray
    accelerations: np.ndarray


def contradicting_runs(trials: Mapping[str, xr.Dataset], L: float) -> list[str]:
    """Sentence on the run, by name, that contradicts all others, or on runs that contradict each other.

    A regression of the prime accelerations of sway and yaw on all others forecasts those of each run.
    """
    responses = {name: row for name, trial in trials.items() if (row := _response(trial, L)) is not None}
    worst = _worst(responses)
    if worst <= CONTRADICTS:
        return []
    rest = {name: _worst(_without(name, responses)) for name in responses}
    name, second = sorted(rest, key=lambda name: rest[name])[:2]
    if rest[name] > CONTRADICTS or rest[second] <= OUTLIER_RATIO * rest[name]:
        among = [one for one in rest if rest[one] <= CONTRADICTS] or rest
        return [
            f"Runs {', '.join(among)} contradict each other: no single law of sway and yaw describes them. "
            "They may be of two ships or loadings, or a channel of one is wrong; compare particulars, units and signs."
        ]
    others = list(_without(name, responses).values())
    signs = [
        f"{one.words}: state {one.key}"
        for (one,), mended in corrected_by(trials[name], ("delta", "v", "r"), 1)
        if one in SIGNS and (row := _response(mended, L)) is not None and _error(row, others) <= 1.0
    ]
    cause = f"Most probably {signs[0]}" if signs else "It may be of another ship, loading or scale: leave it out"
    return [
        f"Run {name} contradicts the other runs: they forecast its accelerations of sway and yaw with "
        f"{_error(responses[name], others):.2g} times the usual error (up to {CONTRADICTS:g} in runs of one ship). "
        f"{cause}."
    ]


def _without(name: str, responses: Mapping[str, _Response]) -> dict[str, _Response]:
    return {other: response for other, response in responses.items() if other != name}


def _worst(responses: Mapping[str, _Response]) -> float:
    """Largest error of a run as forecast by the others."""
    return max((_error(responses[name], list(_without(name, responses).values())) for name in responses), default=0.0)


def _response(trial: Channels, L: float) -> _Response | None:
    """Response of a run; None without its channels or with too few blocks."""
    if not trial.keys() >= {"u", "v", "r", "delta"}:
        return None
    speed = np.hypot(trial["u"].values, trial["v"].values)
    if not (usual := float(np.median(speed))) > 0.0:
        return None
    blocks = Blocks(max(1, round(_BLOCK * L / usual / sampling_interval(trial))))
    if trial["time"].size < _FEWEST * blocks.size:
        return None
    u, v, r, delta = (blocks.middles(trial[name].values) for name in ("u", "v", "r", "delta"))
    U, fast = np.hypot(u, v), float(np.quantile(speed, 0.95))
    ahead = (u > SLOW * fast) & (np.abs(v) < DRIFT * U)
    time = blocks.increments(trial["time"].values) * U / L
    v_dot, r_dot = (blocks.increments(trial[name].values) / time for name in ("v", "r"))
    v, r, loading = v / U, r * L / U, (fast / U) ** 2 - 1.0  # of the propeller, which blows at the rudder
    regressors = np.column_stack([delta, delta * loading, v, r, v * np.abs(v), r * np.abs(r), np.ones(r.size)])
    if ahead.sum() < _FEWEST:
        return None
    return _Response(regressors[ahead], np.column_stack([v_dot / U, r_dot * L / U])[ahead])


def _error(run: _Response, others: Sequence[_Response]) -> float:
    """Root mean square error of a run's accelerations over the usual one, the larger of sway and yaw; 0 for no others.

    The usual one has the scatter of the regressions, a relative error of the law and the error of the coefficients.
    """
    if not others:
        return 0.0
    errors = []
    for run_rows, rows, mean, sd in zip(_rows([run]), _rows(others), _PRIOR_MEAN, _PRIOR_SD, strict=True):
        scatter = max(_scatter(*run_rows), _scatter(*rows))
        (X, measured), (others_X, response) = run_rows, rows
        noise = _CORRELATED * np.hypot(scatter, LAW_ERROR * _size(*rows, np.linalg.lstsq(others_X, response)[0]))
        covariance = np.linalg.inv(others_X.T @ others_X / noise**2 + np.diag(1.0 / sd**2))
        coefficients = covariance @ (others_X.T @ response / noise**2 + mean / sd**2)
        variance = np.einsum("ij,jk,ik->i", X, covariance, X) + scatter**2
        variance += (LAW_ERROR * _size(X, measured, coefficients)) ** 2
        errors.append(float(np.sqrt(np.mean((measured - X @ coefficients) ** 2 / variance))))
    return max(errors)


def _rows(runs: Sequence[_Response]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Regressors and accelerations of some runs, of sway and of yaw."""
    X = np.vstack([run.regressors for run in runs])
    return [(X, column) for column in np.vstack([run.accelerations for run in runs]).T]


def _scatter(X: np.ndarray, response: np.ndarray) -> float:
    """What a regression leaves, rms."""
    return float(np.std(response - X @ np.linalg.lstsq(X, response)[0]))


def _size(X: np.ndarray, response: np.ndarray, coefficients: np.ndarray) -> float:
    """Size of an acceleration and of the part by the rudder, which other forces balance in a steady turn, rms."""
    return float(np.sqrt(np.mean(response**2) + np.mean((X[:, :2] @ coefficients[:2]) ** 2)))
