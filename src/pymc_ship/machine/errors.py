"""The errors of the package, one class for each kind of wrong input or output."""

from collections.abc import Iterable
from typing import Any


class ShipError(ValueError):
    """The root of the errors of this package."""


class OutputError(ShipError):
    """A folder or file that cannot be written."""


class VesselError(ShipError):
    """A vessel file that cannot be used."""


class TrialError(ShipError):
    """A record or conditions of a sea trial that cannot be used.

    Attributes
    ----------
    checks : tuple of Check
        Bad checks that are not overruled, if they forbid a fit of the record.
    """

    def __init__(self, *args: object, checks: Iterable[Any] = ()) -> None:
        super().__init__(*args)
        self.checks = tuple(checks)


class SimulationError(ShipError):
    """A manoeuvre, simulation or design of trials with unusable settings."""


class InferenceError(ShipError):
    """Regression data, priors, folds or settings that cannot be used."""


class FitError(ShipError):
    """A fit of trajectories that did not start or converge.

    Attributes
    ----------
    refusals : tuple of Refusal
        Why each term set fails, if none can be fitted.
    """

    def __init__(self, *args: object, refusals: Iterable[Any] = ()) -> None:
        super().__init__(*args)
        self.refusals = tuple(refusals)


class StudyError(ShipError):
    """A Monte-Carlo study that cannot be run."""
