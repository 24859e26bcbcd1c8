"""Model error of the simulated motion beyond the spread of the draws, by state and lead time.

Half-Cauchy prior of its sd over ships (Gelman 2006, doi:10.1214/06-BA117A) with median :data:`TYPICAL`; it grows with
the extrapolation from the runs, see docs/explanation/model_error.md. ``calibration.toml`` has the constants.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import scipy

from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.ships.ensemble.calibration import constant_by_kind, constant_value
from pymc_ship.ships.ensemble.draws import robust_sd

LEADS = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0)  # lead times of the error [L/U]
ERROR_STATES = ("u", "v", "r", "psi", "x", "y")  # states with a model error
ACCUMULATED_STATES = ("psi", "x", "y")  # their error accumulates over the time beyond the motion of the runs
REFERENCE_LEAD = 10.0  # lead time of the sizes [L/U], by which a turn is steady
TYPICAL = constant_by_kind("motion_typical")  # median prime error beyond the draws at REFERENCE_LEAD, over ships
RISE = constant_by_kind("motion_rise")  # power of the growth with lead time; u, v and r grow up to the last of LEADS
LIKELIHOOD_WEIGHT = constant_value("motion_likelihood_weight")  # power of each lead time: errors of a run correlate
MOTION_EXTRAPOLATION_SD = constant_by_kind("motion_extrapolation_sd")  # per range of the record; psi, x, y also per L/U
SIZES = 200  # number of equally probable sizes of a law
_ROWS = [STATE.index(name) for name in ERROR_STATES]
_STEPS = np.arange(1, 2 * len(ERROR_STATES) + 1)
_GOLDEN = 1.0570505752212285  # x^13 = x + 1: additive low-discrepancy sequence in 12 dimensions
SIZE_GRID = np.exp(np.linspace(-7.0, 9.0, 321))  # of a law, over the typical size
_NODES = 400  # interpolation nodes of a mixture's distribution


class OpenLoopSimulation(NamedTuple):
    """Open-loop simulation along a recorded run, and the record; SI and rad."""

    time: np.ndarray  # (n_time,) from the start
    states: np.ndarray  # (8, n_draws, n_time)
    measured: np.ndarray  # (8, n_time), NaN where not measured
    noise_sd: np.ndarray  # (8, n_time) of the readings


def size_law(
    error: np.ndarray,
    known_variance: np.ndarray,
    typical: np.ndarray,
    likelihood_weight: float,
    prior_median: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior law of the size of a ship's error over the typical error: sizes and log probabilities, (n_sizes,).

    ``error``, ``known_variance`` and ``typical`` are errors in held-out runs, the variance by draws and readings, and
    the typical errors, (n_rows,). ``prior_median`` is that of the half-Cauchy prior.
    """
    variance = known_variance[:, None] + (typical[:, None] * SIZE_GRID) ** 2
    log_likelihood = -0.5 * likelihood_weight * np.sum(np.log(variance) + error[:, None] ** 2 / variance, axis=0)
    return SIZE_GRID, normalised_law(log_likelihood, prior_median)


def normalised_law(log_likelihood: np.ndarray, median: float = 1.0) -> np.ndarray:
    """Log probabilities of :data:`SIZE_GRID` (n_sizes,): a half-Cauchy prior of this median, times a likelihood."""
    log_weight = log_likelihood + np.log(SIZE_GRID) - np.log(median**2 + SIZE_GRID**2)
    return log_weight - scipy.special.logsumexp(log_weight)


def equal_sizes(size: np.ndarray, log_weight: np.ndarray) -> np.ndarray:
    """Equally probable sizes (SIZES,) of the law of :func:`size_law`, ascending."""
    weight = np.exp(log_weight)
    middle = np.cumsum(weight) - 0.5 * weight
    return np.interp((np.arange(SIZES) + 0.5) / SIZES, middle, size)


