"""Identification of a real ship from several trials: an ensemble of models, weighted and widened by held-out runs.

No polynomial is the true force of a ship. Several term sets are fitted to windows of all runs; each is weighted by the
log predictive density of runs it was not fitted to (pseudo-BMA+, Yao et al. 2018, doi:10.1214/17-BA1091): each channel
of a run counts as one observation, since what a term set cannot do it cannot do in all windows of a run. The spread
between the sets is one part of the model error, the other is what the indices of held-out manoeuvres show beyond it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from pymc_ship.inference.captive.comparison import captive_bands
from pymc_ship.inference.trajectory.randomize_then_optimize import randomize_then_optimize
from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.inference.trajectory.windows import LENGTH, thin_record
from pymc_ship.machine.errors import FitError, InferenceError, TrialError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.prime_record import motion_record, prime_record
from pymc_ship.physics.vessel.plausibility import remarks as vessel_remarks
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, most_dofs
from pymc_ship.records.files.quality_flags import quality_flags
from pymc_ship.records.steering.recognition import recognise_by_facility, with_steering
from pymc_ship.ships.ensemble.feasibility import is_feasible
from pymc_ship.ships.ensemble.index_error import index_sd, model_error
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.ensemble.motion_error import LEADS, OpenLoopSimulation, motion_error
from pymc_ship.ships.ensemble.ship import Ship
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
from pymc_ship.ships.identification.held_out import forecast_rows, index_noise_sd, unscored_run_remarks
from pymc_ship.ships.identification.open_loop import measured_states, reading_noise_sd, simulate_open_loop
from pymc_ship.trial.record import facility_of, sampling_interval, trial_list

_REPLAYS = 40  # draws of a held-out run from each window on
_FORECASTS = 100  # draws of a held-out forecast
_COUNTED = 0.01  # least weight of a term set that takes part in it
_BOOTSTRAPS = 2000
_PRIOR_DRAWS = 500  # beside captive tests
_ATTEMPTS = 50


@dataclass(frozen=True, eq=False)
class ShipIdentification:
    """A ship identified from trials, with the evidence.

    Attributes
    ----------
    ship : Ship
        What forecasts and later runs take.
    vessel : Vessel
        As given, with the steering gear as it was measured, at the first facility.
    names : tuple of str
        Of the runs.
    manoeuvres : tuple of Manoeuvre or None
        What each run was recognised as.
    candidates : tuple of Candidate
        By falling weight; those of weight 0 have no draws.
    refusals : tuple of Refusal
        Term sets that were left out.
    held_out_indices : Dataset, dims (run, index)
        Indices of held-out manoeuvres of these runs, see :func:`pymc_ship.ships.ensemble.index_table.index_table`, with
        the ``sd`` of each error, model error and all.
    quality_flags : dict of str to str
        Of the records, see :func:`pymc_ship.records.files.quality_flags.quality_flags`.
    captive : Dataset or None
        The captive tests that were given.
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
        """Runs, term sets and the ship."""
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
    """Identify a real ship from several trials, with intervals that hold model error.

    Parameters
    ----------
    trials : sequence of Dataset, dims (time,)
        Checked and corrected records with u, v, r, psi and delta; p and phi where the vessel rolls.
    vessel : Vessel, str or Path
        Particulars, inertia, propeller. Coefficients with an ``sd`` are taken as known so far.
    names : sequence of str, optional
        Of the trials; numbers by default.
    terms : sequence of str, optional
        Of :func:`pymc_ship.physics.vessel.term_sets.term_sets` or "own terms"; by default all sets the vessel can have.
    prior : {"hull_database", "order_damped", "sister_ship"} or Ship, optional
        Of the coefficients without an ``sd``: what captive tests of other ships say of the hull, see
        :func:`pymc_ship.physics.vessel.hull_database.hull_coefficients`, and wide about 0 for the rest; wide about 0
        for all; or about the values of the vessel file. By default the first where the vessel states her draught, the
        second else. Or the ship as earlier runs identified her: their term sets, with what they said beside their
        prior. Her coefficients may have changed since, each by a share of its prior sd, the most probable one.
    captive : Dataset, dims (test,), optional
        Captive tests of her model, from :func:`pymc_ship.read_captive`: they stand beside the prior of every term set
        with a noise of their own, that of the term set on them.
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
        When no term set can be fitted, or all of them run away.
    VesselError, InferenceError
        For unknown term sets or priors, the hull database without a draught, or term sets or captive tests that do not
        go with an earlier ship.

    Examples
    --------
    Two zigzags of a tanker, one term set:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> runs = [ps.simulate(vessel, ps.zigzag(angle, angle), duration=400, step=0.5) for angle in (10, 20)]
    >>> runs = [ps.pollute(run, level=0.005, rng=rng) for run in runs]
    >>> found = ps.identify_ship(runs, vessel, terms=["hull and loading"], draws=100, rng=rng)
    >>> [(manoeuvre.kind, manoeuvre.rudder_deg) for manoeuvre in found.manoeuvres]
    [('zigzag', 10.0), ('zigzag', 20.0)]
    >>> found.ship
    Ship(kvlcc2: 1 model, 100 draws, errors beyond the draws from 2 held-out runs)
    """
    rng, vessel, trials = random_generator(rng), as_vessel(vessel), trial_list(trials)
    before = prior if isinstance(prior, Ship) else None
    names = tuple(names or (str(k + 1) for k in range(len(trials))))
    if not trials or len(names) != len(trials) or draws < 2:
        raise TrialError(
            f"A ship is identified from one trial or more, each with its name, and by two draws or more, found "
            f"{len(trials)} trials, {len(names)} names and {draws} draws; correct them."
        )
    kind = prior_kind_of(vessel, (prior.prior if isinstance(prior, Ship) else prior) or None)
    training = _after(before, replace(_prepared(trials, vessel, kind), captive=captive))
    wanted = tuple(dict.fromkeys(terms or training.earlier or default_term_sets(training)))
    _check_goes_with(before, wanted, captive)
    progress(f"term sets {'; '.join(wanted)}: fits to all of {len(trials)} runs and to all but one")
    found, refusals = fit_candidates(wanted, training, rng)
    fullest_vessel = most_dofs(candidate.vessel for candidate in found)
    remarks = [
        *vessel_remarks(fullest_vessel),
        *(one.sentence for one in refusals),
        *partial_run_remarks(names, training, found),
    ]
    progress("weights and model error from held-out runs")
    found = _weighted(found, training.earlier, rng)
    rows = _held_out_indices(found, training, names, rng) if len(trials) > 1 else []
    all_rows = [*(index_rows(before.held_out_indices) if before else ()), *rows]
    errors = model_error(all_rows)
    remarks += unscored_run_remarks(dict(zip(names, trials, strict=True)), training.manoeuvres, fullest_vessel)
    remarks += [] if all_rows else [_NOTHING_HELD_OUT]
    progress("draws that do not run away")
    found = sorted(_drawn(found, draws, rng), key=lambda candidate: -candidate.weight)
    remarks += [] if captive is None else _beside_captive(captive, found[0])
    remarks += [earlier_runs_remark(found[0], training)] if training.earlier else []
    moved = motion_error(_held_out_motion(found, training, rng), vessel)
    known_facilities = before.facilities if before else {}
    ship = Ship(
        members=tuple(candidate.member(training.earlier) for candidate in found),
        motion=_motion(training, fullest_vessel, before),
        index_error=errors,
        motion_error=before.motion_error if before and training.earlier and len(trials) == 1 else moved,
        facilities=training.facilities | {k: v for k, v in known_facilities.items() if k not in training.facilities},
        remarks=tuple(remarks),
        prior=training.prior,
        held_out_indices=index_table(all_rows),
        uses_captive_tests=captive is not None or (before is not None and before.uses_captive_tests),
    )
    return ShipIdentification(
        ship=ship,
        vessel=training.vessel,
        names=names,
        manoeuvres=tuple(training.manoeuvres),
        candidates=tuple(found),
        refusals=tuple(refusals),
        held_out_indices=index_table([row | {"sd": index_sd(row, errors)} for row in rows]),
        quality_flags=quality_flags(trials, names),
        captive=captive,
    )


