"""Known mistakes of a record as data, and which of them explains a disagreement of its channels.

A mistake is an entry of :data:`MISTAKES`: its words, its correction and the format key that mends the file. An
explanation tries every entry of the channels in question, and every pair, and judges the record that each one leaves.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray as xr

from pymc_ship.records.checks.verdicts import integral
from pymc_ship.records.files.columns import CODES
from pymc_ship.trial.record import Channels, sampling_interval, second_difference_sd, unwrapped
from pymc_ship.trial.units import KNOT

BETTER, PAIR = 2.0, 2.0  # ratio of misfits from which a mistake explains a record, and a pair a single one's
EXPLAINED = 0.2  # largest misfit over its signal of a record that is explained
UNEXPLAINED = "no known mistake, or pair, explains it"
_AS_NEAR = 0.02  # difference of logarithms up to which two units explain a speed alike
_TOP, _NOISE = 0.99, 5.0  # quantile of |r|, and sd of its noise below that, of a clipped r
_MATCHES = 0.1  # scale error of the rest of it
_DEG = np.pi / 180.0

Mend = Callable[[Channels], Channels]


@dataclass(frozen=True)
class Mistake:
    """A known mistake of some channels: its words, the correction of a trial and the format key that has it read.

    ``remedy`` is what to do where no key mends a file; a ``gradual`` one spoils a rate a little, and in part only.
    """

    channels: str
    words: str
    mend: Mend
    key: str = ""
    remedy: str = ""
    gradual: bool = False


def changed(trial: xr.Dataset, **channels: np.ndarray) -> xr.Dataset:
    """Trial with other values of some channels."""
    return trial.assign({name: ("time", values, trial[name].attrs) for name, values in channels.items()})


def _mended(trial: Channels, **channels: np.ndarray) -> Channels:
    return {**trial, **{name: xr.Variable("time", values) for name, values in channels.items()}}


def _scaled(trial: Channels, names: str, factor: float) -> Channels:
    return _mended(trial, **{name: factor * trial[name].values for name in names.split()})


def _wrong_unit(name: str, unit: str, factor: float, converted: str = "") -> Mistake:
    words = f"{name} is {unit} that was converted as {converted}" if converted else f"{name} is in {unit}"
    return Mistake(name, words, partial(_scaled, names=name, factor=factor), f'unit = "{unit}"')


def _reversed(name: str, key: str = "sign = -1") -> Mistake:
    return Mistake(name, f"{name} has the opposite sign", partial(_scaled, names=name, factor=-1.0), key)


def _exchanged(one: str, other: str) -> Mistake:
    return Mistake(
        f"{one} {other}",
        f"{one} and {other} are swapped",
        lambda trial: _mended(trial, **{one: trial[other].values, other: trial[one].values}),
        f"exchange the columns of {one} and {other}",
    )


def _heading_residual_slope(trial: Channels, extra: np.ndarray) -> float:
    """Slope of the heading less the integral of r on a column, beside a constant and a trend."""
    time = trial["time"].values - trial["time"].values[0]
    turned = integral(trial["r"].values, sampling_interval(trial))
    alone = _detrended(extra, time)
    return float(alone @ (unwrapped(trial["psi"].values) - turned) / max(alone @ alone, np.finfo(float).tiny))


def _detrended(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Values less their mean and trend."""
    values, time = values - values.mean(), time - time.mean()
    return values - (time @ values) / (time @ time) * time


def _in_time(trial: Channels, name: str) -> Channels:
    """Trial whose r or psi is moved forward by its lag behind the other; unchanged where it is not late."""
    if not trial.keys() >= {"r", "psi"}:
        return trial
    time, lag = trial["time"].values, 0.0
    for _ in range(3):
        moved = _mended(trial, **{name: np.interp(time + lag, time, trial[name].values)})
        lag += (1.0 if name == "r" else -1.0) * _heading_residual_slope(moved, moved["r"].values)
    return moved if lag > 0.0 else trial