def motion_error(replays: Iterable[OpenLoopSimulation], vessel: Vessel) -> dict[str, np.ndarray]:
    """Standard deviation of each state beyond the draws at :data:`REFERENCE_LEAD`, from simulations of held-out runs.

    Equally probable quantiles (SIZES,) of the sd, prime at the nominal speed; without a run, those of other ships.
    """
    unit, scale = vessel.particulars.ship_time, np.array(list(prime_units(vessel).values()))
    times, errors, variances = [], [], []
    for one in replays:
        for lead in LEADS:
            if lead * unit <= one.time[-1]:
                time_index = int(np.searchsorted(one.time, lead * unit - 1e-9))
                simulated = one.states[_ROWS, :, time_index] / scale[:, None]
                times.append(lead)
                errors.append(one.measured[_ROWS, time_index] / scale - np.nanmedian(simulated, axis=1))
                noise_sd = one.noise_sd[_ROWS, time_index] / scale
                variances.append([robust_sd(values) ** 2 for values in simulated] + noise_sd**2)
    error, variance = (np.reshape(rows, (-1, len(ERROR_STATES))).T for rows in (errors, variances))
    sizes = {}
    for k, name in enumerate(ERROR_STATES):
        measured = np.isfinite(error[k]) & np.isfinite(variance[k])
        typical = TYPICAL[name] * growth_with_lead_time(name, np.array(times)[measured])
        law = size_law(error[k, measured], variance[k, measured], typical, LIKELIHOOD_WEIGHT)
        sizes[name] = TYPICAL[name] * equal_sizes(*law)
    return sizes


def motion_size(errors: Mapping[str, np.ndarray]) -> float:
    """Size of the error of heading and track of a ship over the typical one, from :func:`motion_error`."""
    ratios = [np.median(errors[name]) / TYPICAL[name] for name in ACCUMULATED_STATES]
    return float(np.exp(np.mean(np.log(ratios))))


def growth_with_lead_time(name: str, lead: np.ndarray) -> np.ndarray:
    """Error of a state at a lead time [L/U] over that at :data:`REFERENCE_LEAD`."""
    return ((lead if name in ACCUMULATED_STATES else np.minimum(lead, LEADS[-1])) / REFERENCE_LEAD) ** RISE[name]


def with_motion_error(
    states: np.ndarray,
    time: np.ndarray,
    errors: Mapping[str, np.ndarray],
    vessel: Vessel,
    beyond: np.ndarray | None = None,
    growth: np.ndarray | float = 1.0,
) -> np.ndarray:
    """States of draws with a model error, of the same quantile at all times, by a low-discrepancy sequence.

    ``states`` have shape (8, n_draws, n_time), ``time`` [s] counts from the start; states without ``errors`` of
    :func:`motion_error` are unchanged. ``beyond``, shape (n_time,), is the distance of the median ship from the motion
    of the runs, in ranges of it; ``growth``, shape (n_laws,), are equally probable growths of the error there, from
    :func:`.extrapolation_growth`.
    """
    with_error, lead = states.copy(), time / vessel.particulars.ship_time
    extrapolations = time_beyond(np.zeros(time.size) if beyond is None else np.nan_to_num(beyond), lead)
    units, growths = prime_units(vessel), np.atleast_1d(growth)
    quantile = (0.5 + np.outer(_GOLDEN ** -_STEPS.astype(float), np.arange(1, states.shape[1] + 1))) % 1.0
    for name, row, of_ship, of_distance in zip(ERROR_STATES, _ROWS, *np.split(quantile, 2), strict=True):
        error = np.outer(mixture_quantiles(growths, of_distance), MOTION_EXTRAPOLATION_SD[name] * extrapolations[name])
        if name in errors:
            error += np.outer(mixture_quantiles(np.asarray(errors[name]), of_ship), growth_with_lead_time(name, lead))
        with_error[row] += error * units[name]
    return with_error


def mixture_quantiles(sd: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Quantiles of a mixture of equally probable normal laws about 0, of standard deviations ``sd`` (n_laws,)."""
    reach = np.append(0.0, np.geomspace(1e-3 * sd.min(), 9.0 * sd.max(), _NODES))
    above = np.mean(scipy.special.ndtr(reach[:, None] / sd), axis=1) - 0.5
    off = probability - 0.5
    return np.sign(off) * np.interp(np.abs(off), above, reach)


def time_beyond(beyond: np.ndarray, lead: np.ndarray) -> dict[str, np.ndarray]:
    """Factor of the extrapolation error of each state, (n_time,): the distance, or its integral over time [L/U]."""
    integral = np.append(0.0, np.cumsum(0.5 * (beyond[1:] + beyond[:-1]) * np.diff(lead)))
    return {name: integral if name in ACCUMULATED_STATES else beyond for name in ERROR_STATES}


def prime_units(vessel: Vessel) -> dict[str, float]:
    """Prime units of the states with a model error."""
    L, U = vessel.particulars.L, vessel.particulars.nominal_speed
    return {"u": U, "v": U, "r": U / L, "psi": 1.0, "x": L, "y": L}
