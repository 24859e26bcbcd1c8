"""Term sets fitted to the runs of a ship, cross-validated, and accepted if feasible in standard manoeuvres."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from pymc_ship.inference.captive.fit import CaptiveFit, fit_captive, with_discrepancy
from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory.prior import CoefficientPrior, coefficient_prior, wide_prior
from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.sequential_likelihood import (
    EarlierLikelihood,
    commensurate_likelihood,
    joint_likelihood,
    window_likelihood,
)
from pymc_ship.inference.trajectory.windows import Window, WindowFit, fit_windows, inflate_covariance, prepared_windows
from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import FitError, InferenceError, TrialError
from pymc_ship.machine.threads import map_in_threads
from pymc_ship.physics.forces.screw import NOMINAL_REVOLUTIONS
from pymc_ship.physics.forces.surroundings import CURRENT
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.inputs import revolutions_measured
from pymc_ship.physics.vessel.hull_database import with_hull_database, with_typical_rudder
from pymc_ship.physics.vessel.parts import with_parts
from pymc_ship.physics.vessel.term_sets import (
    ANY_SPEED_SET,
    ROLL_SET,
    supports_part_sets,
    term_sets,
    valid_at_any_speed,
    with_terms,
)
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, per_facility_indices
from pymc_ship.records.checks.plausibility import DRIFT, SHORTEST_PIECE, piece_check, pieces_ahead, spans_text
from pymc_ship.records.checks.verdicts import SLOW
from pymc_ship.records.files.ship_scale import ship_scale
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.feasibility import Failure, first_failure, is_feasible
from pymc_ship.ships.ensemble.ship import Member
from pymc_ship.ships.identification.held_out import CrossValidation, cross_validate, hold_out_harder
from pymc_ship.trial.record import has_ground_speeds, nonzero_channels

PRIORS = ("hull_database", "order_damped", "sister_ship")
"""Kinds of prior for coefficients without an sd in the vessel file."""

LARGEST_INFLATION = 5.0  # largest factor on the sds of the coefficients
AHEAD_FRACTION = 0.5  # least fraction of the time ahead for models that are valid ahead alone
ROLL_ANGLE = 2.0  # 99 % quantile of the heel [deg] from which a ship counts as rolling
_SAME = 0.1  # largest relative range of constant revolutions
_GROUPS = 4  # folds of a single run
_TRIAL_DRAWS = 50  # draws for the test of feasibility
_MIN_FEASIBLE = 0.1  # least feasible fraction of them


@dataclass(frozen=True)
class Candidate:
    """One term set of the ensemble."""

    name: str
    fit: WindowFit  # to all runs; its sds and those of the fits below are multiplied by ``inflation``
    prior: CoefficientPrior
    held_out: CrossValidation
    inflation: float
    draws: np.ndarray  # (n_draws, n_coefficients); feasible
    weight: float = 0.0
    infeasible_fraction: float = 0.0
    milder: CrossValidation | None = None  # to the milder runs, for each of the harder ones
    captive: CaptiveFit | None = None
    discrepancy_scales: tuple[float, ...] = ()  # [prior sd]; of the commensurate prior on earlier runs

    def __repr__(self) -> str:
        return f"Candidate({self.name!r}, weight {self.weight:.3g}, {len(self.draws)} draws)"

    def densities(self, earlier: Mapping[str, EarlierLikelihood]) -> np.ndarray:
        """Log predictive density of earlier and present runs, (n_runs,)."""
        old = [earlier[self.name].log_density] if self.name in earlier else []
        return np.concatenate([*old, self.held_out.log_density])

    def likelihood(self, earlier: Mapping[str, EarlierLikelihood]) -> EarlierLikelihood:
        """Likelihood of earlier and present runs, for later identifications."""
        names, prior = tuple(coefficient_names(self.vessel)), self.prior
        windows = window_likelihood(self.fit, self.fit.prior, self.inflation)
        joint = joint_likelihood([prior.likelihood, windows]) or windows
        return EarlierLikelihood(names, joint, self.densities(earlier), prior.mean, prior.scale)

    def member(self, earlier: Mapping[str, EarlierLikelihood]) -> Member:
        """Member of the ensemble with this term set."""
        return Member(
            name=self.name,
            vessel=self.vessel,
            draws=self.draws,
            estimate=self.fit.coefficients,
            weight=self.weight,
            likelihood=self.likelihood(earlier),
            inflation=self.inflation,
            design_effect=self.fit.design_effect,
        )

    @property
    def vessel(self) -> Vessel:
        """Vessel with these terms."""
        return self.fit.vessel


@dataclass(frozen=True)
class Training:
    """Thinned trials with manoeuvres, facilities and the likelihoods of earlier runs."""

    trials: list[xr.Dataset]
    manoeuvres: list[Manoeuvre | None]
    facilities: dict[str, Steering]
    vessel: Vessel
    prior: str
    captive: xr.Dataset | None = None
    earlier: Mapping[str, EarlierLikelihood] = field(default_factory=dict)  # by term set
    harder: tuple[int, ...] = ()  # numbers of the runs that the others forecast
    elsewhere: bool = False  # whether the earlier runs were at other facilities
    reloaded: bool = False  # whether they were at another draught


def earlier_runs_remark(best: Candidate, training: Training) -> str:
    """Remark on the discrepancy between the best term set and the earlier runs."""
    shared, *of_facility = best.discrepancy_scales
    remark = (
        "The likelihood of earlier runs is included. The discrepancy of each coefficient has an sd of "
        f"{shared:.2g} of its prior sd"
    )
    if of_facility:
        parameters = [best.vessel.parameters[k] for k in per_facility_indices(best.vessel)]
        names = ", ".join(parameter.name for parameter in parameters)
        remark += f", that of the facility's coefficients ({names}) {of_facility[0]:.2g}"
    remark += f" ({best.name})."
    if training.reloaded:
        remark += (
            " The earlier runs were at another draught: a modular model has the same standardised deviation from its "
            "prior there, polynomial terms do not depend on the draught."
        )
    return remark


def prior_kind_of(vessel: Vessel, kind: str | None) -> str:
    """Kind of prior (InferenceError if unknown); by default the hull database if a draught is stated."""
    if kind is None:
        return "hull_database" if vessel.particulars.d > 0.0 else "order_damped"
    check_choice("The prior of a ship", kind, PRIORS, InferenceError)
    return kind


def with_prior_knowledge(vessel: Vessel, kind: str) -> Vessel:
    """Polynomial vessel with the prior values of the hull database or rudder; VesselError without a draught."""
    if vessel.modular or kind == "sister_ship":
        return vessel
    return with_hull_database(vessel) if kind == "hull_database" else with_typical_rudder(vessel)


def with_recorded_effects(vessel: Vessel, trials: Sequence[xr.Dataset]) -> Vessel:
    """Modular vessel with a current for speeds over ground and fixed nominal revolutions where they do not vary.

    TrialError where only some trials have revolutions.
    """
    if not vessel.modular:
        return vessel
    measured = [revolutions_measured(trial) for trial in trials]
    if any(measured) and not all(measured):
        silent = ", ".join(str(k + 1) for k, is_measured in enumerate(measured) if not is_measured)
        raise TrialError(
            f"Revolutions are measured in all {len(trials)} runs or in none, found none in run {silent}; "
            "add n there, or leave its column out of the others."
        )
    drifting = any(map(has_ground_speeds, trials))
    current = (CURRENT.name,) if drifting and CURRENT.name not in vessel.parts else ()
    fixed = () if all(measured) and _revolutions_vary(trials) else (NOMINAL_REVOLUTIONS,)
    return with_parts(vessel, (*vessel.parts, *current), {c.name: c for c in vessel.parameters}, fixed)


def _is_rolling(trials: Sequence[xr.Dataset]) -> bool:
    measured = all({"p", "phi"} <= set(nonzero_channels(trial)) for trial in trials)
    return measured and any(np.quantile(np.abs(trial["phi"].values), 0.99) > np.deg2rad(ROLL_ANGLE) for trial in trials)


def _revolutions_vary(trials: Sequence[xr.Dataset]) -> bool:
    low, high = np.quantile(np.concatenate([trial["n"].values for trial in trials]), [0.05, 0.95])
    return bool(high - low > _SAME * max(abs(low), abs(high)))


def window_prior(trials: Sequence[xr.Dataset], vessel: Vessel, kind: str) -> CoefficientPrior:
    """Prior of a window fit: wide for every coefficient of any order, or of a sister ship."""
    return coefficient_prior(trials, vessel, kind) if kind == "sister_ship" else wide_prior(trials, vessel)


def default_term_sets(training: Training) -> tuple[str, ...]:
    """Term sets that are valid for the runs: modular at any speed alone for runs mostly at rest or astern."""
    if not supports_part_sets(training.vessel):
        return term_sets(training.vessel)
    duration = sum(float(np.ptp(trial["time"].values)) for trial in training.trials)
    fraction_ahead = sum(_time_ahead(trial, training.vessel) for trial in training.trials) / duration
    if fraction_ahead < AHEAD_FRACTION:
        return (ANY_SPEED_SET,)
    heeling = (ROLL_SET,) if _is_rolling(training.trials) else ()
    return (*term_sets(training.vessel), *heeling, ANY_SPEED_SET)


def _time_ahead(trial: xr.Dataset, vessel: Vessel) -> float:
    """Duration [s] of the pieces of a record ahead; 0 with revolutions astern."""
    astern = "n" in trial and bool((trial["n"].values < 0.0).any())
    pieces = [] if astern else pieces_ahead(trial, ship_scale(trial, vessel))
    return float(sum(np.ptp(piece["time"].values) for piece in pieces))


@dataclass(frozen=True)
class Refusal:
    """A term set that was left out: reason, and the manoeuvre in which the fitted ship diverges."""

    name: str
    sentence: str
    vessel: Vessel | None = None
    failure: Failure | None = None


def fit_candidates(
    names: Sequence[str],
    training: Training,
    rng: np.random.Generator,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Candidate], list[Refusal]]:
    """Candidates of the term sets that can be fitted, and refusals of the others; ``rng`` is not advanced."""
    root, done = int(deepcopy(rng).integers(2**63)), count(1)

    def attempt(name: str, stream: np.random.Generator) -> Candidate | Refusal:
        result = _attempt(name, training, stream)
        progress(f"{next(done)} of {len(names)} term sets fitted")
        return result

    streams = {name: np.random.default_rng([root, k]) for k, name in enumerate(names)}
    duration = {name: (len(with_terms(training.vessel, name).parts), k) for k, name in enumerate(names)}
    longest_first = sorted(names, key=lambda name: duration[name], reverse=True)
    with threadpool_limits(limits=1, user_api="blas"):
        fitted = map_in_threads(attempt, longest_first, [streams[name] for name in longest_first])
    attempts = sorted(fitted, key=lambda one: names.index(one.name))
    candidates = [attempt for attempt in attempts if isinstance(attempt, Candidate)]
    refusals = [attempt for attempt in attempts if isinstance(attempt, Refusal)]
    if not candidates:
        reasons = " ".join(refusal.sentence for refusal in refusals)
        raise FitError(f"No term set can be fitted to these trials: {reasons}", refusals=refusals)
    return candidates, refusals


@dataclass(frozen=True)
class _Problem:
    """A term set with pieces and windows of the runs, and its prior; ``plain`` is the vessel without prior values."""

    name: str
    plain: Vessel
    vessel: Vessel
    trials: list[xr.Dataset]
    runs: list[list[Window]]
    prior: CoefficientPrior

    @property
    def windows(self) -> list[Window]:
        """Windows of all runs."""
        return [window for run in self.runs for window in run]


@dataclass(frozen=True)
class _Combined:
    """Fit of a term set with the likelihoods of captive tests and earlier runs."""

    fit: WindowFit
    prior: CoefficientPrior
    captive: CaptiveFit | None
    discrepancy_scales: tuple[float, ...]


def _attempt(name: str, training: Training, rng: np.random.Generator) -> Candidate | Refusal:
    try:
        problem = _with_prior(name, training)
        combined = _combine(problem, _fit(problem), training)
        candidate = _cross_validate(problem, combined, training)
    except FitError as error:
        return Refusal(name, f"The {name} terms were left out: {error}")
    return _accept(candidate, rng)


def _with_prior(name: str, training: Training) -> _Problem:
    plain = with_recorded_effects(with_terms(training.vessel, name), training.trials)
    vessel = with_prior_knowledge(plain, training.prior)
    trials = [piece for trial in training.trials for piece in modelled_pieces(trial, vessel)]
    runs = [modelled_windows(trial, vessel, k) for k, trial in enumerate(training.trials)]
    return _Problem(name, plain, vessel, trials, runs, window_prior(trials, vessel, training.prior))


def _fit(problem: _Problem) -> WindowFit:
    """Fit to all windows, from the weak form or, where that diverges, from that with a damped prior."""

    def from_weak_form(law: CoefficientPrior) -> WindowFit:
        start = weak_form_start(problem.trials, problem.vessel, law.mean, law.scale, method="rk4")
        return fit_windows(problem.windows, problem.vessel, problem.prior, start)

    try:
        return from_weak_form(problem.prior)
    except FitError:
        if problem.plain.modular:
            raise
        return from_weak_form(coefficient_prior(problem.trials, problem.plain).fixed)


def _combine(problem: _Problem, fit: WindowFit, training: Training) -> _Combined:
    prior, vessel = problem.prior, problem.vessel
    captive_fit, earlier_likelihood = None, None
    discrepancy_scales: tuple[float, ...] = ()
    if training.captive is not None:
        captive_fit = fit_captive(training.captive, vessel, prior)
        captive_fit = with_discrepancy(captive_fit, prior, fit.coefficients, fit.covariance)
    if problem.name in training.earlier:
        earlier = training.earlier[problem.name]
        if training.reloaded and vessel.modular:
            earlier = earlier.at_draught(coefficient_names(vessel), prior)
        covariance = np.linalg.inv(fit.information)  # without the sandwich, which is too narrow for few windows
        facility_indices = per_facility_indices(vessel) if training.elsewhere else ()
        earlier_likelihood, discrepancy_scales = commensurate_likelihood(
            earlier.for_vessel(vessel), prior, fit.coefficients, covariance, facility_indices
        )
    likelihood = joint_likelihood([earlier_likelihood, captive_fit.likelihood if captive_fit else None])
    if likelihood is not None:
        prior = replace(prior, likelihood=likelihood)
        fit = fit_windows(problem.windows, vessel, prior, fit)
    return _Combined(fit, prior, captive_fit, discrepancy_scales)


def _cross_validate(problem: _Problem, combined: _Combined, training: Training) -> Candidate:
    vessel, whole = problem.vessel, combined.fit

    def fit(windows: Sequence[Window]) -> WindowFit:
        return fit_windows(windows, vessel, combined.prior, whole)

    scored_windows = _windows_ahead(training, vessel) if valid_at_any_speed(vessel) else None
    validation = cross_validate(folds(problem.runs), vessel, fit, scored_windows)
    inflation = _inflation(whole, validation)
    whole, *others = (inflate_covariance(single_fit, inflation) for single_fit in (whole, *validation.fits))
    held_out, milder = replace(validation, fits=tuple(others)), None
    if training.harder:
        milder = hold_out_harder(problem.runs, training.harder, vessel, fit, validation)
        milder = replace(milder, fits=tuple(inflate_covariance(one, inflation) for one in milder.fits))
    return Candidate(
        name=problem.name,
        fit=whole,
        prior=combined.prior,
        held_out=held_out,
        milder=milder,
        inflation=inflation,
        draws=np.empty((0, whole.coefficients.size)),
        captive=combined.captive,
        discrepancy_scales=combined.discrepancy_scales,
    )


def _accept(candidate: Candidate, rng: np.random.Generator) -> Candidate | Refusal:
    """The candidate, or its refusal where the estimate or most draws diverge in a standard manoeuvre."""
    vessel, fit, name = candidate.vessel, candidate.fit, candidate.name
    draws = np.vstack([fit.coefficients, randomize_then_optimize(fit, _TRIAL_DRAWS, rng)])
    feasible = is_feasible(vessel, draws)
    if feasible[0] and feasible.mean() >= _MIN_FEASIBLE:
        return candidate
    failure = first_failure(vessel, draws[np.argmin(feasible)])
    fraction = "" if not feasible[0] else f" in {100.0 * (1.0 - feasible.mean()):.0f} % of the draws"
    sentence = f"The {name} terms were left out: the simulation of the fitted ship diverges{fraction}"
    return Refusal(name, f"{sentence}, {failure}.", vessel, failure)


def partial_run_remarks(names: Sequence[str], training: Training, candidates: Sequence[Candidate]) -> list[str]:
    """Remarks on runs of which pieces alone were fitted."""
    ahead = [candidate.vessel for candidate in candidates if not valid_at_any_speed(candidate.vessel)]
    remarks = []
    for name, trial in zip(names, training.trials, strict=True) if ahead else ():
        pieces = modelled_pieces(trial, ahead[0])
        if sum(piece.sizes["time"] for piece in pieces) < trial.sizes["time"]:
            remarks.append(
                f"Run {name}: sets for a ship ahead were fitted to the piece{'s' * (len(pieces) > 1)} "
                f"{spans_text(pieces)}; in the rest the ship is below {SLOW:.0%} of its speed, drifts by more than "
                f"{DRIFT:g} of it, turns on the spot, or moves ahead for less than {SHORTEST_PIECE:g} L/U."
            )
    return remarks


def _windows_ahead(training: Training, vessel: Vessel) -> list[Sequence[Window]] | None:
    ahead = [pieces_ahead(trial, ship_scale(trial, vessel)) for trial in training.trials]
    if len(ahead) < 2 or not all(ahead):
        return None
    return [_windows(pieces, vessel, k) for k, pieces in enumerate(ahead)]


def modelled_pieces(trial: xr.Dataset, vessel: Vessel) -> list[xr.Dataset]:
    """Pieces of a record in which the forces of a vessel are valid; FitError where none is long enough."""
    if valid_at_any_speed(vessel):
        return [trial]
    scale = ship_scale(trial, vessel)
    pieces = pieces_ahead(trial, scale)
    if not pieces:
        raise FitError(piece_check(trial, scale).sentence)
    return pieces


def modelled_windows(trial: xr.Dataset, vessel: Vessel, number: int = 0) -> list[Window]:
    """Windows of all :func:`modelled_pieces` of a thinned record, the trial of this number."""
    return _windows(modelled_pieces(trial, vessel), vessel, number)


def _windows(pieces: Sequence[xr.Dataset], vessel: Vessel, number: int) -> list[Window]:
    return [window for piece in pieces for window in prepared_windows(piece, vessel, number)]


def folds(runs: Sequence[Sequence[Window]]) -> list[Sequence[Window]]:
    """Folds: the windows of a run, or groups of neighbours for a single run."""
    if len(runs) > 1:
        return list(runs)
    parts = np.array_split(np.arange(len(runs[0])), min(_GROUPS, len(runs[0])))
    return [[runs[0][k] for k in part.tolist()] for part in parts if part.size]


def _inflation(whole: WindowFit, validation: CrossValidation) -> float:
    """Factor on the sds, 1 or more: observed over expected change of the coefficients with each run that is added.

    Expected change: the covariance without the run minus that with it, as the posterior mean is a martingale. The
    metric is the information of the windows; without a prior this is the jackknife over runs.
    """
    prior_precision, window_precision = _precisions(whole)
    covariance = np.linalg.inv(prior_precision + window_precision)
    observed = expected = 0.0
    for fit in validation.fits:
        prior, windows = _precisions(fit)
        spread = np.mean([np.log(sd / whole.effective_sd[name]) for name, sd in fit.effective_sd.items()])
        without = np.linalg.inv(prior + np.exp(2.0 * spread) * windows)
        change = fit.coefficients - whole.coefficients  # its covariance is that without the run less that with it
        observed += change @ window_precision @ change
        expected += np.trace(window_precision @ (without - covariance))
    return float(np.clip(np.sqrt(observed / expected), 1.0, LARGEST_INFLATION)) if expected > 0.0 else 1.0


def _precisions(fit: WindowFit) -> tuple[np.ndarray, np.ndarray]:
    prior_precision = fit.information @ fit.from_prior @ fit.information
    return prior_precision, fit.information - prior_precision
