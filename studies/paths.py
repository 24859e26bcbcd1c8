"""Ways from the runs to the coefficients, compared on the same terms by the runs that each was not given.

Regression differentiates the records, the weak form integrates them against test functions, a trajectory fit simulates
them. A row of a regression is a force. Divided by U^2, as a prime value, it has four times the noise at half the speed,
so that slow samples dominate; multiplied by (U/U_nom)^2, every row has the same. The terms are those that
weigh most in an identification of the ship, whose trajectory fits are taken.

``python -m studies.paths trials... --vessel SHIP --format FILE --out FOLDER``
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.cli.files import Outcome, Progress, vessel_argument
from pymc_ship.cli.main import run_command
from pymc_ship.cli.ship_commands import checked_trials
from pymc_ship.cli.texts import table_text
from pymc_ship.inference.rows.from_trials import regression_data
from pymc_ship.inference.rows.weak_form import empirical_bayes_mean, weak_form_start
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.windows import Window, fit_windows, prepared_windows, thin_record
from pymc_ship.machine.errors import FitError, InferenceError, TrialError, VesselError
from pymc_ship.machine.files import staged_files, writable_folder
from pymc_ship.pages.page import write_rows
from pymc_ship.physics.manoeuvre.indices import needs_roll
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.vessel.term_sets import supports_part_sets
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.recognition import recognise_by_facility, with_steering
from pymc_ship.ships.identification.candidates import (
    modelled_pieces,
    prior_kind_of,
    window_prior,
    with_prior_knowledge,
)
from pymc_ship.ships.identification.held_out import CrossValidation, forecast_rows, recorded_indices, score_folds
from pymc_ship.ships.identification.held_out_errors import overshoot_errors
from pymc_ship.ships.identification.model import identify_ship
from studies.command_line import study_parser

PATHS = ("regression", "regression, rows divided by U^2", "weak form", "trajectory")
"""Names of the paths, from the least to the most work; the second shows what the weights of the first are for."""


@dataclass(frozen=True)
class Estimated:
    """Coefficients of a path, shape (n_coefficients,)."""

    coefficients: np.ndarray


@dataclass(frozen=True)
class _Runs:
    """Thinned runs, their windows and what they were recognised as."""

    trials: list[xr.Dataset]
    windows: list[list[Window]]
    manoeuvres: list[Manoeuvre | None]
    names: tuple[str, ...]
    vessel: Vessel
    prior: CoefficientPrior


def compare_paths(
    trials: Sequence[xr.Dataset],
    vessel: Vessel,
    prior_kind: str | None = None,
    *,
    names: Sequence[str] | None = None,
    trajectory: CrossValidation | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[dict]:
    """Leave each run out once on every path, and compare what the others say of it.

    Parameters
    ----------
    trials : sequence of Dataset, dims (time,)
        Checked and corrected records of two runs or more, as for
        :func:`pymc_ship.ships.identification.model.identify_ship`.
    vessel : Vessel
        With the terms to be compared on.
    prior_kind : {"hull_database", "order_damped", "sister_ship"}, optional
        Prior of the coefficients, as for :func:`pymc_ship.ships.identification.model.identify_ship`; on all paths but
        the trajectory the evidence stretches its scales.
    names : sequence of str, optional
        Of the runs; numbers by default.
    trajectory : HeldOut, optional
        Trajectory fits to all runs but one where they are there already; else they are made.
    progress : callable, optional
        Called with a short text before each path.

    Returns
    -------
    list of dict
        For each of :data:`PATHS`: ``log_density`` (sum over the runs; minus infinity where a window of a held-out run
        cannot be simulated or a fit fails), ``rms_u``, ... (of each channel over all held-out windows, SI),
        ``first_overshoot_angle_mean`` and ``_max`` (of the absolute error, deg), the same of the second,
        ``overshoot_time_median`` (of the relative error, %), ``reached`` and ``measured`` (events that the forecasts
        reach, and that the records hold) and ``remark``, what failed.

    Raises
    ------
    TrialError
        For fewer than two runs, or runs that are too short or lack a channel.
    VesselError, InferenceError
        For a prior that is unknown or cannot be had.
    """
    if len(trials) < 2:
        raise TrialError(f"Paths are compared on held-out runs, which takes two runs or more, found {len(trials)}.")
    runs = _prepared(trials, vessel, prior_kind_of(vessel, prior_kind), names)
    rows = []
    for name, estimate in _ESTIMATES.items():
        progress(f"path: {name}")
        known = name == "trajectory" and trajectory is not None
        try:
            rows.append(_row(name, trajectory.fits if known else list(estimate(runs)), runs))
        except (FitError, InferenceError) as error:
            rows.append(_failed(name, f"It cannot be fitted: {error}", runs))
    return rows


def _prepared(trials: Sequence[xr.Dataset], vessel: Vessel, kind: str, names: Sequence[str] | None) -> _Runs:
    manoeuvres, facilities = recognise_by_facility(trials, vessel)
    vessel = with_prior_knowledge(with_steering(vessel, next(iter(facilities.values()))), kind)
    pieces = [modelled_pieces(thin_record(trial, vessel), vessel) for trial in trials]
    short = [max(of_run, key=lambda piece: piece.sizes["time"]) for of_run in pieces]
    windows = [prepared_windows(trial, vessel) for trial in short]
    names = tuple(names or (str(k + 1) for k in range(len(trials))))
    return _Runs(short, windows, manoeuvres, names, vessel, window_prior(short, vessel, kind))


def _without(items: Sequence, k: int) -> list:
    return [item for j, item in enumerate(items) if j != k]


def regression_rows(trial: xr.Dataset, vessel: Vessel, *, by_speed: bool) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Terms and response of every DOF at each sample, accelerations by Savitzky-Golay.

    Parameters
    ----------
    trial : Dataset, dims (time,)
    vessel : Vessel
    by_speed : bool
        Whether rows are multiplied by (U/U_nom)^2; else they are prime values.

    Returns
    -------
    dict of str to (ndarray of shape (n_rows, n_terms), ndarray of shape (n_rows,))
    """
    rows = {}
    for dof in vessel.dofs:
        data = regression_data(trial, vessel, dof, derivative="savgol")
        weight = np.ones(data.n_rows)
        if by_speed:
            at = trial.sel(time=data.time)
            weight = (at["u"].values ** 2 + at["v"].values ** 2) / vessel.particulars.nominal_speed**2
        rows[dof] = data.design_matrix * weight[:, None], data.response * weight
    return rows


