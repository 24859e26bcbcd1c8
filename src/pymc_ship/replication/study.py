"""The paper's study on one ship, in its order: trial, noise, denoising, priors, posteriors, forecasts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr

from pymc_ship.diagnostics.agreement import Comparison, agreement
from pymc_ship.inference.identifiability.bound import cramer_rao_bound
from pymc_ship.inference.regression.identify import Identification, identify
from pymc_ship.inference.sampling.gibbs import gibbs_posterior
from pymc_ship.inference.sampling.regression_model import nuts_posterior
from pymc_ship.inference.trajectory.mode import TrajectoryMode
from pymc_ship.inference.trajectory.posterior import laplace_posterior
from pymc_ship.machine.seeds import generator
from pymc_ship.physics.manoeuvre.indices import indices
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, turning_circle, zigzag
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.denoising.denoise import denoise
from pymc_ship.records.denoising.draws import denoise_draws
from pymc_ship.records.files.noise import LITERAL_LEVEL, noise_factors, noise_sd, pollute
from pymc_ship.replication import denoisers
from pymc_ship.replication import measurements as replication
from pymc_ship.replication.estimates import trajectory_modes
from pymc_ship.replication.measurements import AS_PUBLISHED, PAPER_FAMILIES
from pymc_ship.replication.prior_ships import prior_ship_rows
from pymc_ship.replication.scores import forecast_row, published_rows, summary_rows
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.ships.forecasting.forecast import forecast
from pymc_ship.trial.channels import default_channels

LEVELS = (0.0, 0.001, 0.01, 0.05, LITERAL_LEVEL)  # noise levels of the study; the last is the paper's literal one

SWEEP = tuple(10.0 ** (0.5 * k) for k in range(-14, -1))
"""Noise levels of the sweep, in which the published errors are located."""

DURATION, STEP, INTERVAL = 400.0, 0.02, 1.0
"""The paper's record: 400 s in Euler steps of 0.02 s, one row of the regression each second."""

MANOEUVRES = {"zigzag": zigzag(10, 10), "turning_circle": turning_circle(35)}  # manoeuvres that are forecast

_BY_ROW = ("log_likelihood", "prior_predictive", "posterior_predictive")  # large; draws and design give them again

TRAJECTORY_PRIORS = ("flat", "order_damped")  # priors of the trajectory fits; the last one forecasts


@dataclass
class StudyResult:
    """Results of the study; ``bound``, dims (coefficient,), is the Cramer-Rao bound at a noise level of 1."""

    vessel: Vessel
    trial: xr.Dataset
    level: float
    seed: int
    bound: xr.DataArray
    noisy: dict[float, xr.Dataset] = field(default_factory=dict)
    smooth: dict[float, xr.Dataset] = field(default_factory=dict)
    identifications: dict[float, Identification] = field(default_factory=dict)
    draws: dict[str, dict[str, dict[str, xr.DataTree]]] = field(default_factory=dict)
    agreement: dict[str, dict[str, xr.Dataset]] = field(default_factory=dict)
    references: dict[str, xr.Dataset] = field(default_factory=dict)
    forecasts: dict[str, dict[str, xr.DataTree]] = field(default_factory=dict)
    tables: dict[str, list[dict]] = field(default_factory=dict)

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """Exact, Gibbs and NUTS draws of each DOF and family with their agreement."""
        return [
            Comparison(
                f"{dof}, {family}",
                {method: trees[dof] for method, trees in methods.items()},
                self.agreement[family][dof],
            )
            for dof in self.vessel.dofs
            for family, methods in self.draws.items()
        ]