_NOTHING_HELD_OUT = (
    "No run of a standard manoeuvre was held out: beside the spread of the term sets and of the windows, the "
    "intervals hold the error of a whole manoeuvre that is typical of other ships, not that of this one."
)


def _beside_captive(tests: xr.Dataset, best: Candidate) -> list[str]:
    """Sentence on how far the coefficients differ between the captive tests and the trials."""
    if best.captive is None:
        return []
    return [
        f"{tests.sizes['test']} captive tests stand beside the prior of every term set; held-out runs are "
        "forecast with them, too. Each coefficient differs between carriage and ship by "
        f"{best.captive.discrepancy_scale:.2g} of its prior sd ({best.name})."
    ]


def captive_comparison(found: ShipIdentification, rng: Seed) -> xr.Dataset | None:
    """Captive tests beside the forces of the candidate that weighs most, before and after it was fitted.

    See :func:`pymc_ship.inference.captive.comparison.captive_bands`; drawn by "prior alone" and as "identified". None
    without captive tests.
    """
    best = found.candidates[0]
    if found.captive is None or best.captive is None:
        return None
    draws = {"prior alone": best.prior.draw(_PRIOR_DRAWS, random_generator(rng)), "identified": best.draws}
    return captive_bands(found.captive, best.vessel, draws, revolutions=best.captive.revolutions)