def _regressions(runs: _Runs, *, by_speed: bool) -> Iterator[Estimated]:
    every = [regression_rows(trial, runs.vessel, by_speed=by_speed) for trial in runs.trials]
    cuts = np.cumsum([len(runs.vessel.terms(dof)) for dof in runs.vessel.dofs])[:-1]
    priors = list(zip(np.split(runs.prior.mean, cuts), np.split(runs.prior.scale, cuts), strict=True))
    for k in range(len(every)):
        found = []
        for dof, prior in zip(runs.vessel.dofs, priors, strict=True):
            X, y = (np.concatenate(parts) for parts in zip(*(rows[dof] for rows in _without(every, k)), strict=True))
            found.append(empirical_bayes_mean(X, y, *prior))
        yield Estimated(np.concatenate(found))


def _weak_forms(runs: _Runs) -> Iterator[Estimated]:
    for k in range(len(runs.trials)):
        others = _without(runs.trials, k)
        yield Estimated(weak_form_start(others, runs.vessel, runs.prior.mean, runs.prior.scale, method="rk4"))


def _trajectories(runs: _Runs) -> Iterator[Estimated]:
    """Window fits, begun where the fit to all runs ends; which minimum is found hardly depends on it."""
    start = weak_form_start(runs.trials, runs.vessel, runs.prior.mean, runs.prior.scale, method="rk4")
    whole = fit_windows([window for run in runs.windows for window in run], runs.vessel, runs.prior, start)
    for k in range(len(runs.windows)):
        windows = [window for run in _without(runs.windows, k) for window in run]
        yield fit_windows(windows, runs.vessel, runs.prior, whole)


_ESTIMATES: dict[str, Callable[[_Runs], Iterator]] = {
    PATHS[0]: lambda runs: _regressions(runs, by_speed=True),
    PATHS[1]: lambda runs: _regressions(runs, by_speed=False),
    PATHS[2]: _weak_forms,
    PATHS[3]: _trajectories,
}


