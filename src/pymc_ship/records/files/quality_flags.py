"""What the checks said of a record, kept in its attrs and in those of every posterior that was fitted to it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import xarray as xr

VERDICTS = ("good", "not checked", "doubtful", "bad")
"""From the least to the most that there is to do; a trial with a bad check is not fitted."""


def worst(verdicts: Iterable[str]) -> str:
    """Worst of some verdicts; "good" where there is none."""
    return max(verdicts, key=VERDICTS.index, default="good")


def with_quality_flags(trial: xr.Dataset, verdict: str, remarks: Sequence[str]) -> xr.Dataset:
    """Trial whose attrs keep the verdict on the record and a sentence for each doubt and each overruled check."""
    return trial.assign_attrs(record_verdict=verdict, record_remarks="\n".join(remarks))


def quality_flags(trials: Sequence[xr.Dataset], names: Sequence[str] = ()) -> dict[str, str]:
    """Attrs of a posterior: the worst verdict on its trials and what was said of each.

    Parameters
    ----------
    trials : sequence of Dataset
        Those that :func:`pymc_ship.validated_trial` did not judge count as "not checked".
    names : sequence of str, optional
        Of the trials, to stand before each remark.

    Returns
    -------
    dict of str to str
        ``record_verdict`` and ``record_remarks``, a line for each remark.
    """
    heads = [f"{name}: " for name in names] or [""] * len(trials)
    remarks = [
        f"{head}{remark}"
        for head, trial in zip(heads, trials, strict=True)
        for remark in trial.attrs.get("record_remarks", "").splitlines()
    ]
    verdict = worst(trial.attrs.get("record_verdict", "not checked") for trial in trials)
    return {"record_verdict": verdict, "record_remarks": "\n".join(remarks)}