def _prepared(trials: Sequence[xr.Dataset], vessel: Vessel, prior: str) -> Training:
    for trial in trials:
        motion_record(trial, vessel)
    manoeuvres, facilities = recognise_by_facility(trials, vessel)
    vessel = with_steering(vessel, next(iter(facilities.values())))
    return Training([thin_record(trial, vessel) for trial in trials], manoeuvres, facilities, vessel, prior)


def _after(before: Ship | None, training: Training) -> Training:
    """Training with the likelihood of earlier runs, and whether facility and draught are theirs."""
    if before is None or not before.likelihoods:
        return training
    here, there = (ship.vessel.particulars for ship in (training, before))
    reloaded = (here.d, here.volume) != (there.d, there.volume)
    elsewhere = not set(before.facilities) & set(training.facilities)
    return replace(training, earlier=before.likelihoods, reloaded=reloaded, elsewhere=elsewhere)


def _check_goes_with(before: Ship | None, wanted: Sequence[str], captive: xr.Dataset | None) -> None:
    """Refuse term sets without a likelihood of the earlier runs, and captive tests that are part of it already."""
    earlier = before.likelihoods if before else {}
    unknown = [name for name in wanted if name not in earlier]
    if earlier and unknown:
        raise InferenceError(
            f"Earlier runs were identified with {'; '.join(earlier)}, found {unknown[0]!r} asked for; choose of "
            "theirs, or identify all runs together."
        )
    if captive is not None and before is not None and before.uses_captive_tests:
        raise InferenceError("Captive tests stand beside the earlier runs already; leave them out.")


def _weighted(
    found: Sequence[Candidate], earlier: Mapping[str, EarlierLikelihood], rng: np.random.Generator
) -> list[Candidate]:
    """Pseudo-BMA+: mean over Bayesian bootstraps of the runs of weights proportional to the predictive density."""
    density = np.array([candidate.densities(earlier) for candidate in found])
    shares = rng.dirichlet(np.ones(density.shape[1]), _BOOTSTRAPS)
    finite = np.where(np.isfinite(density), density, -1e9)
    total = density.shape[1] * shares @ finite.T
    weight = np.exp(total - total.max(axis=1, keepdims=True))
    weight = np.mean(weight / weight.sum(axis=1, keepdims=True), axis=0)
    return [replace(candidate, weight=float(w)) for candidate, w in zip(found, weight, strict=True)]


