"""The errors of the package: one class for each kind of input or output that is wrong.

The text of an error is one sentence: the rule, what was found and the remedy.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class ShipError(ValueError):
    """The root of the errors of this package."""


class OutputError(ShipError):
    """A folder or file that cannot be written."""


class VesselError(ShipError):
    """A vessel file that cannot be used; the sentence names the key."""


class TrialError(ShipError):
    """A record, or the conditions of a sea trial, that cannot be used; the sentence names the channel or the key.

    Attributes
    ----------
    checks : tuple of Check
        Bad checks that nobody has overruled, where the record must not be fitted because of them.
    """

    def __init__(self, *args: object, checks: Iterable[Any] = ()) -> None:
        super().__init__(*args)
        self.checks = tuple(checks)


class SimulationError(ShipError):
    """A manoeuvre that no ship can run, or settings that no simulation and no design of trials can use."""


class InferenceError(ShipError):
    """Data, a prior, folds or a search that no regression and no fit can use."""


class FitError(ShipError):
    """A fit of trajectories that cannot be trusted or started.

    Attributes
    ----------
    refusals : tuple of Refusal
        Where each term set fails, if no term set can be fitted.
    """

    def __init__(self, *args: object, refusals: Iterable[Any] = ()) -> None:
        super().__init__(*args)
        self.refusals = tuple(refusals)


class StudyError(ShipError):
    """A Monte-Carlo study that cannot be run."""
