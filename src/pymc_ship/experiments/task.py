"""One task of a Monte-Carlo study: one method on one ship, manoeuvre, noise and seed.

The noise does not depend on the method, so all methods have the same records.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from time import perf_counter, process_time

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.mode import trajectory_mode
from pymc_ship.machine.errors import StudyError
from pymc_ship.machine.seeds import generator
from pymc_ship.machine.threads import one_thread
from pymc_ship.machine.workers import MACHINE, error_text
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, turning_circle
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel, reference_coefficients
from pymc_ship.records.denoising.denoise import denoise
from pymc_ship.records.files.noise import noisy_trial
from pymc_ship.replication.estimates import (
    DIFFERENCES,
    Estimate,
    regression_estimate,
    trajectory_estimate,
    weak_form_estimate,
)

SCORES = ("median_error", "coverage", "coverage_half", "tactical_diameter_error")
"""Scores of a task, all in %: median coefficient error, references inside the intervals of 90 %, tactical diameter."""

STAGES = ("simulate", "pollute", "fit", "score")  # stages of a task, which are timed [s]

STATUSES = ("ok", "diverged", "failed")
"""How a task ends. `ok`: fitted and scored. `diverged`: fitted, but the fitted ship leaves the model's range in the
turn. `failed`: no coefficients."""

TURN, TURN_DURATION = turning_circle(35), 22.0  # manoeuvre whose tactical diameter is forecast, and its duration [L/U]


def _differences(noisy: xr.Dataset, vessel: Vessel, derivative: str, interval: float | None) -> Estimate:
    return regression_estimate(denoise(noisy), vessel, derivative=derivative, interval=interval)


def _trajectory(noisy: xr.Dataset, vessel: Vessel, prior: str) -> Estimate:
    return trajectory_estimate(trajectory_mode(noisy, vessel, prior, method="euler").choice.fit)


Method = Callable[[xr.Dataset, Vessel], Estimate]
"""A method takes a noisy record and the vessel and returns coefficients with their intervals."""

METHODS: dict[str, Method] = {
    "paper's pipeline": partial(_differences, derivative="euler", interval=1.0),
    **{name: partial(_differences, derivative=how[0], interval=how[1]) for name, how in DIFFERENCES.items()},
    "weak form": partial(weak_form_estimate, method="euler"),
    "trajectory fit": partial(_trajectory, prior="order_damped"),
    "trajectory fit, flat prior": partial(_trajectory, prior="flat"),
}
"""Ways from a noisy record of Euler steps to coefficients, all with the settings of the
study of the Cramer-Rao bound."""


@dataclass(frozen=True)
class Cell:
    """One cell of the grid; every field is a column of the results."""

    ship: str
    manoeuvre: str
    noise: str
    level: float
    method: str


@dataclass(frozen=True)
class Task:
    """One method on one data set."""

    vessel: Vessel  # of the record
    manoeuvre: Manoeuvre  # of the record, simulated in Euler steps of 0.02 s
    noise: str  # key of NOISES
    level: float  # as in ps.pollute
    method: str  # key of METHODS, or the name of ``own``
    seed: int  # number of the data set
    root: int  # of every random number
    duration: float  # [s]
    block: str = ""  # part of the result in the store
    own: Method | None = None  # user-defined method

    def rng(self) -> np.random.Generator:
        """Generator of the noise, the same for every method."""
        data_set = self.vessel.name, self.manoeuvre.label, self.noise, self.level, self.seed
        return generator(self.root, "Monte-Carlo noise", *data_set)


class _NoCoefficientsError(ValueError):
    """A record to which no ship can be fitted."""


def measure_task(task: Task) -> dict:
    """Simulate, pollute, fit and score; a method that fails gives a result with a sentence.

    Keys: ``block``, ``seed``, ``status`` (of :data:`STATUSES`), ``sentence`` (why it is not ok), those of
    :data:`SCORES` [%, NaN where there is none], those of :data:`STAGES` [s] and ``cpu``, the processor time [s].
    StudyError for a method that returns no :class:`Estimate`; errors of :data:`pymc_ship.machine.workers.MACHINE` pass.
    """
    began, seconds, scores = process_time(), dict.fromkeys(STAGES, 0.0), dict.fromkeys(SCORES, float("nan"))
    with one_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            status, sentence = _fit_and_score(task, seconds, scores)
        except (*MACHINE, StudyError):  # says nothing of how well the method does
            raise
        except Exception as error:  # whatever goes wrong in a method is what the study is to find out
            scores, status = dict.fromkeys(SCORES, float("nan")), "failed"
            sentence = error_text(error)
    identity = {"block": task.block, "seed": task.seed, "status": status, "sentence": sentence}
    return identity | scores | seconds | {"cpu": process_time() - began}


def empty_result(task: Task) -> dict:
    """Result of an empty task, from which the cost of saving results is measured."""
    empty = dict.fromkeys(SCORES, float("nan")) | dict.fromkeys((*STAGES, "cpu"), 0.0)
    return {"block": task.block, "seed": task.seed, "status": "ok", "sentence": ""} | empty


def _fit_and_score(task: Task, seconds: dict[str, float], scores: dict[str, float]) -> tuple[str, str]:
    with stopwatch(seconds, "simulate"):
        clean = simulate(task.vessel, task.manoeuvre, duration=task.duration)
        if clean["diverged"]:
            raise _NoCoefficientsError(f"the record diverged at t = {float(clean['diverged_at']):g} s")
    with stopwatch(seconds, "pollute"):
        noisy = noisy_trial(clean, task.level, task.noise, task.rng())
    with stopwatch(seconds, "fit"):
        estimate = (task.own or METHODS[task.method])(noisy, task.vessel)
    _check_estimate(task, estimate)
    with stopwatch(seconds, "score"):
        errors = estimate.scores(task.vessel)
        if not np.isfinite(estimate.coefficients).all():
            raise _NoCoefficientsError("the coefficients are not finite")
        scores |= {"median_error": errors["median"]} | {name: errors[name] for name in ("coverage", "coverage_half")}
        scores["tactical_diameter_error"], diverged_at = turn_error(task.vessel, estimate.coefficients)
    if np.isfinite(diverged_at):
        return "diverged", f"the identified ship diverged in the {TURN.label} at t = {diverged_at:g} s"
    return "ok", ""


def _check_estimate(task: Task, estimate: object) -> None:
    size = reference_coefficients(task.vessel).size
    returned = f"a {type(estimate).__name__}"
    if isinstance(estimate, Estimate):
        shapes = [np.shape(value) for value in (estimate.coefficients, estimate.lower, estimate.upper)]
        if shapes == 3 * [(size,)]:
            return
        returned = f"shapes {', '.join(map(str, shapes))}"
    raise StudyError(
        f"The method {task.method!r} must return an Estimate whose coefficients, lower and upper have shape ({size},) "
        f"for {task.vessel.name!r}, found {returned}; correct it."
    )


def turn_error(vessel: Vessel, coefficients: np.ndarray) -> tuple[float, float]:
    """Error of the tactical diameter [%] and time at which the turn diverged [s], NaN where there is none."""
    ships = np.stack([coefficients, reference_coefficients(vessel)])
    duration = TURN_DURATION * vessel.particulars.ship_time
    turned = simulate(vessel, TURN, duration=duration, coefficients=ships, **simulation_settings(vessel))
    diameter = indices(turned)["tactical_diameter"].values
    diverged_at = float(turned["diverged_at"].values[0])
    error = float("nan") if np.isfinite(diverged_at) else 100.0 * abs(float(diameter[0] / diameter[1]) - 1.0)
    return error, diverged_at


@contextmanager
def stopwatch(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Add the elapsed seconds to those of a stage."""
    start = perf_counter()
    try:
        yield
    finally:
        seconds[name] += perf_counter() - start
