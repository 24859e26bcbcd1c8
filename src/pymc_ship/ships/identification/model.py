"""Identification of a real ship from several trials: an ensemble of models, weighted and widened by held-out runs.

Pseudo-BMA+ weights (Yao et al. 2018, doi:10.1214/17-BA1091). Model error: spread of the term sets, and errors of the
indices of held-out manoeuvres beyond it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.inference.captive.comparison import captive_bands
from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.inference.trajectory.windows import LENGTH, thin_record
from pymc_ship.machine.arguments import check_callables, check_counts, check_kind, name_list
from pymc_ship.machine.errors import FitError, InferenceError, TrialError, VesselError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from pymc_ship.physics.vessel.plausibility import remarks as vessel_remarks
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, most_dofs
from pymc_ship.records.checks.run_set import contradicting_runs, cut_runs, repeated_runs
from pymc_ship.records.files.sides import mirror_remarks
from pymc_ship.records.steering.recognition import recognise_by_facility, with_steering
from pymc_ship.ships.ensemble.feasibility import is_feasible
from pymc_ship.ships.ensemble.index_error import extrapolation_growth, index_sd, model_error
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.ensemble.motion_error import LEADS, OpenLoopSimulation, motion_error
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.extrapolation import extrapolation
from pymc_ship.ships.identification.candidates import (
    Candidate,
    Refusal,
    Training,
    default_term_sets,
    earlier_runs_remark,
    fit_candidates,
    partial_run_remarks,
    prior_kind_of,
)
from pymc_ship.ships.identification.held_out import CrossValidation, forecast_rows, index_noise_sd, unscored_run_remarks
from pymc_ship.ships.identification.open_loop import (
    measured_states,
    reading_noise_sd,
    replay_noise_sd,
    simulate_open_loop,
)
from pymc_ship.trial.quality_flags import quality_flags
from pymc_ship.trial.record import facility_of, run_names, sampling_interval, trial_list

_REPLAYS = 40  # draws of a replay of a held-out run
_FORECASTS = 100  # draws of a held-out forecast
_COUNTED = 0.01  # least weight of a term set in a held-out forecast
_BOOTSTRAPS = 2000
_PRIOR_DRAWS = 500  # for the comparison with captive tests
_ATTEMPTS = 50
_HARDER = 1.2  # least ratio of the rms yaw rates of the harder and the milder runs


@dataclass(frozen=True, eq=False)
class ShipIdentification:
    """A ship identified from trials, with the evidence.

    Attributes
    ----------
    ship : Ship
        For forecasts and later identifications.
    vessel : Vessel
        With the measured steering gear of the first facility.
    names : tuple of str
        Of the runs.
    manoeuvres : tuple of Manoeuvre or None
        Recognised manoeuvre of each run.
    candidates : tuple of Candidate
        By falling weight; those of weight 0 have no draws.
    refusals : tuple of Refusal
        Term sets that were left out.
    held_out_indices : Dataset, dims (run, index)
        Indices of held-out manoeuvres, with the ``sd`` of each error, including model error.
    quality_flags : dict of str to str
        Of the records.
    captive : Dataset or None
        Captive tests.
    """

    ship: Ship
    vessel: Vessel
    names: tuple[str, ...]
    manoeuvres: tuple[Manoeuvre | None, ...]
    candidates: tuple[Candidate, ...]
    refusals: tuple[Refusal, ...]
    held_out_indices: xr.Dataset
    quality_flags: dict[str, str]
    captive: xr.Dataset | None = None

    def __repr__(self) -> str:
        return f"ShipIdentification({len(self.names)} runs, {len(self.candidates)} term sets, {self.ship})"


def identify_ship(
    trials: Sequence[xr.Dataset],
    vessel: VesselLike,
    *,
    names: Sequence[str] | None = None,
    terms: Sequence[str] | None = None,
    prior: str | Ship | None = None,
    captive: xr.Dataset | None = None,
    draws: int = 1000,
    rng: Seed,
    progress: Callable[[str], None] = lambda _: None,
) -> ShipIdentification:
    """Identify a real ship from several trials, with model error.

    Parameters
    ----------
    trials : sequence of Dataset, dims (time,)
        Checked and corrected records with u, v, r, psi and delta; p and phi where the vessel rolls.
    vessel : Vessel, str or Path
        Particulars, inertia, propeller; coefficients with an ``sd`` are priors.
    names : sequence of str, optional
        Of the trials; numbers by default.
    terms : sequence of str, optional
        Of :func:`pymc_ship.physics.vessel.term_sets.term_sets` or "own terms"; by default all that the vessel supports.
    prior : {"hull_database", "order_damped", "sister_ship"} or Ship, optional
        Prior of the coefficients without an ``sd``: hull regression from captive tests of other ships
        (:func:`pymc_ship.physics.vessel.hull_database.hull_coefficients`), by default where the draught is stated; wide
        about 0, else by default; or about the values of the vessel file. A Ship adds the likelihood of its earlier
        runs, with a commensurate prior on changes of the coefficients.
    captive : Dataset, dims (test,), optional
        Captive tests from :func:`pymc_ship.read_captive`; their likelihood, with its own noise, joins the prior.
    draws : int, optional
        Of the whole ensemble.
    rng : int, SeedSequence or Generator
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    ShipIdentification

    Raises
    ------
    TrialError
        For trials that are too short or lack a channel, or none.
    FitError
        When no term set can be fitted, or all of them diverge.
    VesselError, InferenceError
        For unknown term sets or priors, the hull database without a draught, or term sets or captive tests that an
        earlier ship excludes.

    Examples
    --------
    Two zigzags of a tanker, one term set:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> runs = [ps.simulate(vessel, ps.zigzag(angle, angle), duration=400, step=0.5) for angle in (10, 20)]
    >>> runs = [ps.pollute(run, level=0.005, rng=rng) for run in runs]
    >>> identification = ps.identify_ship(runs, vessel, terms=["hull and loading"], draws=100, rng=rng)
    >>> [(manoeuvre.kind, manoeuvre.rudder_deg) for manoeuvre in identification.manoeuvres]
    [('zigzag', 10.0), ('zigzag', 20.0)]
    >>> identification.ship
    Ship(kvlcc2: 1 model, 100 draws, model error from 2 held-out runs)
    """
    check_callables(progress=progress)
    check_counts(TrialError, least=2, draws=draws)
    if captive is not None:
        check_kind("captive", captive, xr.Dataset, "read it by read_captive", TrialError)
    rng, vessel, trials = random_generator(rng), as_vessel(vessel), trial_list(trials)
    before = prior if isinstance(prior, Ship) else None
    names = run_names("An identification", names, len(trials))
    kind = prior_kind_of(vessel, (prior.prior if isinstance(prior, Ship) else prior) or None)
    training = _with_earlier_runs(before, replace(_prepare(trials, vessel, kind), captive=captive))
    given = () if terms is None else name_list("The term sets", terms, VesselError)
    chosen = given or training.earlier or default_term_sets(training)
    term_set_names = name_list("The term sets", chosen, VesselError)
    _check_earlier(before, term_set_names, captive)
    by_name = dict(zip(names, trials, strict=True))
    contradictions = contradicting_runs(by_name, vessel.particulars.L)
    progress(f"term sets {'; '.join(term_set_names)}: fits to all of {len(trials)} runs and to all but one")
    with _with_contradictions(contradictions):
        fitted, refusals = fit_candidates(term_set_names, training, rng, progress)
        progress("weights and model error from held-out runs")
        fitted = _with_weights(fitted, training.earlier, rng)
        rows, harder_rows = _validation_rows(fitted, training, names, rng)
        progress("feasible draws")
        candidates = sorted(_draw_feasible(fitted, draws, rng), key=lambda candidate: -candidate.weight)
        motion_sizes = motion_error(_held_out_motion(candidates, training, rng), vessel)
    ship = _ship(candidates, training, before, (rows, harder_rows), motion_sizes)
    fullest_vessel = most_dofs(candidate.vessel for candidate in fitted)
    remarks = [
        *mirror_remarks(by_name),
        *repeated_runs(by_name),
        *cut_runs(by_name),
        *contradictions,
        *vessel_remarks(fullest_vessel),
        *(refusal.sentence for refusal in refusals),
        *partial_run_remarks(names, training, fitted),
        *unscored_run_remarks(by_name, training.manoeuvres, fullest_vessel),
        *([] if ship.held_out_indices.sizes["run"] else [_nothing_held_out(training)]),
        *([] if captive is None else _captive_remarks(captive, candidates[0])),
        *([earlier_runs_remark(candidates[0], training)] if training.earlier else []),
    ]
    return ShipIdentification(
        ship=replace(ship, remarks=tuple(remarks)),
        vessel=training.vessel,
        names=names,
        manoeuvres=tuple(training.manoeuvres),
        candidates=tuple(candidates),
        refusals=tuple(refusals),
        held_out_indices=index_table([row | {"sd": index_sd(row, ship.index_error or {})} for row in rows]),
        quality_flags=quality_flags(trials, names),
        captive=captive,
    )


def _ship(
    candidates: Sequence[Candidate],
    training: Training,
    before: Ship | None,
    rows: tuple[Sequence[dict], Sequence[dict]],
    motion_sizes: dict[str, np.ndarray],
) -> Ship:
    """Ship of the candidates' draws, with the errors that earlier runs and these show.

    ``rows`` are those of :func:`_validation_rows`, ``motion_sizes`` of :func:`.motion_error`, both of these runs alone.
    """
    held_out, harder = rows
    facilities, uses_captive_tests = dict(training.facilities), training.captive is not None
    if before is not None:
        held_out = [*index_rows(before.held_out_indices), *held_out]
        harder = [*index_rows(before.harder_indices), *harder]
        facilities |= {name: gear for name, gear in before.facilities.items() if name not in facilities}
        uses_captive_tests |= before.uses_captive_tests
        if training.earlier and len(training.trials) == 1:  # which is not held out
            motion_sizes = before.motion_error
    errors = model_error(held_out, motion_sizes)
    return Ship(
        members=tuple(candidate.member(training.earlier) for candidate in candidates),
        motion=_motion(training, most_dofs(candidate.vessel for candidate in candidates), before),
        index_error=errors,
        motion_error=motion_sizes,
        extrapolation_growth=extrapolation_growth(harder, errors),
        facilities=facilities,
        prior=training.prior,
        held_out_indices=index_table(held_out),
        harder_indices=index_table(harder),
        uses_captive_tests=uses_captive_tests,
    )


@contextmanager
def _with_contradictions(sentences: Sequence[str]) -> Iterator[None]:
    """Context in which a fit that fails names the runs that contradict each other."""
    try:
        yield
    except FitError as error:
        raise FitError(" ".join([str(error), *sentences]), refusals=error.refusals) from None


def _nothing_held_out(training: Training) -> str:
    """Remark: what the intervals include where no index of a held-out run was compared."""
    runs = len(training.trials)
    if runs == 1 and training.earlier:  # whose motion counts
        runs = len(next(iter(training.earlier.values())).log_density)
    judged_by = (
        "the typical model error of other ships instead of that of this ship"
        if runs == 1
        else "a model error of the size that heading and track of the held-out runs show: sail a standard zigzag or "
        "circle from a steady approach for narrower ones"
    )
    return (
        "No run of a standard manoeuvre was held out: the intervals include the spread of term sets and windows, and "
        f"{judged_by}."
    )


def _captive_remarks(tests: xr.Dataset, best: Candidate) -> list[str]:
    if best.captive is None:
        return []
    return [
        f"{tests.sizes['test']} captive tests are part of the likelihood of every term set, also in the forecasts of "
        "held-out runs. The discrepancy of each coefficient between captive tests and ship has an sd of "
        f"{best.captive.discrepancy_scale:.2g} of its prior sd ({best.name}).",
        *best.captive.remarks,
    ]


def captive_comparison(result: ShipIdentification, rng: Seed) -> xr.Dataset | None:
    """Captive tests and the forces of the best candidate by "prior alone" and as "identified"; None without tests."""
    best = result.candidates[0]
    if result.captive is None or best.captive is None:
        return None
    draws = {"prior alone": best.prior.draw(_PRIOR_DRAWS, random_generator(rng)), "identified": best.draws}
    return captive_bands(result.captive, best.vessel, draws, revolutions=best.captive.revolutions)


def _prepare(trials: Sequence[xr.Dataset], vessel: Vessel, prior: str) -> Training:
    for trial in trials:
        motion_record(trial, vessel)
    manoeuvres, facilities = recognise_by_facility(trials, vessel)
    vessel = with_steering(vessel, next(iter(facilities.values())))
    thinned = [thin_record(trial, vessel) for trial in trials]
    return Training(thinned, manoeuvres, facilities, vessel, prior, harder=_harder_runs(thinned, vessel))


def _with_earlier_runs(before: Ship | None, training: Training) -> Training:
    """Training with the likelihood of earlier runs, and whether facility and draught have changed."""
    if before is None or not before.likelihoods:
        return training
    here, there = (ship.vessel.particulars for ship in (training, before))
    reloaded = (here.d, here.volume) != (there.d, there.volume)
    elsewhere = not set(before.facilities) & set(training.facilities)
    return replace(training, earlier=before.likelihoods, reloaded=reloaded, elsewhere=elsewhere)


def _check_earlier(before: Ship | None, names: Sequence[str], captive: xr.Dataset | None) -> None:
    """Refuse term sets without a likelihood of earlier runs, and captive tests used twice."""
    earlier = before.likelihoods if before else {}
    without_likelihood = [name for name in names if name not in earlier]
    if earlier and without_likelihood:
        raise InferenceError(
            f"The term sets must be those of the earlier runs, {'; '.join(earlier)}, found "
            f"{without_likelihood[0]!r}; choose one of them, or identify all runs together."
        )
    if captive is not None and before is not None and before.uses_captive_tests:
        raise InferenceError(
            "Captive tests can be used once, found them in the earlier identification, too; leave them out."
        )


def _with_weights(
    candidates: Sequence[Candidate], earlier: Mapping[str, EarlierLikelihood], rng: np.random.Generator
) -> list[Candidate]:
    """Pseudo-BMA+: mean over Bayesian bootstraps of weights proportional to the predictive density."""
    density = np.array([candidate.densities(earlier) for candidate in candidates])
    run_weights = rng.dirichlet(np.ones(density.shape[1]), _BOOTSTRAPS)
    finite = np.where(np.isfinite(density), density, -1e9)
    # elpd of a set in each bootstrap: number of runs times the weighted mean of its log densities
    total = density.shape[1] * run_weights @ finite.T
    weight = np.exp(total - total.max(axis=1, keepdims=True))
    weight = np.mean(weight / weight.sum(axis=1, keepdims=True), axis=0)
    return [replace(candidate, weight=float(w)) for candidate, w in zip(candidates, weight, strict=True)]


def _index_noise(training: Training, rng: np.random.Generator) -> list[dict[str, float]]:
    """Sd of the measured indices of each run; empty for an unknown manoeuvre, and where no run is held out."""
    if len(training.trials) < 2:
        return [{}]
    noise: list[dict[str, float]] = []
    for trial, manoeuvre in zip(training.trials, training.manoeuvres, strict=True):
        delay = with_steering(training.vessel, training.facilities[facility_of(trial)]).particulars.rudder_delay
        noise.append({} if manoeuvre is None else index_noise_sd(trial, manoeuvre, delay, rng))
    return noise


def _validation_rows(
    candidates: Sequence[Candidate], training: Training, names: Sequence[str], rng: np.random.Generator
) -> tuple[list[dict], list[dict]]:
    """Indices of held-out runs by fits to the others, and of harder runs, with ``beyond``, by fits to milder ones."""
    noise = _index_noise(training, rng)
    rows: list[dict] = []
    for k in range(len(names) if len(names) > 1 else 0):
        rows += _forecast_of_run(k, names[k], training, [(one, one.held_out, k) for one in candidates], noise[k], rng)
    harder_rows: list[dict] = []
    milder = [trial for k, trial in enumerate(training.trials) if k not in training.harder]
    for fold, k in enumerate(training.harder):
        folds = [(one, one.milder, fold) for one in candidates if one.milder is not None]
        vessel = folds[0][0].vessel
        motion = _motion(replace(training, trials=milder), vessel, None)
        beyond = float(np.nanmax(extrapolation(vessel, training.trials[k], motion)["distance"]))
        forecasts = _forecast_of_run(k, names[k], training, folds, noise[k], rng)
        harder_rows += [row | {"beyond": beyond} for row in forecasts]
    return rows, harder_rows


def _forecast_of_run(
    k: int,
    name: str,
    training: Training,
    folds: Sequence[tuple[Candidate, CrossValidation, int]],
    noise: Mapping[str, float],
    rng: np.random.Generator,
) -> list[dict]:
    """Rows of :func:`.forecast_rows` of run k, by each candidate's fit of a fold; none of an unknown manoeuvre."""
    trial, manoeuvre = training.trials[k], training.manoeuvres[k]
    if manoeuvre is None:
        return []
    gear, models, weights = training.facilities[facility_of(trial)], [], []
    for candidate, validation, fold in folds:
        if candidate.weight > _COUNTED:
            draws = validation.draws(fold, _FORECASTS, rng)
            models.append((with_steering(candidate.vessel, gear), np.vstack([validation.coefficients[fold], draws])))
            weights.append(candidate.weight)
    return forecast_rows(name, trial, manoeuvre, models, np.array(weights) / np.sum(weights), noise)


