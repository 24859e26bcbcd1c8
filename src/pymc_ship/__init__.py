"""Bayesian identification of ship manoeuvring models: from a trial to coefficients, their uncertainty and a forecast.

Every public name below is loaded where it is first used, so that ``import pymc_ship`` stays light.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType

__version__ = "0.1.0"

_PUBLIC = {
    "vessel": ("load_vessel", "shipped_vessels", "Vessel", "VesselError"),
    "hull_database": ("hull_coefficients",),
    "manoeuvres": ("zigzag", "turning_circle", "rudder_programme", "Manoeuvre", "ManoeuvreError"),
    "candidates": ("candidate_trials",),
    "trial": ("write_trial", "check_trial", "TrialError"),
    "trial_file": ("read_trial",),
    "simulate": ("simulate", "SimulationError"),
    "sensitivities": ("sensitivities",),
    "noise": ("pollute",),
    "ebayes": ("ebayes_threshold",),
    "denoise": ("denoise", "denoise_signal", "derivative"),
    "indices": ("indices", "imo_criteria"),
    "imo_verdict": ("imo_probabilities",),
    "output": ("OutputError",),
    "weak_form": ("weak_form_start", "coefficient_scales"),
    "regression_data": ("regression_data", "RegressionData", "RegressionDataError"),
    "streamed_regression": ("stream_regression", "StreamedRegression"),
    "priors": ("ConjugatePrior", "SemiConjugatePrior", "PriorError"),
    "predictive": ("with_predictive",),
    "prior_table": ("informed_prior", "hold_fixed", "restore_fixed", "order_damped_prior", "sister_ship_table"),
    "posterior": ("write_posterior", "read_posterior"),
    "trial_checks": ("trial_checks", "corrected_trial", "check_table"),
    "trajectory_prior": ("coefficient_prior", "posterior_prior", "CoefficientPrior"),
    "trajectory_fit": ("TrajectoryError",),
    "trajectory_posterior": ("trajectory_posterior",),
    "conjugate": ("conjugate", "conjugate_posterior"),
    "semiconjugate": ("semiconjugate", "semiconjugate_posterior"),
    "gibbs": ("gibbs", "gibbs_posterior"),
    "pymc_model": ("pymc_model", "nuts_posterior"),
    "trajectory_model": ("trajectory_model", "trajectory_nuts_posterior"),
    "agreement": ("agreement",),
    "calibration": ("simulation_based_calibration", "coverage", "geweke"),
    "tune": ("tune_prior", "maximise_evidence"),
    "extrapolation": ("extrapolation",),
    "forecast": ("forecast",),
    "identifiability": ("identifiability", "fitted_identifiability", "fisher_information"),
    "trial_design": ("design_trials", "TrialDesignError"),
    "identification": ("identify", "Identification"),
    "term_sets": ("term_sets", "with_terms"),
    "recognised": ("recognise",),
    "ship_model": ("identify_ship", "ShipModel"),
    "ship_files": ("forecast_ship", "save_ship", "load_ship", "IdentifiedShip"),
    "study": ("run_study", "StudyResult"),
    "report": ("study",),
    "montecarlo_grid": ("MonteCarloError",),
    "montecarlo": ("montecarlo",),
    "diagnostic_report": ("diagnostic_report",),
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
