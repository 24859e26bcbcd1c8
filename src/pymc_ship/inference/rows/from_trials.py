"""From trials to the rows of a regression, by differences or in the weak form."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.inference.rows.data import ROUNDING, RegressionData
from pymc_ship.inference.rows.weak_form import radius_samples, row_stride, weak_form
from pymc_ship.machine.arguments import check_choice, number_or_nan, short_repr
from pymc_ship.machine.errors import InferenceError
from pymc_ship.physics.forces.prime_system import to_prime
from pymc_ship.physics.forces.terms import evaluate
from pymc_ship.physics.motion.equations import VELOCITIES
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import DOFS, Vessel
from pymc_ship.records.checks.run_set import run_set_flags
from pymc_ship.trial.record import numbered_trials, sampling_interval

_WITHOUT_DIFFERENCE = {"euler": (0, 1), "central": (1, 1)}
"""Samples at the beginning and end of a record without a difference."""

WEAK = {"weak": "rk4", "weak_euler": "euler"}
"""Weak forms among the derivatives, with the integrator that the record is assumed to come from."""


def regression_data(
    trial: xr.Dataset | Sequence[xr.Dataset] | Mapping[str, xr.Dataset],
    vessel: VesselLike,
    dof: str,
    *,
    interval: float | None = None,
    derivative: str = "euler",
) -> RegressionData:
    """Design matrix and response of one degree of freedom; Xue et al. (2020), Eq. 6, 21.

    Differences need a denoised trial. The weak form takes the trial as measured: its rows are means under test
    functions of 0.55 L/U. Rows closer than 0.22 L/U share noise, which the posterior ignores: too narrow intervals.

    Parameters
    ----------
    trial : Dataset, dims (time,), or sequence or mapping of such
        u, v [m/s], r [rad/s], delta [rad]; p [rad/s] and phi [rad] if the vessel rolls; uniform time [s]. Rows of
        several trials are stacked under one scaling; ``run`` is the key of a mapping, else 1, 2, ...
    vessel : Vessel, str or Path
        Particulars, inertia and the terms of the DOF; its reference coefficients are not used.
    dof : {"surge", "sway", "yaw", "roll"}
    interval : float, optional
        Interval of the rows [s], a multiple of the sampling interval; by default every sample, or 0.22 L/U (weak form).
    derivative : {"euler", "central", "savgol", "weak", "weak_euler"}, optional
        Accelerations by :func:`pymc_ship.records.denoising.derivative.derivative`; or the weak form, "weak" for
        measured records, "weak_euler" for records of Euler steps of the sampling interval.

    Returns
    -------
    RegressionData
        Prime values, z-scored; ``time`` is that of each run.

    Raises
    ------
    TrialError
        For missing channels, NaN, or time that is not uniform; for the weak form, a trial too short or too coarse.
    InferenceError
        If the rudder never moves, the interval is no multiple of the sampling interval, or rows are fewer than terms.
    ValueError, VesselError
        For an unknown derivative; when the vessel has no such DOF.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(trial, vessel, "yaw", interval=5.0, derivative="central")
    >>> data.design_matrix.shape, data.coefficients[:3]
    ((119, 12), ('N0', 'Nv', 'Nr'))
    """
    vessel = as_vessel(vessel)
    from pymc_ship.records.denoising.derivative import DERIVATIVES

    check_choice("The derivative", derivative, (*DERIVATIVES, *WEAK))
    trials, terms = numbered_trials(trial), vessel.terms(dof)
    if not trials:
        raise InferenceError("Rows come from one trial or several, found none; give them.")
    rows_of = _weak_rows if derivative in WEAK else _difference_rows
    parts = []
    for one in trials.values():
        delta = motion_record(one, vessel)["delta"]
        if np.ptp(delta) <= ROUNDING * np.abs(delta).max():
            raise InferenceError("The rudder of a trial must move, found a constant angle; use one that steers.")
        parts.append(rows_of(one, vessel, dof, _stride(sampling_interval(one), interval), derivative))
    design_matrix, response, time = (np.concatenate(values) for values in zip(*parts, strict=True))
    if time.size < len(terms):
        raise InferenceError(
            f"The {dof} of {vessel.name!r} has {len(terms)} terms and needs as many rows, found {time.size}; use a "
            "longer trial or a shorter interval."
        )
    return RegressionData.from_arrays(
        design_matrix,
        response,
        [str(name) for name in vessel.coefficients(dof)["coefficient"].values],
        scaling="zscore",
        time=time,
        run=np.repeat(list(trials), [times.size for _, _, times in parts]),
        dof=dof,
        vessel=vessel.name,
        derivative=derivative,
        **run_set_flags(trials, vessel.particulars.L),
    )


def _difference_rows(
    trial: xr.Dataset, vessel: Vessel, dof: str, stride: int | None, derivative: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms, response and time of the samples that have an acceleration."""
    from pymc_ship.records.denoising.derivative import derivative as differentiate

    record, step, L = motion_record(trial, vessel), sampling_interval(trial), vessel.particulars.L
    motion, speed, known_forces = prime_record(vessel, record)
    acceleration = np.zeros((len(VELOCITIES), speed.size))
    for k, name in enumerate(VELOCITIES):
        if name in record:
            acceleration[k] = to_prime(f"{name}dot", differentiate(record[name], step, method=derivative), speed, L)
    index = DOFS.index(dof)
    response = vessel.inertia_matrix[index] @ acceleration - known_forces[index]
    begin, end = _WITHOUT_DIFFERENCE.get(derivative, (0, 0))
    rows = np.arange(speed.size - end)[:: stride or 1]
    rows = rows[rows >= begin]
    design_matrix = evaluate(vessel.terms(dof), {name: values[rows] for name, values in motion.items()})
    return design_matrix, response[rows], trial["time"].values[rows]


def _weak_rows(
    trial: xr.Dataset, vessel: Vessel, dof: str, stride: int | None, derivative: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms, response and centre of the test functions that lie inside the record."""
    stride = stride or row_stride(radius_samples(trial, vessel))
    form = weak_form(trial, vessel, stride=stride, method=WEAK[derivative])
    return form.design_matrices[dof], form.responses[dof], form.time


def _stride(step: float, interval: float | None) -> int | None:
    """Samples from one row to the next; None for the default."""
    if interval is None:
        return None
    ratio = number_or_nan(interval) / step
    stride = round(ratio) if 0.0 < ratio < np.inf else 0
    if stride < 1 or abs(ratio - stride) > 1e-6 * ratio:
        raise InferenceError(
            f"The row interval is a multiple of the sampling interval, found {short_repr(interval)} s at "
            f"{step:g} s; adjust it."
        )
    return stride