def run_study(
    vessel: VesselLike,
    *,
    level: float = 0.01,
    seed: int = 2020,
    levels: Sequence[float] = LEVELS,
    sweep: Sequence[float] = SWEEP,
    progress: Callable[[str], None] = lambda _: None,
) -> StudyResult:
    """Run the study in memory; parameters as :func:`pymc_ship.study`, with the levels of the tables and the sweep."""
    vessel = as_vessel(vessel)
    level = noise_sd(level)
    progress("reference trial")
    trial = simulate(vessel, zigzag(20, 20), duration=DURATION, step=STEP)
    unit_sd = {name: noise_factors()[name] * float(np.abs(trial[name]).max()) for name in default_channels()}
    result = StudyResult(vessel, trial, level, seed, cramer_rao_bound(trial, vessel, unit_sd, method="euler"))
    for name, manoeuvre in MANOEUVRES.items():
        result.references[name] = simulate(vessel, manoeuvre, duration=DURATION, step=STEP, record_interval=0.5)
    for one in sorted({*levels, level}):
        _level(result, one, progress)
    _cross_check(result, progress)
    _denoisers(result, progress)
    _replication(result, sweep, progress)
    _from_the_bound(result, progress)
    return result


def _level(result: StudyResult, level: float, progress: Callable[[str], None]) -> None:
    progress(f"noise level {level:.3g}: denoising")
    noisy = pollute(result.trial, level=level, rng=generator(result.seed, "noise", level))
    smooth = denoise(noisy)
    optimised = level in (result.level, LITERAL_LEVEL)
    identification = identify(
        smooth,
        result.vessel,
        interval=INTERVAL,
        selection="bayesian_optimisation" if optimised else "evidence",
        rng=generator(result.seed, "prior", level),
        progress=lambda text: progress(f"noise level {level:.3g}: {text}"),
    )
    result.noisy[level], result.smooth[level], result.identifications[level] = noisy, smooth, identification
    summary = summary_rows(result.vessel, identification.exact, level=level)
    result.tables.setdefault("errors", []).extend(summary)
    for name, manoeuvre in MANOEUVRES.items():
        progress(f"noise level {level:.3g}: forecast of the {manoeuvre.label}")
        trees = {family: _forecast(result, identification, family, manoeuvre, level) for family in PAPER_FAMILIES}
        truth = indices(result.references[name])
        rows = [
            forecast_row(result.references[name], truth, tree, level=level, family=family)
            for family, tree in trees.items()
        ]
        result.tables.setdefault(f"forecast_{name}", []).extend(rows)
        if level == result.level:
            result.forecasts[name] = trees


def _forecast(
    result: StudyResult, identification: Identification, family: str, manoeuvre: Manoeuvre, level: float
) -> xr.DataTree:
    rng = generator(result.seed, "forecast", level, family, manoeuvre.kind)
    ship = Ship.from_posterior(result.vessel, identification.posteriors(family, draws=400, rng=rng), rng=rng)
    return forecast(ship, manoeuvre, rng=rng, duration=DURATION, **AS_PUBLISHED)


def _cross_check(result: StudyResult, progress: Callable[[str], None]) -> None:
    identification = result.identifications[result.level]
    samplers = {"gibbs": gibbs_posterior, "nuts": nuts_posterior}
    for family in PAPER_FAMILIES:
        exact = identification.posteriors(family, draws=4000, rng=generator(result.seed, "exact", family))
        exact = {dof: tree.drop_nodes(_BY_ROW, errors="ignore") for dof, tree in exact.items()}
        result.draws[family] = {"exact": exact, **{name: {} for name in samplers}}
        result.agreement[family] = {}
        for dof, data in identification.data.items():
            prior = identification.priors[family][dof]
            trees = {}
            for name, sampler in samplers.items():
                progress(f"{name}: {dof}, {family}")
                rng = generator(result.seed, name, family, dof)
                tree = sampler(data, prior, draws=2000, chains=4, rng=rng)
                result.draws[family][name][dof] = trees[name] = tree.drop_nodes(_BY_ROW, errors="ignore")
            result.agreement[family][dof] = agreement(identification.exact[family][dof], trees)


