"""Model error of the motion by lead time: how far ships drift from runs they were not fitted to, beyond their draws.

A ship that begins at a measured state and sails along the measured inputs leaves the record with time: her forces are
not exact, and gusts, waves and unsteady water act that nobody measured. The excess of the squared error over the
variance of the draws and of the readings is taken over all such replays, by the time since their start.

No held-out run says how wrong a model is where no run has been. What foreign ships showed there grows with the distance
of the median ship from the motion of the runs: :data:`GROWTH`, of thirty ships that are none of those of
``studies/ships.toml`` (docs/explanation/foreign_ships.md).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import isotonic_regression
from scipy.special import ndtri

from pymc_ship.motion.equations import STATE
from pymc_ship.vessel.vessel import Vessel

LEADS = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0)
"""Times from the start of a replay [L/U] at which its error is taken."""

ERRING = ("u", "v", "r", "psi", "x", "y")
"""States that have an error."""

SUMMED = ("psi", "x", "y")
"""Those whose error grows with the time that a ship stays beyond the motion of her runs."""

GROWTH = {"u": 0.007, "v": 0.0025, "r": 0.001, "psi": 0.001, "x": 0.003, "y": 0.003}
"""Standard deviation of the prime motion for each range of the record by which the median ship leaves it; of heading
[rad] and track for each L/U that she stays there, too."""

_ROWS = [STATE.index(name) for name in ERRING]
_STEPS = np.arange(1, len(ERRING) + 1)
_NONE = 1e-9  # replays at a lead that none reaches
_GOLDEN = 1.112775684278706  # x^7 = x + 1: the additive sequence that is most even in six dimensions


class Replayed(NamedTuple):
    """A replay beside its record.

    ``time`` (n_time,) [s] is from the start of the replay; ``states`` (8, n_draws, n_time) and ``measured`` (8, n_time)
    are in SI units and rad, NaN where a channel was not measured; ``noise_sd`` (8,) is the standard deviation of the
    readings about a replay of the true ship, 0 for exact ones.
    """

    time: np.ndarray
    states: np.ndarray
    measured: np.ndarray
    noise_sd: np.ndarray


def motion_error(replays: Iterable[Replayed], vessel: Vessel) -> xr.Dataset:
    """Standard deviation of the motion beyond the draws, by lead.

    Parameters
    ----------
    replays : iterable of Replayed
        Of runs that the draws were not fitted to.
    vessel : Vessel

    Returns
    -------
    Dataset, dims (lead,)
        Prime at the nominal speed. Its square is the mean excess at each lead, each replay counted once, and where that
        falls with the lead the mean over the leads between which it does (least squares); leads [L/U] end with the
        longest replay, and there are none without replays.
    """
    unit, scale = vessel.particulars.ship_time, np.array(list(prime_units(vessel).values()))
    replays = list(replays)
    leads = [lead for lead in LEADS if any(lead * unit <= one.time[-1] for one in replays)]
    found = []
    for lead in leads:
        rows = [one for one in replays if lead * unit <= one.time[-1]]
        excess = np.zeros((len(rows), len(ERRING)))
        for k, one in enumerate(rows):
            place = int(np.searchsorted(one.time, lead * unit - 1e-9))
            drawn = one.states[_ROWS, :, place] / scale[:, None]
            error = one.measured[_ROWS, place] / scale - np.nanmedian(drawn, axis=1)
            excess[k] = error**2 - np.nanvar(drawn, axis=1) - (one.noise_sd[_ROWS] / scale) ** 2
        known = np.isfinite(excess)
        count = np.maximum(known.sum(axis=0), _NONE)
        found.append((np.where(known, excess, 0.0).sum(axis=0) / count, count))
    rising = {}
    for k, name in enumerate(ERRING):
        mean, count = (np.array([one[what][k] for one in found]) for what in (0, 1))
        square = isotonic_regression(mean, weights=count).x if found else mean
        rising[name] = ("lead", np.sqrt(np.maximum(square, 0.0)))
    return xr.Dataset(rising, {"lead": leads})


def with_motion_error(
    states: np.ndarray, time: np.ndarray, error: xr.Dataset, vessel: Vessel, beyond: np.ndarray | None = None
) -> np.ndarray:
    """States of draws with an error for each, one that is the same number of standard deviations at all times.

    Parameters
    ----------
    states : ndarray, shape (8, n_draws, n_time)
    time : ndarray, shape (n_time,)
        From the start of the replay [s].
    error : Dataset
        From :func:`motion_error`.
    vessel : Vessel
    beyond : ndarray, shape (n_time,), optional
        Distance of the median ship from the motion of the runs, in ranges of it, see
        :func:`pymc_ship.forecasting.extrapolation.extrapolation`; 0 by default.

    Returns
    -------
    ndarray, shape (8, n_draws, n_time)
        The errors of the draws are equally spread over the normal law, without chance. Beyond the leads that were seen
        those of heading and track grow with time, the others no more.
    """
    known, unit = error.sizes["lead"] > 0, vessel.particulars.ship_time
    beyond = np.zeros(time.size) if beyond is None else np.nan_to_num(beyond)
    if not known and not beyond.any():
        return states
    found, lead = states.copy(), time / unit
    far, units = time_beyond(beyond, lead), prime_units(vessel)
    place = (0.5 + np.outer(np.arange(1, states.shape[1] + 1), _GOLDEN ** -_STEPS.astype(float))) % 1.0
    for k, (name, row) in enumerate(zip(ERRING, _ROWS, strict=True)):
        sd = np.zeros(time.size)
        if known:
            seen = error["lead"].values
            sd = np.interp(lead, seen, error[name].values)
            if name in SUMMED and seen[-1] > 0.0:
                sd = sd * np.maximum(lead / seen[-1], 1.0)
        sd = np.hypot(sd, GROWTH[name] * far[name]) * units[name]
        found[row] += ndtri(place[:, k, None]) * sd
    return found


def time_beyond(beyond: np.ndarray, lead: np.ndarray) -> dict[str, np.ndarray]:
    """What the error of each state grows with, shape (n_time,): the distance, or its sum over the time [L/U]."""
    stayed = np.append(0.0, np.cumsum(0.5 * (beyond[1:] + beyond[:-1]) * np.diff(lead)))
    return {name: stayed if name in SUMMED else beyond for name in ERRING}


def prime_units(vessel: Vessel) -> dict[str, float]:
    """Units of the states that err, by which they are prime."""
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    return {"u": U, "v": U, "r": U / L, "psi": 1.0, "x": L, "y": L}
