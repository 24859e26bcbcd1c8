"""Error of the simulated motion along a record beyond the spread of the draws, by state and lead time.

The size of the error of each state has a half-Cauchy law over ships (Gelman 2006, doi:10.1214/06-BA117A), whose median
is :data:`TYPICAL`, times the likelihood of the open-loop simulations of held-out runs. Beyond the motion of the runs an
error grows with the distance from it, see docs/explanation/model_error.md. ``calibration.toml`` has the constants.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri

from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.calibration import calibrated, calibrated_by
from pymc_ship.ships.ensemble.draws import robust_sd

LEADS = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0)
"""Times from the start of a replay [L/U] at which its error is taken."""

ERRING = ("u", "v", "r", "psi", "x", "y")
"""States that have an error."""

SUMMED = ("psi", "x", "y")
"""Those whose error grows with the time that a ship stays beyond the motion of her runs."""

SETTLED = 10.0
"""Time from the start of a replay by which a turn is steady [L/U]."""

TYPICAL = calibrated_by("motion_typical")
"""Error of the prime motion beyond the draws that half the ships exceed :data:`SETTLED` after a start."""

RISE = calibrated_by("motion_rise")
"""Power of the time with which an error grows; that of u, v and r up to the last of :data:`LEADS`."""

LIKELIHOOD_WEIGHT = calibrated("motion_likelihood_weight")
"""Weight of each time of each replay in the law; those of one run err together."""

MOTION_EXTRAPOLATION_SD = calibrated_by("motion_extrapolation_sd")
"""Standard deviation of the prime motion for each range of the record by which the median ship leaves it; of heading
[rad] and track for each L/U that she stays there, too."""

SIZES = 200
"""Equally probable sizes that stand for the law of a model error."""

_ROWS = [STATE.index(name) for name in ERRING]
_STEPS = np.arange(1, 2 * len(ERRING) + 1)
_GOLDEN = 1.0570505752212285  # x^13 = x + 1: the additive sequence that is most even in twelve dimensions
_SIZE = np.exp(np.linspace(-7.0, 9.0, 321))
_NODES = 400  # of a mixture's distribution


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


def size_law(
    error: np.ndarray, known: np.ndarray, typical: np.ndarray, likelihood_weight: float
) -> tuple[np.ndarray, np.ndarray]:
    """Law of how many times the typical error a ship has.

    Parameters
    ----------
    error, known, typical : ndarray, shape (n_rows,)
        Errors in held-out runs, variances that are known of them, and typical errors beyond these.
    likelihood_weight : float
        Weight of each row.

    Returns
    -------
    size, log_weight : ndarray, shape (n_sizes,)
        Sizes, evenly spaced in their logarithm, and the logarithms of their probabilities.
    """
    variance = known[:, None] + (typical[:, None] * _SIZE) ** 2
    told = -0.5 * likelihood_weight * np.sum(np.log(variance) + error[:, None] ** 2 / variance, axis=0)
    log_weight = told + np.log(_SIZE) - np.log1p(_SIZE**2)
    return _SIZE, log_weight - logsumexp(log_weight)


def equal_sizes(size: np.ndarray, log_weight: np.ndarray) -> np.ndarray:
    """Equally probable sizes (SIZES,), rising, that stand for the law of :func:`size_law`."""
    weight = np.exp(log_weight)
    middle = np.cumsum(weight) - 0.5 * weight
    return np.interp((np.arange(SIZES) + 0.5) / SIZES, middle, size)


def motion_error(replays: Iterable[Replayed], vessel: Vessel) -> dict[str, np.ndarray]:
    """Standard deviation of each state beyond the draws, :data:`SETTLED` after a start.

    Parameters
    ----------
    replays : iterable of Replayed
        Of runs that the draws were not fitted to; without any, the law is that of foreign ships.
    vessel : Vessel

    Returns
    -------
    dict of str to ndarray, shape (SIZES,)
        Equally probable sizes, rising, prime at the nominal speed, of :data:`ERRING`.
    """
    unit, scale = vessel.particulars.ship_time, np.array(list(prime_units(vessel).values()))
    times, errors, known = [], [], []
    for one in replays:
        for lead in LEADS:
            if lead * unit <= one.time[-1]:
                place = int(np.searchsorted(one.time, lead * unit - 1e-9))
                drawn = one.states[_ROWS, :, place] / scale[:, None]
                times.append(lead)
                errors.append(one.measured[_ROWS, place] / scale - np.nanmedian(drawn, axis=1))
                known.append([robust_sd(values) ** 2 for values in drawn] + (one.noise_sd[_ROWS] / scale) ** 2)
    leads, error, variance = (
        np.array(times),
        np.reshape(errors, (-1, len(ERRING))),
        np.reshape(known, (-1, len(ERRING))),
    )
    found = {}
    for k, name in enumerate(ERRING):
        seen = np.isfinite(error[:, k]) & np.isfinite(variance[:, k])
        typical = TYPICAL[name] * growth_with_lead_time(name, leads[seen])
        found[name] = TYPICAL[name] * equal_sizes(
            *size_law(error[seen, k], variance[seen, k], typical, LIKELIHOOD_WEIGHT)
        )
    return found


def growth_with_lead_time(name: str, lead: np.ndarray) -> np.ndarray:
    """Error of a state some times after a start [L/U], over that :data:`SETTLED` after it."""
    return ((lead if name in SUMMED else np.minimum(lead, LEADS[-1])) / SETTLED) ** RISE[name]


def with_motion_error(
    states: np.ndarray,
    time: np.ndarray,
    errors: Mapping[str, np.ndarray],
    vessel: Vessel,
    beyond: np.ndarray | None = None,
) -> np.ndarray:
    """States of draws with an error for each, one that is the same share of its law at all times.

    Parameters
    ----------
    states : ndarray, shape (8, n_draws, n_time)
    time : ndarray, shape (n_time,)
        From the start of the replay [s].
    errors : mapping of str to ndarray
        From :func:`motion_error`; states that it does not name have none.
    vessel : Vessel
    beyond : ndarray, shape (n_time,), optional
        Distance of the median ship from the motion of the runs, in ranges of it, see
        :func:`pymc_ship.ships.forecasting.extrapolation.extrapolation`; 0 by default.

    Returns
    -------
    ndarray, shape (8, n_draws, n_time)
        The errors of the draws are equally spread over their laws, without chance.
    """
    found, lead = states.copy(), time / vessel.particulars.ship_time
    far = time_beyond(np.zeros(time.size) if beyond is None else np.nan_to_num(beyond), lead)
    units = prime_units(vessel)
    place = (0.5 + np.outer(_GOLDEN ** -_STEPS.astype(float), np.arange(1, states.shape[1] + 1))) % 1.0
    for name, row, of_ship, of_distance in zip(ERRING, _ROWS, *np.split(place, 2), strict=True):
        error = np.outer(ndtri(of_distance), MOTION_EXTRAPOLATION_SD[name] * far[name])
        if name in errors:
            error += np.outer(mixture_quantiles(np.asarray(errors[name]), of_ship), growth_with_lead_time(name, lead))
        found[row] += error * units[name]
    return found


def mixture_quantiles(sd: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Quantiles of a mixture of equally probable normal laws about 0, of standard deviations ``sd`` (n_laws,)."""
    reach = np.append(0.0, np.geomspace(1e-3 * sd.min(), 9.0 * sd.max(), _NODES))
    above = np.mean(ndtr(reach[:, None] / sd), axis=1) - 0.5
    off = probability - 0.5
    return np.sign(off) * np.interp(np.abs(off), above, reach)


def time_beyond(beyond: np.ndarray, lead: np.ndarray) -> dict[str, np.ndarray]:
    """What the error of each state grows with, shape (n_time,): the distance, or its sum over the time [L/U]."""
    stayed = np.append(0.0, np.cumsum(0.5 * (beyond[1:] + beyond[:-1]) * np.diff(lead)))
    return {name: stayed if name in SUMMED else beyond for name in ERRING}


def prime_units(vessel: Vessel) -> dict[str, float]:
    """Units of the states that err, by which they are prime."""
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    return {"u": U, "v": U, "r": U / L, "psi": 1.0, "x": L, "y": L}
