"""Quality flags of a record: verdict and remarks in its attrs and in those of every posterior fitted to it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import xarray as xr

from pymc_ship.trial.record import has_ground_speeds

_OF_A_FIT = ("excitation", "ranges")  # checks of what a record can teach a fit
VERDICTS = ("good", "not checked", "doubtful", "bad")  # a trial with a bad check is not fitted


def worst_verdict(verdicts: Iterable[str]) -> str:
    """Worst verdict; "good" without any."""
    return max(verdicts, key=VERDICTS.index, default="good")


def with_quality_flags(trial: xr.Dataset, verdict: str, remarks: Sequence[str]) -> xr.Dataset:
    """Trial with the verdict, and a sentence for each doubtful or overruled check, in its attrs."""
    return trial.assign_attrs(record_verdict=verdict, record_remarks="\n".join(remarks))


def quality_flags(trials: Sequence[xr.Dataset], names: Sequence[str] = ()) -> dict[str, str]:
    """Attrs of a posterior: worst ``record_verdict`` of its trials, and all ``record_remarks`` by their ``names``."""
    heads = [f"{name}: " for name in names] or [""] * len(trials)
    remarks = [
        f"{head}{remark}"
        for head, trial in zip(heads, trials, strict=True)
        for remark in trial.attrs.get("record_remarks", "").splitlines()
    ]
    verdict = worst_verdict(trial.attrs.get("record_verdict", "not checked") for trial in trials)
    return {"record_verdict": verdict, "record_remarks": "\n".join(remarks)}


def quality_remarks(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentence on each doubtful or overruled check of trials by name, for a page or text that has their numbers.

    Without the checks of what a record can teach a fit.
    """
    remarks = quality_flags(list(trials.values()), list(trials))["record_remarks"].splitlines()
    return [remark for remark in remarks if not any(f"Doubtful: {check}" in remark for check in _OF_A_FIT)]


def ground_remarks(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentence on trials whose speeds are over ground, for simulations through still water; none without any."""
    named = [name for name, trial in trials.items() if has_ground_speeds(trial)]
    if not named:
        return []
    return [
        f"The speeds of {', '.join(named)} are over ground, and are compared with still water: a current counts as an "
        "error of the ship."
    ]