def _held_out_indices(
    found: Sequence[Candidate], training: Training, names: Sequence[str], rng: np.random.Generator
) -> list[dict]:
    """Indices of every recognised manoeuvre, forecast by the fits that were made without it."""
    counted = [candidate for candidate in found if candidate.weight > _COUNTED]
    weight = np.array([candidate.weight for candidate in counted])
    rows = []
    for k, (trial, manoeuvre) in enumerate(zip(training.trials, training.manoeuvres, strict=True)):
        if manoeuvre is not None:
            gear, models = training.facilities[facility_of(trial)], []
            for candidate in counted:
                coefficients = np.vstack(
                    [candidate.held_out.coefficients[k], candidate.held_out.draws(k, _FORECASTS, rng)]
                )
                models.append((with_steering(candidate.vessel, gear), coefficients))
            noise = index_noise_sd(trial, manoeuvre, models[0][0].particulars.rudder_delay, rng)
            rows += forecast_rows(names[k], trial, manoeuvre, models, weight / weight.sum(), noise)
    return rows


def _held_out_motion(
    found: Sequence[Candidate], training: Training, rng: np.random.Generator
) -> Iterator[OpenLoopSimulation]:
    """Every run from each window on, sailed by the fits that were made without it."""
    if len(training.trials) < 2:
        return
    unit = training.vessel.particulars.ship_time
    for k, trial in enumerate(training.trials):
        drawn = [(c.vessel, c.held_out.draws(k, round(_REPLAYS * c.weight), rng)) for c in found]
        time, noise = trial["time"].values, reading_noise_sd(trial)
        for begin in range(0, time.size, round(LENGTH * unit / sampling_interval(trial))):
            place = slice(begin, begin + np.searchsorted(time[begin:] - time[begin], LEADS[-1] * unit, "right"))
            if place.stop - place.start > 1:
                states = [simulate_open_loop(vessel, draws, trial, place) for vessel, draws in drawn if len(draws)]
                since, seen = time[place] - time[begin], measured_states(trial, place)
                yield OpenLoopSimulation(since, np.concatenate(states, axis=1), seen, noise)


def _drawn(found: Sequence[Candidate], draws: int, rng: np.random.Generator) -> list[Candidate]:
    """Deal the draws to the candidates by weight and draw until as many are sound."""
    exact = draws * np.array([candidate.weight for candidate in found])
    counts = np.floor(exact).astype(int)
    counts[np.argsort(counts - exact)[: draws - counts.sum()]] += 1
    drawn = []
    for candidate, count in zip(found, counts, strict=True):
        kept, tried = np.empty((0, candidate.fit.coefficients.size)), 0
        while len(kept) < count and tried < _ATTEMPTS * count:
            batch = randomize_then_optimize(candidate.fit, int(count), rng)
            kept, tried = np.vstack([kept, batch[is_feasible(candidate.vessel, batch)]]), tried + int(count)
        if len(kept) < count:
            raise FitError(
                f"Of the draws of the {candidate.name} terms, {len(kept)} of {tried} do not run away in a standard "
                "manoeuvre; give more trials or a prior."
            )
        share = 1.0 - len(kept) / tried if tried else 0.0
        drawn.append(replace(candidate, draws=kept[:count], infeasible_fraction=share))
    return drawn


def _motion(training: Training, vessel: Vessel, before: Ship | None) -> xr.DataArray:
    """Prime motion of all runs so far at every fifth sample."""
    rows = [] if before is None or before.motion is None else [before.motion.values]
    for trial in training.trials:
        prime, _, _ = prime_record(vessel, motion_record(trial.isel(time=slice(None, None, 5)), vessel))
        rows.append(np.column_stack([prime[symbol] for symbol in SYMBOLS]))
    return xr.DataArray(np.vstack(rows), {"symbol": list(SYMBOLS)}, ("row", "symbol"))
