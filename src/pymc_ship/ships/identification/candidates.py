"""Term sets fitted to the runs of a ship: each with its prior, judged by held-out runs and by standard manoeuvres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from pymc_ship.inference.captive.fit import CaptiveFit, fit_captive, with_discrepancy
from pymc_ship.inference.rows.weak_form import weak_form_start
from pymc_ship.inference.trajectory.prior import CoefficientPrior, GaussianLikelihood, coefficient_prior
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
from pymc_ship.machine.threads import thread_pool
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
from pymc_ship.records.checks.plausibility import DRIFT, SHORTEST_PIECE, piece_check, pieces_ahead
from pymc_ship.records.checks.verdicts import SLOW, ship_scale
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.feasibility import Failure, first_failure, is_feasible
from pymc_ship.ships.ensemble.ship import Member
from pymc_ship.ships.identification.held_out import CrossValidation, cross_validate
from pymc_ship.trial.record import OVER_GROUND, nonzero_channels

PRIORS = ("hull_database", "order_damped", "sister_ship")
"""What is known of the coefficients beforehand, beside those the vessel file states with an sd."""

LARGEST_INFLATION = 5.0
"""Bound of the factor on the standard deviations of the coefficients."""

AHEAD_FRACTION = 0.5
"""Share of the time that a ship sails ahead, from which models for that alone can hold her records."""

ROLL_ANGLE = 2.0
"""Heel [deg] that a record reaches for one instant in a hundred, from which a ship rolls."""

_SAME = 0.1  # share by which revolutions differ that are counted as alike
_GROUPS = 4  # of the windows of a single run
_TRIAL_DRAWS = 50  # draws of a term set that are tried in the standard manoeuvres
_MIN_FEASIBLE = 0.1  # share of them that must not run away


@dataclass(frozen=True)
class Candidate:
    """One term set of the ensemble.

    ``fit`` is to all runs, widened by the factor ``inflation`` from how far each run moves it, and so
    are those fits in ``held_out``; ``weight`` is its share of the ensemble, ``draws`` (n_draws, n_coefficients) those
    of its law that do not run away, ``infeasible_fraction`` of all drawn did. ``prior`` is that of the
    windows, ``captive`` what captive tests say beside it, ``discrepancy_scales`` how far the
    coefficients may differ from those of earlier runs [prior sd], see
    :func:`pymc_ship.inference.trajectory.sequential_likelihood.commensurate_likelihood`; empty without any.
    """

    name: str
    fit: WindowFit
    prior: CoefficientPrior
    held_out: CrossValidation
    inflation: float
    draws: np.ndarray
    weight: float = 0.0
    infeasible_fraction: float = 0.0
    captive: CaptiveFit | None = None
    discrepancy_scales: tuple[float, ...] = ()

    def __repr__(self) -> str:
        """Name, weight and number of draws."""
        return f"Candidate({self.name!r}, weight {self.weight:.3g}, {len(self.draws)} draws)"

    @property
    def gaussian_likelihood(self) -> GaussianLikelihood:
        """All that data have said of these coefficients: the windows of the runs, and what stood beside the prior."""
        windows = window_likelihood(self.fit, self.fit.prior, self.inflation)
        return joint_likelihood([self.prior.likelihood, windows]) or windows

    def densities(self, earlier: Mapping[str, EarlierLikelihood]) -> np.ndarray:
        """Log predictive density of every run so far, (n_runs,)."""
        old = [earlier[self.name].log_density] if self.name in earlier else []
        return np.concatenate([*old, self.held_out.log_density])

    def likelihood(self, earlier: Mapping[str, EarlierLikelihood]) -> EarlierLikelihood:
        """Likelihood of all runs so far, for runs to come."""
        names, prior = tuple(coefficient_names(self.vessel)), self.prior
        return EarlierLikelihood(names, self.gaussian_likelihood, self.densities(earlier), prior.mean, prior.scale)

    def member(self, earlier: Mapping[str, EarlierLikelihood]) -> Member:
        """Member of the ensemble that this term set is."""
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
    """Thinned trials and what was recognised of them.

    ``earlier`` is what earlier runs said, by term set; ``elsewhere`` that they were at other facilities, ``reloaded``
    that they were at another draught.
    """

    trials: list[xr.Dataset]
    manoeuvres: list[Manoeuvre | None]
    facilities: dict[str, Steering]
    vessel: Vessel
    prior: str
    captive: xr.Dataset | None = None
    earlier: Mapping[str, EarlierLikelihood] = field(default_factory=dict)
    elsewhere: bool = False
    reloaded: bool = False


def earlier_runs_remark(best: Candidate, training: Training) -> str:
    """Sentence on how far the best term set differs from what earlier runs said of it."""
    shared, *own = best.discrepancy_scales
    said = f"Earlier runs stand beside the prior. Each coefficient differs from theirs by {shared:.2g} of its prior sd"
    if own:
        parameters = [best.vessel.parameters[k] for k in per_facility_indices(best.vessel)]
        names = ", ".join(parameter.name for parameter in parameters)
        said += f", those that may belong to the facility ({names}) by {own[0]:.2g}"
    said += f" ({best.name})."
    if training.reloaded:
        said += (
            " They were sailed at another draught: a ship of parts is taken to be as many prior sd from what is "
            "typical as there, and terms of a polynomial know no draught."
        )
    return said


def prior_kind_of(vessel: Vessel, kind: str | None) -> str:
    """The kind of prior asked for (InferenceError if unknown); by default the hull database if a draught is stated."""
    if kind is None:
        return "hull_database" if vessel.particulars.d > 0.0 else "order_damped"
    check_choice("The prior of a ship", kind, PRIORS, InferenceError)
    return kind


def with_prior_knowledge(vessel: Vessel, kind: str) -> Vessel:
    """Vessel of terms whose coefficients hold what the prior of this kind knows; VesselError without a draught.

    A sister ship's values are known by themselves.
    """
    if vessel.modular or kind == "sister_ship":
        return vessel
    return with_hull_database(vessel) if kind == "hull_database" else with_typical_rudder(vessel)


def with_recorded_effects(vessel: Vessel, trials: Sequence[xr.Dataset]) -> Vessel:
    """Vessel of parts with what the records leave open and without what they cannot tell; others are as they are.

    There is a current in every trial where speeds were measured over ground. The nominal revolutions are as stated
    unless those of the trials vary: alike in all, they tell no more than the approach. TrialError where only some
    trials measured them.
    """
    if not vessel.modular:
        return vessel
    measured = [revolutions_measured(trial) for trial in trials]
    if any(measured) and not all(measured):
        silent = ", ".join(str(k + 1) for k, one in enumerate(measured) if not one)
        raise TrialError(
            f"Revolutions are measured in all {len(trials)} runs or in none, found none in run {silent}; "
            "add n there, or leave its column out of the others."
        )
    drifting = any(trial.attrs.get("speeds") == OVER_GROUND for trial in trials)
    current = (CURRENT.name,) if drifting and CURRENT.name not in vessel.parts else ()
    held = () if all(measured) and _revolutions_vary(trials) else (NOMINAL_REVOLUTIONS,)
    return with_parts(vessel, (*vessel.parts, *current), {c.name: c for c in vessel.parameters}, held)


def _is_rolling(trials: Sequence[xr.Dataset]) -> bool:
    """Whether roll can be told from the trials."""
    measured = all({"p", "phi"} <= set(nonzero_channels(trial)) for trial in trials)
    return measured and any(np.quantile(np.abs(trial["phi"].values), 0.99) > np.deg2rad(ROLL_ANGLE) for trial in trials)


def _revolutions_vary(trials: Sequence[xr.Dataset]) -> bool:
    """Whether the revolutions differ within the trials or between them."""
    low, high = np.quantile(np.concatenate([trial["n"].values for trial in trials]), [0.05, 0.95])
    return bool(high - low > _SAME * max(abs(low), abs(high)))


def window_prior(trials: Sequence[xr.Dataset], vessel: Vessel, kind: str) -> CoefficientPrior:
    """Prior of a window fit of an informed vessel; a wide one for every coefficient, whatever its order."""
    return coefficient_prior(trials, vessel, "sister_ship" if kind == "sister_ship" else "order_damped", damping=1.0)


def default_term_sets(training: Training) -> tuple[str, ...]:
    """Term sets that can hold the runs.

    Terms and the hull of the MMG standard method are for a ship that makes way ahead. Parts that hold at any speed have
    a cross flow in place of the cubic terms: two accounts of the same hull, which differ most where no run has been,
    and between which the records decide. Where the runs are for the most part at rest or astern, there are the parts
    alone. A ship that heels is tried with and without roll.
    """
    if not supports_part_sets(training.vessel):
        return term_sets(training.vessel)
    duration = sum(float(np.ptp(trial["time"].values)) for trial in training.trials)
    share = sum(_time_ahead(trial, training.vessel) for trial in training.trials) / duration
    if share < AHEAD_FRACTION:
        return (ANY_SPEED_SET,)
    heeling = (ROLL_SET,) if _is_rolling(training.trials) else ()
    return (*term_sets(training.vessel), *heeling, ANY_SPEED_SET)


def _time_ahead(trial: xr.Dataset, vessel: Vessel) -> float:
    """Length [s] of the pieces of a record in which the ship sails ahead; 0 of one with revolutions astern."""
    astern = "n" in trial and bool((trial["n"].values < 0.0).any())
    found = [] if astern else pieces_ahead(trial, ship_scale(trial, vessel))
    return float(sum(np.ptp(piece["time"].values) for piece in found))


@dataclass(frozen=True)
class Refusal:
    """A term set that was left out: why, and where the fitted ship runs away, where it could be fitted."""

    name: str
    sentence: str
    vessel: Vessel | None = None
    failure: Failure | None = None


def fit_candidates(
    wanted: Sequence[str], training: Training, rng: np.random.Generator
) -> tuple[list[Candidate], list[Refusal]]:
    """Candidates of the term sets that can be fitted, and refusals of the others; ``rng`` itself stays as it is."""
    root = int(deepcopy(rng).integers(2**63))
    with threadpool_limits(limits=1, user_api="blas"), thread_pool(len(wanted)) as pool:
        streams = [np.random.default_rng([root, k]) for k in range(len(wanted))]
        attempts = list(pool.map(lambda name, own: _attempt(name, training, own), wanted, streams))
    found = [attempt for attempt in attempts if isinstance(attempt, Candidate)]
    refusals = [attempt for attempt in attempts if isinstance(attempt, Refusal)]
    if not found:
        said = " ".join(one.sentence for one in refusals)
        raise FitError(f"No term set can be fitted to these trials: {said}", refusals=refusals)
    return found, refusals


@dataclass(frozen=True)
class _Problem:
    """A term set with the pieces and windows of the runs that its forces can represent, and its prior.

    ``plain`` is the vessel without what the prior knows of it, from which a fit can begin.
    """

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
    """Fit and prior of a term set with the likelihoods that stand beside the prior, see :class:`Candidate`."""

    fit: WindowFit
    prior: CoefficientPrior
    captive: CaptiveFit | None
    discrepancy_scales: tuple[float, ...]


def _attempt(name: str, training: Training, rng: np.random.Generator) -> Candidate | Refusal:
    """Candidate of a term set, or why there is none; ``rng`` draws the ships that are tried."""
    try:
        problem = _with_prior(name, training)
        combined = _combine(problem, _fit(problem), training)
        candidate = _hold_out(problem, combined, training)
    except FitError as error:
        return Refusal(name, f"The {name} terms were left out: {error}")
    return _accept(candidate, rng)


def _with_prior(name: str, training: Training) -> _Problem:
    """Windows of a term set with the prior of its coefficients."""
    plain = with_recorded_effects(with_terms(training.vessel, name), training.trials)
    vessel = with_prior_knowledge(plain, training.prior)
    trials = [piece for trial in training.trials for piece in modelled_pieces(trial, vessel)]
    runs = [modelled_windows(trial, vessel, k) for k, trial in enumerate(training.trials)]
    return _Problem(name, plain, vessel, trials, runs, window_prior(trials, vessel, training.prior))


def _fit(problem: _Problem) -> WindowFit:
    """Fit to all windows.

    It begins at the weak form or, where that ship leaves the model's range, at that of the plain vessel with a prior
    that damps high orders.
    """

    def from_weak_form(law: CoefficientPrior) -> WindowFit:
        start = weak_form_start(problem.trials, problem.vessel, law.mean, law.scale, method="rk4")
        return fit_windows(problem.windows, problem.vessel, problem.prior, start)

    try:
        return from_weak_form(problem.prior)
    except FitError:
        if problem.plain.modular:
            raise
        return from_weak_form(coefficient_prior(problem.trials, problem.plain))


def _combine(problem: _Problem, fit: WindowFit, training: Training) -> _Combined:
    """The fit with the likelihoods of earlier runs and of captive tests beside the prior."""
    prior, vessel = problem.prior, problem.vessel
    tests, before = None, None
    discrepancy_scales: tuple[float, ...] = ()
    if training.captive is not None:
        tests = fit_captive(training.captive, vessel, prior)
        tests = with_discrepancy(tests, prior, fit.coefficients, fit.covariance)
    if problem.name in training.earlier:
        earlier = training.earlier[problem.name]
        if training.reloaded and vessel.modular:
            earlier = earlier.at_draught(coefficient_names(vessel), prior)
        known = np.linalg.inv(fit.information)  # the scatter of a few windows would claim to know too much
        own = per_facility_indices(vessel) if training.elsewhere else ()
        before, discrepancy_scales = commensurate_likelihood(
            earlier.for_vessel(vessel), prior, fit.coefficients, known, own
        )
    beside = joint_likelihood([before, tests.likelihood if tests else None])
    if beside is not None:
        prior = replace(prior, likelihood=beside)
        fit = fit_windows(problem.windows, vessel, prior, fit.coefficients, fit.effective_sd)
    return _Combined(fit, prior, tests, discrepancy_scales)


def _hold_out(problem: _Problem, combined: _Combined, training: Training) -> Candidate:
    """Candidate judged by the runs that are left out in turn, and widened by how far each run moves it."""
    vessel, whole = problem.vessel, combined.fit

    def fit(windows: Sequence[Window]) -> WindowFit:
        return fit_windows(windows, vessel, combined.prior, whole.coefficients, whole.effective_sd)

    shared = _shared(training, vessel) if valid_at_any_speed(vessel) else None
    judged = cross_validate(folds(problem.runs), vessel, fit, shared)
    inflation = _inflation(whole, judged)
    whole, *others = (inflate_covariance(one, inflation) for one in (whole, *judged.fits))
    return Candidate(
        name=problem.name,
        fit=whole,
        prior=combined.prior,
        held_out=replace(judged, fits=tuple(others)),
        inflation=inflation,
        draws=np.empty((0, whole.coefficients.size)),
        captive=combined.captive,
        discrepancy_scales=combined.discrepancy_scales,
    )


def _accept(candidate: Candidate, rng: np.random.Generator) -> Candidate | Refusal:
    """The candidate, or its refusal where the estimate or most draws are not feasible in a standard manoeuvre."""
    vessel, fit, name = candidate.vessel, candidate.fit, candidate.name
    tried = np.vstack([fit.coefficients, randomize_then_optimize(fit, _TRIAL_DRAWS, rng)])
    good = is_feasible(vessel, tried)
    if good[0] and good.mean() >= _MIN_FEASIBLE:
        return candidate
    failure = first_failure(vessel, tried[np.argmin(good)])
    share = "" if not good[0] else f" in {100.0 * (1.0 - good.mean()):.0f} % of the draws"
    sentence = f"The {name} terms were left out: fitted to these trials, they make a ship that runs away{share}"
    return Refusal(name, f"{sentence}, {failure}.", vessel, failure)


def partial_run_remarks(names: Sequence[str], training: Training, found: Sequence[Candidate]) -> list[str]:
    """Sentences on the runs of which some sets were fitted to pieces alone."""
    ahead = [candidate.vessel for candidate in found if not valid_at_any_speed(candidate.vessel)]
    told = []
    for name, trial in zip(names, training.trials, strict=True) if ahead else ():
        pieces = modelled_pieces(trial, ahead[0])
        if sum(piece.sizes["time"] for piece in pieces) < trial.sizes["time"]:
            ends = [piece["time"].values[[0, -1]] for piece in pieces]
            spans = " and ".join(f"from {begin:.4g} to {end:.4g} s" for begin, end in ends)
            told.append(
                f"Run {name}: sets for a ship ahead were fitted to the piece{'s' * (len(ends) > 1)} {spans}; in the "
                f"rest she is below {SLOW:.0%} of her speed, drifts by more than {DRIFT:g} of it or turns on the spot, "
                f"or sails ahead for less than {SHORTEST_PIECE:g} L/U."
            )
    return told


def _shared(training: Training, vessel: Vessel) -> list[Sequence[Window]] | None:
    """Windows of each run in which all sets can be judged: those ahead; None where they are not of every run."""
    ahead = [pieces_ahead(trial, ship_scale(trial, vessel)) for trial in training.trials]
    if len(ahead) < 2 or not all(ahead):
        return None
    return [_windows(pieces, vessel, k) for k, pieces in enumerate(ahead)]


def modelled_pieces(trial: xr.Dataset, vessel: Vessel) -> list[xr.Dataset]:
    """The pieces of a record that the forces of a vessel hold: all of it, or those in which she sails ahead.

    FitError where none is long enough.
    """
    if valid_at_any_speed(vessel):
        return [trial]
    scale = ship_scale(trial, vessel)
    found = pieces_ahead(trial, scale)
    if not found:
        raise FitError(piece_check(trial, scale).sentence)
    return found


def longest_modelled_piece(trial: xr.Dataset, vessel: Vessel) -> xr.Dataset:
    """The longest of :func:`modelled_pieces`, the first of equal ones."""
    return max(modelled_pieces(trial, vessel), key=lambda piece: piece.sizes["time"])


def modelled_windows(trial: xr.Dataset, vessel: Vessel, number: int = 0) -> list[Window]:
    """Windows of all :func:`modelled_pieces` of a thinned record, the trial of this number."""
    return _windows(modelled_pieces(trial, vessel), vessel, number)


def _windows(pieces: Sequence[xr.Dataset], vessel: Vessel, number: int) -> list[Window]:
    return [window for piece in pieces for window in prepared_windows(piece, vessel, number)]


def folds(runs: Sequence[Sequence[Window]]) -> list[Sequence[Window]]:
    """Windows to be held out together: those of a run, or neighbours where there is only one."""
    if len(runs) > 1:
        return list(runs)
    parts = np.array_split(np.arange(len(runs[0])), min(_GROUPS, len(runs[0])))
    return [[runs[0][k] for k in part.tolist()] for part in parts if part.size]


def _inflation(whole: WindowFit, judged: CrossValidation) -> float:
    """Factor on the sd of the coefficients from how far they move with each run that is added, 1 or more.

    Were model and prior right, the mean of a posterior would be a martingale: a run moves it by the covariance without
    the run less that with it. Without a prior this is the jackknife over runs, whose windows share what the run has of
    its own; with one, what a lone run leaves to the prior is no scatter. The traces are taken in the metric of the
    windows' own information, where what they determine counts and not the prior.
    """
    known, own = _precisions(whole)
    covariance = np.linalg.inv(known + own)
    found = expected = 0.0
    for fit in judged.fits:
        prior, windows = _precisions(fit)
        spread = np.mean([np.log(sd / whole.effective_sd[name]) for name, sd in fit.effective_sd.items()])
        without = np.linalg.inv(prior + np.exp(2.0 * spread) * windows)
        moved = fit.coefficients - whole.coefficients
        found, expected = found + moved @ own @ moved, expected + np.trace(own @ (without - covariance))
    return float(np.clip(np.sqrt(found / expected), 1.0, LARGEST_INFLATION)) if expected > 0.0 else 1.0


def _precisions(fit: WindowFit) -> tuple[np.ndarray, np.ndarray]:
    """Precision of the coefficients that is the prior's, and that of the windows."""
    known = fit.information @ fit.from_prior @ fit.information
    return known, fit.information - known
