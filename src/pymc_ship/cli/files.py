"""Vessels, trials and manoeuvres that a command names, and CSV files that it writes."""

import argparse
import html
import json
import os
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

import pymc_ship as ps
from pymc_ship.machine.errors import OutputError, TrialError
from pymc_ship.machine.files import final_path, staged_path, writable_folder
from pymc_ship.physics.manoeuvre.registry import KINDS
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, standard_manoeuvre
from pymc_ship.physics.vessel.plausibility import remarks
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.lag import common_lag
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.records.files.sides import check_one_side
from pymc_ship.records.files.tables import bag_of

Progress = Callable[..., None]
Outcome = tuple[str, Path | None] | tuple[str, Path | None, str] | tuple[str, Path | None, str, int]

_RESULTS = (".csv", ".html", ".json")  # files of a result that have the command that made them
_NOT_RECORDED = ("command", "force", "join", "out", "quiet", "write_format")


def vessel_argument(source: str, progress: Progress) -> Vessel:
    """Vessel of a name or a file; remarks on estimated and doubtful values are printed."""
    vessel = ps.load_vessel(source)
    for sentence in remarks(vessel):
        progress(f"{source}: {sentence}", remark=True)
    return vessel


def model_argument(source: str, progress: Progress) -> Vessel:
    """Vessel of a name or a file with terms of every degree of freedom; otherwise VesselError."""
    vessel = vessel_argument(source, progress)
    vessel.check_model()
    return vessel


def check_joined(args: argparse.Namespace) -> None:
    """Raise TrialError for a folder as a trial without ``--join``."""
    facilities = (path for _, *paths in getattr(args, "facility", None) or () for path in paths)
    named = [getattr(args, "trial", ""), *getattr(args, "trials", ()), *getattr(args, "measured", ()), *facilities]
    folder = next((path for path in named if path and os.path.isdir(bag_of(Path(path)))), "")
    if folder and not getattr(args, "join", True):
        raise TrialError(
            f"A trial is a file, found the folder {folder}; name its files, or add --join if they are one run."
        )


def trial_argument(path: str, layout: str | None, progress: Progress) -> xr.Dataset:
    """Trial of a file and its format file; remarks on its interpretation are printed."""
    trial = ps.read_trial(path, format=layout)
    for sentence in trial.attrs["reading"].splitlines():
        progress(f"{path}: {sentence}", remark=True)
    return trial


def validated_trials(
    paths: Sequence[str],
    layout: str | None,
    vessel: Vessel,
    args: argparse.Namespace,
    progress: Progress,
    *,
    any_speed: bool = False,
) -> tuple[list[xr.Dataset], list[tuple[Check, ...]]]:
    """Corrected trials of one facility and their checks; corrections, doubts and overruled checks are printed.

    All trials have the same lag of velocities behind the track. A model for any speed takes whole records. TrialError
    for a bad check that is not overruled.
    """
    trials, checks = [], []
    for path in paths:
        trials.append(trial_argument(path, layout, progress))
        progress(f"checking {path}")
        checks.append(ps.trial_checks(trials[-1], vessel, any_speed=any_speed))
    check_one_side(dict(zip(paths, trials, strict=True)))
    if len(paths) > 1 and (lag := common_lag(checks)):
        checks = [ps.trial_checks(trial, vessel, lag=lag, any_speed=any_speed) for trial in trials]
    for k, path in enumerate(paths):
        try:
            trials[k] = ps.corrected_trial(trials[k], checks[k], args.overrule)
        except TrialError as error:
            raise TrialError(f"{path}: {error}", checks=error.checks) from None
        remarks = trials[k].attrs["record_remarks"]
        others = [correction for correction in trials[k].attrs["corrections"] if correction not in remarks]
        for sentence in [*remarks.splitlines(), *others]:
            progress(f"{path}: {sentence}", remark=True)
    return trials, checks


def requested_manoeuvres(args: argparse.Namespace, sides: Sequence[str], **settings: Any) -> list[Manoeuvre]:
    """Manoeuvres of the options, each to every side; with settings such as ``approach_speed``."""
    manoeuvres = []
    for kind in KINDS.values():
        given = getattr(args, kind.option.replace("-", "_")) if kind.option else []
        for value in given if isinstance(given, list) else [given]:
            if value is not None:
                angles = value if isinstance(value, tuple) else (value,)
                manoeuvres += [standard_manoeuvre(kind.name, *angles, side=side, **settings) for side in sides]
    return manoeuvres


def output_file(path: str, option: str = "--out") -> Path:
    """Path of a writable file; a missing folder is created."""
    if Path(path).is_dir():
        raise OutputError(f"{option} must be a file, found the folder {path}; give the name of a file in it.")
    writable_folder(final_path(path).parent)
    return Path(path)


def check_replaced(args: argparse.Namespace) -> None:
    """Raise OutputError where an output of a command would replace an input, or a file of another command or a user.

    A result of the same command and options may be replaced, and so may anything with ``--force``.
    """
    values = [value for key, value in vars(args).items() if key not in _NOT_RECORDED]
    words = [word for value in values for word in (value if isinstance(value, list) else [value])]
    inputs = {os.path.realpath(word) for word in words if isinstance(word, str) and Path(word).is_file()}
    for option in ("out", "write_format"):
        path = Path(getattr(args, option, None) or "")
        if not path.name or not (path.is_file() or path.is_dir()) or getattr(args, "force", True):
            continue
        option = f"--{option.replace('_', '-')}"
        if os.path.realpath(path) in inputs:
            raise OutputError(f"{option} must not be an input, found {path}; give another name, or --force.")
        if option == "--write-format" or not _is_own_result(path, args):
            raise OutputError(
                f"{option} must be new or a result of the same command and options, found another at {path}; "
                "give another name, or --force to replace it."
            )


def _is_own_result(path: Path, args: argparse.Namespace) -> bool:
    """Whether a command makes a file anew, or whether no result in a folder is of other options of it."""
    own = made_by(args).split(" ", 2)[2]
    files = [path] if path.is_file() else [one for one in path.glob("*.*") if one.suffix in _RESULTS and one.is_file()]
    texts = [html.unescape(one.read_text("utf-8", "replace")).replace('\\"', '"') for one in files]
    made = [(text.count(own), len(re.findall(rf"pymc-ship \S+ {args.command} {{", text))) for text in texts]
    return all(mine == total for mine, total in made) and (path.is_dir() or sum(total for _, total in made) > 0)


def made_by(args: argparse.Namespace) -> str:
    """Version, command and options that made a file, without output paths."""
    options = {key: value for key, value in sorted(vars(args).items()) if key not in _NOT_RECORDED}
    for key in ("trial", "format", "posterior", "programme", "vessel"):
        if options.get(key):
            options[key] = Path(options[key]).name
    return f"pymc-ship {ps.__version__} {args.command} {json.dumps(options)}"


def write_trial_file(trial: xr.Dataset, path: Path, args: argparse.Namespace) -> None:
    """Write a trial, with its command and corrections as comments."""
    with staged_path(path) as partial:
        text = ps.write_trial(trial, partial).read_text(encoding="utf-8")
        remarks = [f"# {remark}\n" for remark in (made_by(args), *trial.attrs.get("corrections", ()))]
        partial.write_text("".join(remarks) + text, encoding="utf-8")


def write_text(path: Path, text: str) -> None:
    """Write a text that appears under its name only when it is complete."""
    with staged_path(path) as partial:
        partial.write_text(text, encoding="utf-8")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence], args: argparse.Namespace) -> None:
    """Write rows under a header, with the command as a comment."""
    lines = [f"# {made_by(args)}", ",".join(header), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
