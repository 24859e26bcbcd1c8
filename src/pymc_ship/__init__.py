"""Bayesian identification of ship manoeuvring models: from a trial to coefficients, their uncertainty and a forecast.

Every public name is loaded where it is first used (PEP 562), so that ``import pymc_ship`` stays light.
"""

from importlib import import_module

__version__ = "0.1.0"

_PUBLIC = {
    "machine.errors": "FitError InferenceError OutputError ShipError SimulationError StudyError TrialError VesselError",
    "trial.channels": "Channel register_channel",
    "trial.record": "write_trial",
    "trial.units": "Unit",
    "physics.forces.modular": "register_part",
    "physics.forces.part": "Force Parameter Part",
    "physics.vessel.reading": "load_vessel",
    "physics.vessel.rescaling": "rescale",
    "physics.vessel.term_sets": "term_sets with_terms",
    "physics.vessel.vessel": "Vessel",
    "physics.manoeuvre.criteria": "imo_probabilities",
    "physics.manoeuvre.indices": "indices",
    "physics.manoeuvre.kinds": "Index ManoeuvreKind",
    "physics.manoeuvre.registry": "register_manoeuvre",
    "physics.manoeuvre.standard": "Manoeuvre direct_spiral pull_out rudder_programme turning_circle zigzag",
    "physics.motion.simulation": "simulate",
    "records.files.instruments": "Instrument",
    "records.files.noise": "pollute",
    "records.files.reading": "read_trial",
    "records.denoising.denoise": "denoise denoise_signal",
    "records.denoising.draws": "denoise_draws denoise_signal_draws",
    "records.steering.recognition": "recognise",
    "records.checks.trial_checks": "corrected_trial trial_checks validated_trial",
    "inference.rows.data": "RegressionData",
    "inference.rows.from_trials": "regression_data",
    "inference.regression.calibration": "simulation_based_calibration",
    "inference.regression.conjugate": "ConjugatePrior",
    "inference.regression.families": "register_family",
    "inference.regression.identify": "identify pooled_coefficients regression_draws",
    "inference.regression.prior_table": "hold_fixed informed_prior order_damped_prior restore_fixed sister_ship_table",
    "inference.regression.priors": "Prior",
    "inference.regression.semiconjugate": "SemiConjugatePrior",
    "inference.regression.tree": "exact_posterior read_posterior write_posterior",
    "inference.regression.tune": "maximise_evidence",
    "inference.trajectory.posterior": "trajectory_posterior",
    "inference.trajectory.prior": "coefficient_prior",
    "inference.captive.fit": "fit_captive",
    "inference.captive.table": "read_captive",
    "inference.sampling.from_pymc": "posterior_tree",
    "inference.sampling.gibbs": "gibbs_posterior",
    "inference.sampling.hierarchical_model": "hierarchical_posterior",
    "inference.sampling.predictive": "predict with_predictive",
    "inference.sampling.prior_laws": "horseshoe r2d2",
    "inference.sampling.regression_model": "nuts_posterior pymc_model",
    "inference.sampling.trajectory_model": "trajectory_model trajectory_nuts_posterior",
    "inference.identifiability.information": "identifiability",
    "ships.ensemble.files": "load_ship save_ship",
    "ships.ensemble.ship": "Ship",
    "ships.forecasting.forecast": "forecast",
    "ships.forecasting.page": "write_forecast_page",
    "ships.forecasting.prior_ships": "prior_ships",
    "ships.forecasting.steady_turns": "steady_turns",
    "ships.forecasting.stopping": "stopping",
    "ships.design.next_run": "design",
    "ships.identification.model": "identify_ship",
    "ships.identification.page": "write_ship_report",
    "ships.identification.replay": "replay score score_indices",
    "ships.identification.score_page": "write_score_page",
    "ships.sea_trials.page": "trial_report",
    "ships.sea_trials.sea_trial": "sea_trial",
    "diagnostics.agreement": "agreement",
    "diagnostics.page": "diagnostic_report",
    "replication.estimates": "Estimate",
    "replication.page": "study",
    "experiments.run": "montecarlo",
}
"""Public names of each room, with spaces between; editors and type checkers read the same table in ``__init__.pyi``."""

_MODULE_OF = {name: room for room, names in _PUBLIC.items() for name in names.split()}

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> object:
    """Load a public name from its room, and keep it."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pymc_ship' has no attribute {name!r}")
    value = getattr(import_module(f"pymc_ship.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, in alphabetical order."""
    return sorted(__all__)