def _unclipped(trial: Channels) -> Channels:
    """Trial whose r is the slope of psi where it has its largest size; unchanged where the rest does not match psi."""
    if not trial.keys() >= {"r", "psi"}:
        return trial
    r, slope = trial["r"].values, np.gradient(unwrapped(trial["psi"].values), sampling_interval(trial))
    clipped = np.abs(r) >= np.quantile(np.abs(r), _TOP) - _NOISE * float(second_difference_sd(r[None])[0])
    rest = np.where(clipped, 0.0, r)
    if abs(rest @ slope - rest @ rest) > _MATCHES * (rest @ rest):
        return trial
    return _mended(trial, r=np.where(clipped, slope, r))


def _without_drift(trial: Channels) -> Channels:
    """Trial without the linear drift of the offset of r against psi."""
    if not trial.keys() >= {"r", "psi"}:
        return trial
    time = trial["time"].values - trial["time"].values[0]
    return _mended(trial, r=trial["r"].values + 2.0 * _heading_residual_slope(trial, time**2) * time)


def _without_drift_angle(trial: Channels) -> Channels:
    """Trial whose psi is a heading, where it was the course over ground; unchanged without velocities."""
    if not trial.keys() >= {"u", "v", "psi"}:
        return trial
    return _mended(trial, psi=trial["psi"].values - np.arctan2(trial["v"].values, trial["u"].values))


SPEED_UNITS = {
    KNOT: ("knots taken for m/s", 'unit = "kn"'),
    1.0 / 3.6: ("km/h taken for m/s", 'unit = "km/h"'),
    0.3048: ("ft/s taken for m/s", 'unit = "ft/s"'),
    1.0 / KNOT: ("m/s that were converted as knots, or a track in nautical units", 'unit = "m/s"'),
    3.6: ("m/s that were converted as km/h", 'unit = "m/s"'),
    1.0 / (3.6 * KNOT): ("km/h that were converted as knots", 'unit = "km/h"'),
    3.6 * KNOT: ("knots that were converted as km/h", 'unit = "kn"'),
    0.001: ("mm/s taken for m/s, or a track in km", 'unit = "km" for x and y'),
    0.1 * KNOT: ("tenths of a knot taken for m/s", 'unit = "kn" of a tenth of the cells'),
    1.0 / 0.3048: ("m/s that were converted as ft/s, or a track in feet", 'unit = "ft" for x and y'),
    1.0 / 1852.0: ("1852 times too large, or a track in nautical miles", 'unit = "nmi" for x and y'),
    1000.0: ("km/s taken for m/s, or a track in mm", 'unit = "mm" for x and y'),
}
"""Factor that a wrong speed lacks, its words and its key."""


def speed_units(factor: float, width: float) -> tuple[str, str]:
    """Words and keys of the :data:`SPEED_UNITS` nearest to a factor, within a ``width`` of its logarithm."""
    distance = {known: abs(np.log(factor / known)) for known in SPEED_UNITS}
    farthest = min(width, min(distance.values()) + _AS_NEAR)
    near = [
        SPEED_UNITS[known] for known in sorted(distance, key=lambda one: distance[one]) if distance[known] <= farthest
    ]
    return " or ".join(words for words, _ in near), " or ".join(key for _, key in near)


SIGNS = tuple(_reversed(name) for name in ("delta", "v", "r"))  # that one run alone may have

COURSE = "psi is the course over ground"
R_CLIPPED = "r is clipped at the range of its sensor"
R_LATE, PSI_LATE, R_DRIFTS = "r is late or smoothed by a filter", "psi is late", "the offset of r drifts"

