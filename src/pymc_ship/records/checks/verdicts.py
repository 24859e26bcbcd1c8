"""Outcome of a check: verdict, numbers, sentence; and pieces of a record."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.records.files.ship_scale import SIGNIFICANT

SLOW = 0.3  # fraction of the usual speed below which course and prime values (over U^2) are not used

Numbers = tuple[tuple[str, float, str], ...]  # name, value and unit

_DIFFERENCE = 0.6744897501960817 * np.sqrt(2.0)


@dataclass(frozen=True)
class Check:
    """Outcome of one check: verdict (good, not checked, doubtful, bad), a sentence with the finding and the remedy.

    ``numbers`` are name, value and unit of each measured quantity; ``mendable``: :func:`pymc_ship.corrected_trial`
    corrects the finding.
    """

    name: str
    verdict: str
    sentence: str
    numbers: Numbers = ()
    mendable: bool = False

    def value(self, name: str) -> float:
        """Number of that name; KeyError where there is none."""
        return {label: value for label, value, _ in self.numbers}[name]


def not_checked(name: str, reason: str, numbers: Numbers = ()) -> Check:
    """A check that could not be made, with the reason."""
    return Check(name, "not checked", f"Not checked: {reason}.", numbers)


def missing_channels_text(trial: xr.Dataset, channels: tuple[str, ...]) -> str:
    """Reason for which a check cannot be made: the channels that the trial lacks; empty if none."""
    missing = [name for name in channels if name not in trial]
    if still := [name for name in missing if name in trial.attrs.get("still_channels", ())]:
        return f"{', '.join(still)} stand{'s' if len(still) == 1 else ''} still"
    return f"no {', '.join(missing)} in the record" if missing else ""


def pieces(mask: np.ndarray) -> list[slice]:
    """Runs of neighbours in a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]))).reshape(-1, 2)
    return [slice(*edge) for edge in edges.tolist()]


def longest_piece(mask: np.ndarray) -> slice:
    """Longest run of neighbours in a mask, the first of equal ones; an empty slice without any."""
    return max(pieces(mask), key=lambda piece: piece.stop - piece.start, default=slice(0, 0))


def balance(values: np.ndarray, tail: float) -> float:
    """Lesser over larger extreme of a channel to both sides, without a ``tail`` of each; negative on one side only."""
    low, high = np.quantile(values, [tail, 1.0 - tail])
    return float(min(-low, high) / max(-low, high)) if low or high else 0.0


def straight_approach(trial: xr.Dataset) -> int:
    """Samples before the rudder leaves its first angle by 0.3 deg and by more than its noise; 0 without a rudder."""
    if "delta" not in trial:
        return 0
    delta = trial["delta"].values
    noise = float(np.median(np.abs(np.diff(delta)))) / _DIFFERENCE
    moved = np.abs(delta - np.median(delta[:3])) > max(np.deg2rad(0.3), SIGNIFICANT * noise)
    return int(np.argmax(moved)) if moved.any() else delta.size


def integral(rate: np.ndarray, interval: float) -> np.ndarray:
    """Integral by trapezoids from the first sample on, shape (n_time,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * interval])
