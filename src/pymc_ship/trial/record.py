"""The record of a trial: an xr.Dataset over time with SNAME names and SI units; checks and CSV."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import as_path, name_list, short_repr
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.files import staged_path
from pymc_ship.trial.channels import CHANNELS, TIME

type Channels = Mapping[Any, xr.DataArray | xr.Variable]
"""Channels of a trial, and its time, by name: the Dataset, or its variables, which are faster to read and to change."""

OVER_GROUND = "over ground"  # attribute ``speeds`` of a trial; by default u and v are through the water
_SECOND_DIFFERENCE = 0.6744897501960817 * np.sqrt(6.0)  # median |y_{k+1} - 2 y_k + y_{k-1}| of white noise of sd 1


def has_ground_speeds(trial: xr.Dataset) -> bool:
    """Whether u and v of a trial are over ground."""
    return bool(trial.attrs.get("speeds") == OVER_GROUND)


def as_trial(trial: object) -> xr.Dataset:
    """The trial itself; TrialError for anything else than one Dataset of real numbers in SI units over time."""
    if not isinstance(trial, xr.Dataset):
        raise TrialError(
            f"A trial must be one xarray Dataset over time, found {_kind(trial)}; give one trial at a time."
        )
    for name, variable in trial.variables.items():
        if variable.dtype.kind not in "biuf" and (name == "time" or name in CHANNELS):
            rule = "The time of a trial must be seconds" if name == "time" else f"Channel {name} must be real numbers"
            raise TrialError(f"{rule}, found the type {variable.dtype}; convert it.")
        if name == "time" or name in CHANNELS:
            _check_unit(str(name), variable.attrs.get("units", ""))
    return trial


def _check_unit(name: str, stated: object) -> None:
    """Raise TrialError for an attribute ``units`` of a channel that is neither its SI unit nor of another quantity.

    Arithmetic of xarray passes the units of an operand on, such as those of psi to its derivative.
    """
    unit = (TIME if name == "time" else CHANNELS[name]).unit
    factor = unit.factor(str(stated))
    if stated in ("", unit.name) or factor == 1.0 or (name == "time" and factor is None):  # "seconds since", too
        return
    if factor is None and any(channel.unit.factor(str(stated)) for channel in (TIME, *CHANNELS.values())):
        return
    remedy = "correct it" if factor is None else f"multiply the values by {factor:.9g} and state this unit"
    raise TrialError(f"Channel {name} must be in {unit.name}, found the units {short_repr(stated)}; {remedy}.")


def _kind(trials: object) -> str:
    return f"{len(trials)} in a list" if isinstance(trials, list | tuple) else short_repr(type(trials))


def trial_list(trials: object) -> list[xr.Dataset]:
    """Trials as a list, of one trial also; TrialError for anything else."""
    if isinstance(trials, xr.Dataset):
        return [as_trial(trials)]
    if not isinstance(trials, Iterable) or isinstance(trials, str | Mapping):
        raise TrialError(f"Trials must be a list of Datasets, found {short_repr(type(trials))}; give a list.")
    return [as_trial(trial) for trial in trials]


def named_trials(trials: object) -> dict[str, xr.Dataset]:
    """Trials by name; TrialError for anything else than a mapping of trials."""
    if isinstance(trials, xr.Dataset) or not isinstance(trials, Mapping):
        raise TrialError(f"Trials must be a dict of Datasets by name, found {_kind(trials)}; give each trial a name.")
    names = name_list("The names of trials", trials, TrialError)
    return {name: as_trial(trial) for name, trial in zip(names, trials.values(), strict=True)}


def numbered_trials(trials: object) -> dict[str, xr.Dataset]:
    """Trials of a mapping by name, those of a list by number from 1; TrialError as of the two."""
    by_name = isinstance(trials, Mapping) and not isinstance(trials, xr.Dataset)
    return named_trials(trials) if by_name else {str(k): trial for k, trial in enumerate(trial_list(trials), start=1)}


def run_names(what: str, names: Iterable[str] | None, n_trials: int) -> tuple[str, ...]:
    """Names of the runs that ``what`` needs, numbers by default; TrialError without trials or another name for each."""
    numbers = map(str, range(1, n_trials + 1))
    found = name_list("The names of runs", numbers if names is None else names, TrialError)
    if not n_trials or len(found) != n_trials:
        raise TrialError(
            f"{what} needs one trial or more and a name for each, found {n_trials} trials and {len(found)} names; "
            "correct them."
        )
    return found


def check_trial(trial: xr.Dataset, channels: Iterable[str], *, uniform: bool = True) -> xr.Dataset:
    """The trial itself, whose channels are finite over increasing time, uniform by :func:`is_uniform` unless waived.

    TrialError for anything else than a Dataset, missing channels, other dims than time, NaN, infinity, wrong times.
    """
    if "time" not in as_trial(trial).coords:
        raise TrialError("A trial must have the coordinate time [s], found none; add it.")
    missing = [name for name in channels if name not in trial]
    if missing:
        raise TrialError(f"The trial needs the channels {', '.join(channels)}; {', '.join(missing)} missing; add them.")
    time = trial["time"].values
    for name in channels:
        _check_dims(trial, name)
        bad = np.flatnonzero(~np.isfinite(trial[name].values))
        if bad.size:
            raise TrialError(
                f"Channel {name} must be finite, found {bad.size} bad values, the first at t = {time[bad[0]]:g} s; "
                "cut or fill them."
            )
    intervals = np.diff(time)
    if not np.isfinite(time).all() or (intervals <= 0.0).any():
        raise TrialError("The time of a trial must be finite and increase; sort the record and drop repeated rows.")
    if uniform and not is_uniform(time):
        raise TrialError(
            f"The sampling of a trial must be uniform, found steps of {intervals.min():g} to {intervals.max():g} s; "
            "resample the record."
        )
    return trial


def _check_dims(trial: xr.Dataset, name: str) -> None:
    if trial[name].dims != ("time",):
        raise TrialError(
            f"Channel {name} must be a function of time alone, found dims {trial[name].dims}; select one run."
        )


def is_uniform(time: np.ndarray) -> bool:
    """Whether times have a constant positive step, within 1e-6 of it or a rounding to the microsecond."""
    intervals = np.diff(time)
    if not intervals.size:
        return True
    step = intervals.mean()
    return bool(np.ptp(intervals) <= 1e-6 * step + min(1e-6, 1e-3 * step) + 1e-9 and intervals.min() > 0.0)


def facility_of(trial: xr.Dataset) -> str:
    """Facility at which a trial was run; empty if it is not stated."""
    return str(trial.attrs.get("facility", ""))


def nonzero_channels(trial: xr.Dataset) -> list[str]:
    """Names of the channels of a trial that are not 0 at all times."""
    return [str(name) for name, values in trial.data_vars.items() if np.any(values.values)]


def sampling_interval(trial: Channels) -> float:
    """Mean sampling interval of a trial [s]."""
    time = trial["time"].values
    if time.size < 2:
        raise TrialError(f"A trial must have at least two samples, found {time.size}; check the record.")
    return float((time[-1] - time[0]) / (time.size - 1))


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """Angle [rad] without jumps by whole turns; the same array where it has none."""
    return np.unwrap(angle) if np.abs(np.diff(angle)).max(initial=0.0) > np.pi else angle


AXES, ASSUMED = "axes", "axes assumed"  # attribute of a trial whose file does not show its axes, and its value


SETTINGS = ("speeds", "facility")  # attributes of a trial that its file keeps


def rudder_line(side: str) -> str:
    """Comment line of a file on the side that a positive rudder turns to."""
    return f'# rudder_positive = "{side}"'


def write_trial(trial: xr.Dataset, path: str | Path) -> Path:
    """Write the channels of a trial to CSV, without loss of digits.

    Comment lines keep the side of a positive rudder and the attrs ``speeds`` and ``facility``.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    path : str or Path

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        When the folder cannot be written.
    TrialError
        Without time or channels; for channels of other dims, and attrs that no comment line can keep.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(20, 20), duration=60, step=0.5)
    >>> path = ps.write_trial(trial, "trial.csv")
    >>> ps.read_trial(path)["psi"].equals(trial["psi"])
    True
    """
    path, trial = as_path("path", path, TrialError), check_trial(trial, (), uniform=False)
    names = [name for name in CHANNELS if name in trial]
    if not names:
        raise TrialError("A record to be written needs channels such as u, v and r, found none; add them.")
    for name in names:
        _check_dims(trial, name)
    table = np.column_stack([trial["time"].values, *(trial[name].values for name in names)])
    settings = {key: str(trial.attrs[key]) for key in SETTINGS if trial.attrs.get(key)}
    for key, value in settings.items():
        if '"' in value or not value.isprintable():
            raise TrialError(f"The attr {key} must be one line without quotes, found {short_repr(value)}; change it.")
    with staged_path(path) as partial, partial.open("w", encoding="utf-8") as file:
        assumed = f", {ASSUMED}" if trial.attrs.get(AXES) else ""
        file.write(f"{rudder_line('port')}{assumed}\n" if "delta" in names else "")
        file.writelines(f'# {key} = "{value}"\n' for key, value in settings.items())
        file.write(",".join(["time", *names]) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
    return path


def second_difference_sd(values: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise on smooth channels, shape (n_channels,) from (n_channels, n_time).

    Robust to a smooth signal and to outliers; too small for noise that is correlated in time.
    """
    return np.median(np.abs(np.diff(values, 2, axis=-1)), axis=-1) / _SECOND_DIFFERENCE