def _row(name: str, fits: Sequence[Estimated], runs: _Runs) -> dict:
    """Scores of the fits of a path, each judged on the run it was made without."""
    judged = score_folds(runs.windows, runs.vessel, fits)
    lost = [run for run, density in zip(runs.names, judged.log_density, strict=True) if np.isneginf(density)]
    lines, measured = [], 0
    for run, trial, manoeuvre, fit in zip(runs.names, runs.trials, runs.manoeuvres, fits, strict=True):
        if manoeuvre is not None:
            found = recorded_indices(trial, manoeuvre, runs.vessel.particulars.rudder_delay)
            rolls, table = "roll" in runs.vessel.dofs, manoeuvre.traits.indices
            known = [value for index, value in found.items() if rolls or not needs_roll(table[index])]
            measured += int(np.isfinite(known).sum())
            estimate = np.tile(fit.coefficients, (2, 1))
            lines += forecast_rows(run, trial, manoeuvre, [(runs.vessel, estimate)], np.ones(1))
    row = {"path": name, "log_density": float(judged.log_density.sum())}
    row |= {f"rms_{channel}": np.nan if lost else value for channel, value in judged.rms.items()}
    row |= overshoot_errors(lines) | {"reached": len(lines), "measured": measured, "remark": ""}
    if lost:
        row["remark"] = f"Fitted to the other runs, it cannot be simulated along {', '.join(lost)}."
    return row


def _failed(name: str, reason: str, runs: _Runs) -> dict:
    """Row of a path without coefficients."""
    rms = {f"rms_{channel}": np.nan for channel in runs.windows[0][0].run.channels}
    counts = {"reached": 0, "measured": 0, "remark": reason}
    return {"path": name, "log_density": -np.inf} | rms | overshoot_errors([]) | counts


def paths(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Compare the paths on the terms that weigh most; the text has the error of the overshoots of each."""
    vessel, out = vessel_argument(args.vessel, progress), writable_folder(args.out)
    files = [(path, args.format) for path in args.trials]
    any_speed = supports_part_sets(vessel)
    trials, _ = checked_trials(files, vessel, args, progress, any_speed=any_speed)
    runs, names = list(trials.values()), list(trials)
    found = identify_ship(runs, vessel, names=names, rng=np.random.default_rng(args.seed), progress=progress)
    best = next((one for one in found.candidates if not one.vessel.modular), None)
    if best is None:
        raise VesselError("Paths are compared on a set of terms, found parts of a vessel alone; name another vessel.")
    rows = compare_paths(runs, best.vessel, found.ship.prior, names=names, trajectory=best.held_out, progress=progress)
    with staged_files(out) as folder:
        write_rows(rows, folder / "paths.csv", digits=None)
    return f"On the terms of {best.name}:\n{_text(rows)}", out / "paths.csv"


def _text(rows: Sequence[Mapping]) -> str:
    """Score and errors of each path, and why one failed."""
    keys = ("log_density", "first_overshoot_angle_mean", "second_overshoot_angle_mean", "overshoot_time_median")
    header = ("path", "held-out score", "first overshoot [deg]", "second overshoot [deg]", "time to overshoot [%]")
    lines = table_text(header, [(row["path"], *(row[key] for key in keys)) for row in rows])
    return "\n".join([lines, *(f"{row['path']}: {row['remark']}" for row in rows if row["remark"])])


def parser() -> argparse.ArgumentParser:
    """Words of the command line of the study."""
    words = study_parser("paths", "compare rival paths to the coefficients of a ship on runs they were not given")
    words.add_argument("trials", metavar="TRIAL", nargs="+", help="records of two runs or more")
    words.add_argument("--format", metavar="FILE.toml", help="columns, units, signs, frame and scale of a TRIAL")
    words.add_argument("--vessel", required=True, help="shipped vessel or TOML file")
    words.add_argument("--out", required=True, help="folder of paths.csv")
    words.set_defaults(overrule=[], seed=2020)
    return words


if __name__ == "__main__":
    sys.exit(run_command(parser(), paths))