def _harder_runs(trials: Sequence[xr.Dataset], vessel: Vessel) -> tuple[int, ...]:
    """Numbers of the runs above the largest gap of the rms yaw rate; none where all runs are about equally hard."""
    rms = np.array([np.sqrt(np.mean(trial["r"].values ** 2)) for trial in trials])
    ascending = np.argsort(rms)
    ratio = rms[ascending[1:]] / rms[ascending[:-1]]
    if not ratio.size or not ratio.max() > _HARDER:
        return ()
    return tuple(sorted(ascending[int(np.argmax(ratio)) + 1 :].tolist()))


def _held_out_motion(
    candidates: Sequence[Candidate], training: Training, rng: np.random.Generator
) -> Iterator[OpenLoopSimulation]:
    """Replays of every run from each window on by the fits without the run."""
    if len(training.trials) < 2:
        return
    unit = training.vessel.particulars.ship_time
    for k, trial in enumerate(training.trials):
        models = [(c.vessel, c.held_out.draws(k, round(_REPLAYS * c.weight), rng)) for c in candidates]
        time, readings_sd = trial["time"].values, reading_noise_sd(trial)
        for begin in range(0, time.size, round(LENGTH * unit / sampling_interval(trial))):
            samples = slice(begin, begin + np.searchsorted(time[begin:] - time[begin], LEADS[-1] * unit, "right"))
            if samples.stop - samples.start > 1:
                states = [simulate_open_loop(vessel, draws, trial, samples) for vessel, draws in models if len(draws)]
                lead, measured = time[samples] - time[begin], measured_states(trial, samples)
                noise_sd = replay_noise_sd(readings_sd, trial.isel(time=samples))
                yield OpenLoopSimulation(lead, np.concatenate(states, axis=1), measured, noise_sd)


