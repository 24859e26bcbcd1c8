"""Bayesian identification of ship manoeuvring models: from a trial to coefficients, their uncertainty and a forecast.

Every public name below is loaded where it is first used, so that ``import pymc_ship`` stays light.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType

__version__ = "0.1.0"

_PUBLIC = {
    "vessel.vessel": ("load_vessel", "shipped_vessels", "Vessel", "VesselError"),
    "vessel.hull_database": ("hull_coefficients",),
    "manoeuvre.standard": ("zigzag", "turning_circle", "rudder_programme", "Manoeuvre", "ManoeuvreError"),
    "design.candidates": ("candidate_trials",),
    "trial.record": ("write_trial", "check_trial", "TrialError"),
    "trial.reading": ("read_trial",),
    "motion.simulation": ("simulate", "SimulationError"),
    "motion.sensitivities": ("sensitivities",),
    "trial.noise": ("pollute",),
    "denoising.ebayes": ("ebayes_threshold",),
    "denoising.denoise": (
        "denoise",
        "denoise_signal",
    ),
    "manoeuvre.indices": ("indices",),
    "manoeuvre.criteria": ("imo_probabilities", "imo_criteria"),
    "machine.files": ("OutputError",),
    "motion.weak_form": ("weak_form_start", "coefficient_scales"),
    "regression.data": ("regression_data", "RegressionData", "RegressionDataError"),
    "regression.streamed": ("stream_regression", "StreamedRegression"),
    "regression.priors": ("ConjugatePrior", "SemiConjugatePrior", "PriorError"),
    "sampling.predictive": ("with_predictive",),
    "regression.prior_table": (
        "informed_prior",
        "hold_fixed",
        "restore_fixed",
        "order_damped_prior",
        "sister_ship_table",
    ),
    "regression.tree": ("write_posterior", "read_posterior"),
    "checks.trial_checks": ("trial_checks", "corrected_trial", "check_table"),
    "trajectory.prior": ("coefficient_prior", "posterior_prior", "CoefficientPrior"),
    "trajectory.fit": ("TrajectoryError",),
    "trajectory.posterior": ("trajectory_posterior",),
    "regression.conjugate": ("conjugate", "conjugate_posterior"),
    "regression.semiconjugate": ("semiconjugate", "semiconjugate_posterior"),
    "sampling.gibbs": ("gibbs", "gibbs_posterior"),
    "sampling.regression_model": ("pymc_model", "nuts_posterior"),
    "sampling.trajectory_model": ("trajectory_model", "trajectory_nuts_posterior"),
    "diagnostics.agreement": ("agreement",),
    "diagnostics.calibration": ("simulation_based_calibration", "coverage", "geweke"),
    "regression.tune": ("tune_prior", "maximise_evidence"),
    "forecasting.extrapolation": ("extrapolation",),
    "forecasting.forecast": ("forecast",),
    "design.identifiability": ("identifiability", "fitted_identifiability", "fisher_information"),
    "design.trial_design": ("design_trials", "TrialDesignError"),
    "regression.identify": ("identify", "Identification"),
    "vessel.term_sets": ("term_sets", "with_terms"),
    "manoeuvre.recognition": ("recognise",),
    "ship.model": ("identify_ship", "ShipModel"),
    "ship.files": ("forecast_ship", "save_ship", "load_ship", "IdentifiedShip"),
    "replication.study": ("run_study", "StudyResult"),
    "replication.page": ("study",),
    "experiments.run": ("montecarlo",),
    "diagnostics.page": ("diagnostic_report",),
    "machine.workers": ("MonteCarloError",),
    "denoising.derivative": ("derivative",),
}
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = ["__version__", *_MODULE_OF]


class _Package(ModuleType):
    """Package whose public functions win over submodules of the same name (``simulate``, ``denoise``, ...)."""

    def __getattr__(self, name: str):
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'pymc_ship' has no attribute {name!r}")
        value = getattr(import_module(f"pymc_ship.{_MODULE_OF[name]}"), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value):
        if not (name in _MODULE_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self):
        return sorted({*super().__dir__(), *__all__})


sys.modules[__name__].__class__ = _Package