MISTAKES = (
    _wrong_unit("r", "deg/s", _DEG),
    _wrong_unit("r", "deg/min", _DEG / 60.0),
    _wrong_unit("p", "deg/s", _DEG),
    _wrong_unit("psi", "deg", _DEG),
    _wrong_unit("phi", "deg", _DEG),
    _wrong_unit("delta", "deg", _DEG),
    _wrong_unit("r", "deg/s", 60.0, converted="deg/min"),
    _wrong_unit("r", "deg/min", 1.0 / 60.0, converted="deg/s"),
    _wrong_unit("r", "rad/s", 1.0 / _DEG, converted="deg/s"),
    _wrong_unit("psi", "rad", 1.0 / _DEG, converted="deg"),
    *(
        Mistake(
            name,
            f"{name} is ten times too large, as of tenths of its unit",
            partial(_scaled, names=name, factor=0.1),
            f'unit = "0.1 {unit}"',
        )
        for name, unit in {"r": "deg/min", "psi": "deg"}.items()
    ),
    *SIGNS,
    _reversed("p"),
    _reversed("psi", 'heading = "counterclockwise"'),
    _reversed("phi"),
    _reversed("u"),
    Mistake(
        "r", R_LATE, partial(_in_time, name="r"), remedy="take r from psi, or a gyro without the filter", gradual=True
    ),
    Mistake("r", R_CLIPPED, _unclipped, remedy="take r from psi"),
    Mistake("psi", PSI_LATE, partial(_in_time, name="psi"), remedy="correct the clock of psi"),
    Mistake("psi", COURSE, _without_drift_angle, remedy="take the heading of a compass"),
    Mistake("r", R_DRIFTS, _without_drift, remedy="take r from psi, or calibrate the gyro", gradual=True),
    _exchanged("r", "psi"),
    _exchanged("p", "phi"),
    _exchanged("u", "v"),
    _exchanged("x", "y"),
    Mistake(
        "y",
        "y has the opposite sign, as of a west longitude without its sign",
        partial(_scaled, names="y", factor=-1.0),
        "sign = -1",
    ),
    Mistake(
        "r",
        "r is the AIS code 4.733 times the root of the rate in deg/min",
        lambda trial: _mended(trial, r=_DEG / 60.0 * CODES["ais"](trial["r"].values / (_DEG / 60.0))),
        'code = "ais"',
    ),
    *(
        Mistake("u v", f"u and v are {words}", partial(_scaled, names="u v", factor=factor), key)
        for factor, (words, key) in SPEED_UNITS.items()
    ),
)


def corrected_by(
    trial: xr.Dataset, channels: Iterable[str], number: int
) -> Iterator[tuple[tuple[Mistake, ...], Channels]]:
    """Each set of ``number`` mistakes that concern some channels, and the trial mended of them; one trial at a time."""
    usual = [
        one for one in MISTAKES if set(one.channels.split()) <= set(trial) and set(one.channels.split()) & set(channels)
    ]
    variables = {name: variable.to_base_variable() for name, variable in trial.variables.items()}
    return _each_mended(variables, usual, number)


def _each_mended(
    trial: Channels, mistakes: Sequence[Mistake], number: int
) -> Iterator[tuple[tuple[Mistake, ...], Channels]]:
    if number == 0:
        yield (), trial
        return
    for k, one in enumerate(mistakes, start=1):
        for others, mended in _each_mended(one.mend(trial), mistakes[k:], number - 1):
            yield (one, *others), mended


def explanation(
    trial: xr.Dataset, channels: Iterable[str], misfit: Callable[[Channels], float]
) -> tuple[tuple[Mistake, ...], str]:
    """Mistake, or pair, after which a record agrees with itself best, none if unexplained; words on gain and key."""
    before = misfit(trial)
    after = {chosen: misfit(mended) for number in (1, 2) for chosen, mended in corrected_by(trial, channels, number)}
    best = min(after, key=lambda chosen: after[chosen] * PAIR ** len(chosen), default=())
    if not best or after[best] > min(before / BETTER, EXPLAINED):
        return (), UNEXPLAINED
    words, keys = (" and ".join(filter(None, (getattr(one, name) for one in best))) for name in ("words", "key"))
    remedies = [f"state {keys}"] if keys else []
    remedies += [one.remedy for one in best if one.remedy]
    gain = f"the misfit falls from {before:.2g} to {after[best]:.2g}"
    return best, f"most probably {words}: {gain}; {'; '.join(remedies)}"