def _draw_feasible(candidates: Sequence[Candidate], draws: int, rng: np.random.Generator) -> list[Candidate]:
    exact = draws * np.array([candidate.weight for candidate in candidates])
    counts = np.floor(exact).astype(int)
    counts[np.argsort(counts - exact)[: draws - counts.sum()]] += 1
    with_draws = []
    for candidate, count in zip(candidates, counts, strict=True):
        feasible, n_tried = np.empty((0, candidate.fit.coefficients.size)), 0
        while len(feasible) < count and n_tried < _ATTEMPTS * count:
            batch = randomize_then_optimize(candidate.fit, int(count), rng)
            feasible, n_tried = np.vstack([feasible, batch[is_feasible(candidate.vessel, batch)]]), n_tried + int(count)
        if len(feasible) < count:
            raise FitError(
                f"The {candidate.name} terms need {count} feasible draws, found {len(feasible)} of {n_tried}: the "
                "others diverge in a standard manoeuvre; add trials or a prior."
            )
        infeasible = 1.0 - len(feasible) / n_tried if n_tried else 0.0
        with_draws.append(replace(candidate, draws=feasible[:count], infeasible_fraction=infeasible))
    return with_draws


def _motion(training: Training, vessel: Vessel, before: Ship | None) -> xr.DataArray:
    """Prime motion of earlier and present runs at every fifth sample."""
    rows = [] if before is None or before.motion is None else [before.motion.values]
    for trial in training.trials:
        prime, _, _ = prime_record(vessel, motion_record(trial.isel(time=slice(None, None, 5)), vessel))
        rows.append(np.column_stack([prime[symbol] for symbol in SYMBOLS]))
    return xr.DataArray(np.vstack(rows), {"symbol": list(SYMBOLS)}, ("row", "symbol"))