def _denoisers(result: StudyResult, progress: Callable[[str], None]) -> None:
    vessel, noisy, smooth = result.vessel, result.noisy[result.level], result.smooth[result.level]
    progress("methods of denoising")
    result.tables["denoisers"] = denoisers.denoiser_rows(result.trial, noisy, vessel, interval=INTERVAL)
    progress("draws of the denoised record")
    drawn = denoise_draws(noisy, draws=denoisers.N_DRAWS, rng=generator(result.seed, "denoised"))
    result.tables["drawn_channels"] = denoisers.channel_rows(result.trial, drawn)
    rng = generator(result.seed, "pooled")
    result.tables["drawn_coefficients"] = denoisers.draw_rows(smooth, drawn, vessel, interval=INTERVAL, rng=rng)


def _replication(result: StudyResult, sweep: Sequence[float], progress: Callable[[str], None]) -> None:
    vessel, identification = result.vessel, result.identifications[result.level]
    progress("cost of discretisation")
    result.tables["discretisation"] = replication.discretisation_rows(result.trial, vessel, interval=INTERVAL)
    result.tables["differencing"] = replication.differencing_rows(
        result.smooth[result.level], vessel, ("euler", "central", "savgol"), (INTERVAL, None)
    )
    result.tables["sweep"] = replication.level_rows(
        result.trial, vessel, sweep, rng=generator(result.seed, "sweep"), progress=progress
    )
    result.tables["priors"] = replication.prior_rows(vessel, identification)
    progress("ships of the priors")
    result.tables["prior_ships"] = prior_ship_rows(
        vessel, identification, result.noisy[result.level], lambda *words: generator(result.seed, "prior ships", *words)
    )
    result.tables["published"] = published_rows(vessel, PAPER_FAMILIES)
    result.tables["printed_errors"] = replication.printed_error_rows(vessel, PAPER_FAMILIES)
    result.tables["full_conditional"] = replication.full_conditional_rows(
        identification, result.draws["conjugate"]["nuts"]
    )


def _from_the_bound(result: StudyResult, progress: Callable[[str], None]) -> None:
    """Errors of every method and of the Cramer-Rao bound on the noisy trials, and forecasts of the trajectory fit."""
    vessel, bound, tables = result.vessel, result.bound.values, result.tables
    tables["published_bound"] = replication.published_bound_rows(vessel, bound, PAPER_FAMILIES)
    tables["methods"] = []
    for level in [level for level in result.noisy if level > 0.0]:
        progress(f"noise level {level:.3g}: trajectory fit and weak form")
        noisy = result.noisy[level]
        modes = trajectory_modes(noisy, vessel, TRAJECTORY_PRIORS, method="euler")  # as the trial was made
        tables["methods"] += replication.method_rows(
            vessel, level * bound, noisy, result.smooth[level], result.identifications[level], modes, level=level
        )
        if (mode := modes[TRAJECTORY_PRIORS[-1]]) is not None:
            _trajectory_forecasts(result, level, mode, progress)


def _trajectory_forecasts(
    result: StudyResult, level: float, mode: TrajectoryMode, progress: Callable[[str], None]
) -> None:
    rng = generator(result.seed, "trajectory", level)
    posterior = laplace_posterior(mode, draws=400, chains=4, rng=rng)
    labels = {"level": level, "pareto_khat": posterior.attrs["pareto_khat"]}
    for name, manoeuvre in MANOEUVRES.items():
        progress(f"noise level {level:.3g}: forecast of the {manoeuvre.label} from the trajectory fit")
        ship = Ship.from_posterior(result.vessel, posterior, rng=rng, noise_sd={})
        tree = forecast(ship, manoeuvre, rng=rng, duration=DURATION, **AS_PUBLISHED)
        reference = result.references[name]
        row = forecast_row(reference, indices(reference), tree, **labels)
        result.tables.setdefault(f"trajectory_{name}", []).append(row)
