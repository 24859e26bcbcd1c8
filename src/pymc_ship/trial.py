"""The record of a trial: an xr.Dataset over time with SNAME names, SI units and rad; checked, read and written."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.output import staged

UNITS = {
    "u": "m/s",
    "v": "m/s",
    "r": "rad/s",
    "p": "rad/s",
    "phi": "rad",
    "psi": "rad",
    "x": "m",
    "y": "m",
    "delta": "rad",
}
"""Channels of a trial and their units."""

CHANNELS = tuple(UNITS)


class TrialError(ValueError):
    """A record that cannot be used; the sentence names the channel and the place."""


def check_trial(trial: xr.Dataset, channels: Iterable[str], *, uniform: bool = True) -> xr.Dataset:
    """Check that a trial holds finite channels over increasing, uniform time.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    channels : iterable of str
        Channels that must be there.
    uniform : bool, optional
        Whether the sampling interval must be constant (within 1e-6 of itself).

    Returns
    -------
    Dataset
        The trial itself.

    Raises
    ------
    TrialError
        For channels that are missing or depend on more than time, NaN or infinity, times that do not increase or are
        not uniform.
    """
    if "time" not in trial.coords:
        raise TrialError("A trial is a Dataset over the coordinate time [s], found none; add it.")
    missing = [name for name in channels if name not in trial]
    if missing:
        raise TrialError(f"The trial needs the channels {', '.join(channels)}; {', '.join(missing)} missing; add them.")
    time = trial["time"].values
    for name in channels:
        if trial[name].dims != ("time",):
            raise TrialError(
                f"Channel {name} must be a function of time alone, found dims {trial[name].dims}; select one run."
            )
        bad = np.flatnonzero(~np.isfinite(trial[name].values))
        if bad.size:
            raise TrialError(
                f"Channel {name} must be finite, found {bad.size} bad values, the first at t = {time[bad[0]]:g} s; "
                "cut or fill them."
            )
    intervals = np.diff(time)
    if not np.isfinite(time).all() or (intervals <= 0.0).any():
        raise TrialError("The time of a trial must be finite and increase; sort the record and drop repeated rows.")
    if uniform and intervals.size and np.ptp(intervals) > 1e-6 * intervals.mean() + 1e-9:
        raise TrialError(
            f"The sampling of a trial must be uniform, found steps of {intervals.min():g} to {intervals.max():g} s; "
            "resample the record."
        )
    return trial


def sampling_interval(trial: xr.Dataset) -> float:
    """Mean sampling interval of a trial [s]."""
    time = trial["time"].values
    if time.size < 2:
        raise TrialError(f"A trial has at least two samples, found {time.size}; check the record.")
    return float((time[-1] - time[0]) / (time.size - 1))


def read_trial(path: str | Path) -> xr.Dataset:
    """Read a trial from CSV with a header of channel names and units of this package.

    Parameters
    ----------
    path : str or Path
        CSV with the columns ``time`` [s] and any of u, v [m/s], r, p [rad/s], phi, psi, delta [rad], x, y [m].

    Returns
    -------
    Dataset, dims (time,)

    Raises
    ------
    TrialError
        For an unreadable file, unknown or missing columns, or text where a number should be; names line and column.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise TrialError(f"The trial {path} cannot be read: {reason}; check the path.") from None
    rows = [(number, line.split(",")) for number, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    if len(rows) < 3:
        raise TrialError(f"{path}: a trial has a header and at least two rows, found {len(rows)} lines.")
    names = [name.strip() for name in rows[0][1]]
    unknown = [name for name in names if name not in ("time", *CHANNELS)]
    if unknown or "time" not in names or len(set(names)) < len(names):
        found = f"{', '.join(unknown)} unknown" if unknown else f"the header {','.join(names)}"
        raise TrialError(
            f"{path}: columns are time and any of {', '.join(CHANNELS)}, each once; found {found}; rename."
        )
    values = np.array([_row(cells, names, path, number) for number, cells in rows[1:]])
    column = dict(zip(names, values.T, strict=True))
    channels = {name: ("time", column[name], {"units": UNITS[name]}) for name in CHANNELS if name in column}
    return xr.Dataset(channels, {"time": ("time", column["time"], {"units": "s"})})


def _row(cells: list[str], names: list[str], path: Path, number: int) -> list[float]:
    if len(cells) != len(names):
        raise TrialError(f"{path}, line {number}: the header has {len(names)} columns, found {len(cells)}; mend it.")
    values = []
    for cell, name in zip(cells, names, strict=True):
        try:
            values.append(float(cell))
        except ValueError:
            raise TrialError(f"{path}, line {number}, column {name}: a number is needed, found {cell!r}.") from None
    return values


def write_trial(trial: xr.Dataset, path: str | Path) -> Path:
    """Write the channels of a trial to CSV, moved into place when complete; read back to the last digit.

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
    """
    path = Path(path)
    names = [name for name in CHANNELS if name in trial]
    table = np.column_stack([trial["time"].values, *(trial[name].values for name in names)])
    with staged(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(",".join(["time", *names]) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
    return path
