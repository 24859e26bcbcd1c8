"""The command ``check``: what a trial file was read as, its checks, its manoeuvre with indices, and its page."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.files import Outcome, Progress, made_by, output_file, vessel_argument, write_text, write_trial_file
from pymc_ship.cli.texts import check_text, table_text
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.trial_checks import doubtful_checks, failed_checks
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.records.files.columns import Column, nearest_heading
from pymc_ship.records.files.format import format_text
from pymc_ship.records.files.reading import FileReading, read_file
from pymc_ship.records.files.ship_scale import ship_scale
from pymc_ship.records.steering.measured import measured_criteria, order_delay, order_sentence
from pymc_ship.records.steering.recognition import STEERED, recognised_manoeuvre, reversals_text, unrecognised_text
from pymc_ship.trial.channels import CHANNELS, unmodelled_roll_text
from pymc_ship.trial.record import nonzero_channels

PAGE = ".html"  # suffix of --out for the page instead of the corrected trial
_COLUMNS = ("column", "channel", "unit", "channel from", "unit from")
_INDICES = ("index", "measured", "unit", "IMO MSC.137(76)", "verdict")


def check(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Check a trial; the text has its columns, what `identify` lacks, each check, the manoeuvre and its indices."""
    vessel = vessel_argument(args.vessel, progress) if args.vessel else None
    reading = read_file(args.trial, args.format)
    out = output_file(args.out) if args.out else None
    if args.write_format:
        write_text(output_file(args.write_format, "--write-format"), format_text(reading.layout, made_by(args)))
    progress("checking")
    checks = ps.trial_checks(reading.trial, vessel)
    for sentence in _remarks(reading.trial, checks):
        progress(f"{args.trial}: {sentence}", remark=True)
    failure = failed_checks(checks)
    trial = reading.trial if failure else ps.corrected_trial(reading.trial, checks)
    name, columns, lacking = Path(args.trial).name, column_rows(reading), lacking_text(trial, vessel)
    manoeuvre, indices = ("", []) if failure else _manoeuvre(trial, vessel)
    text = [table_text(_COLUMNS, columns, f"Columns of {name}"), lacking, check_text(checks), manoeuvre]
    text += [table_text(_INDICES, indices, "Indices of the denoised record")] if indices else []
    printed = "\n\n".join(filter(None, text))
    if out and out.suffix.lower() == PAGE:
        from pymc_ship.cli.check_page import check_page

        progress("writing the page")
        tables = {"columns": (_COLUMNS, columns), "indices": (_INDICES, indices)}
        sentences = {"failure": failure, "manoeuvre": manoeuvre, "lacking": lacking}
        write_text(out, check_page(name, trial, checks, tables, sentences, command=made_by(args)))
    elif out and not failure:
        write_trial_file(trial, out, args)
    if failure:
        return printed, out if out and out.suffix.lower() == PAGE else None, failure
    return printed, out, doubtful_checks(checks), 4


def _remarks(trial: xr.Dataset, checks: Iterable[Check]) -> list[str]:
    """Sentences on the reading of a trial that neither the table of its columns nor a check has."""
    findings = [check.sentence for check in checks]
    sentences = trial.attrs["reading"].splitlines()
    return [one for one in sentences if not one.startswith("Columns ") and not any(one in text for text in findings)]


def column_rows(reading: FileReading) -> list[tuple[str, str, str, str, str]]:
    """Heading, channel, unit, and what channel and unit are known by, of each column of a file."""
    used = sorted(reading.columns.values(), key=lambda column: column.index)
    units = [one.unit if one.code == Column.code else f"{one.unit} ({one.code})" for one in used]
    rows = [(one.heading, one.channel, unit, one.named_by, one.unit_by) for one, unit in zip(used, units, strict=True)]
    others = {heading: nearest_heading(heading, reading.columns) for heading in reading.left_out}
    return [*rows, *((heading, "-", "", f"left out{hint}", "") for heading, hint in others.items())]


def lacking_text(trial: xr.Dataset, vessel: Vessel | None) -> str:
    """Sentence on what `identify` needs beside this record."""
    lacking = [f"{name} ({CHANNELS[name].label})" for name in STEERED if name not in trial]
    lacking += [] if vessel else ["a vessel file with the particulars of the ship (--vessel)"]
    if not lacking:
        return "An identification needs nothing else."
    return f"An identification needs, in addition: {', '.join(lacking)}."


def _manoeuvre(trial: xr.Dataset, vessel: Vessel | None) -> tuple[str, list[tuple[Any, ...]]]:
    roll = "" if vessel is None else unmodelled_roll_text(nonzero_channels(trial), vessel.dofs)
    if not set(STEERED) <= set(trial):
        return roll, []
    unit = ship_scale(trial, vessel).time
    manoeuvre, steering = recognised_manoeuvre(trial, unit)
    if manoeuvre is None:
        return "\n".join(filter(None, [roll, unrecognised_text(trial, unit)])), []
    stated = vessel.particulars.rudder_delay if vessel else 0.0
    delay = order_delay(trial, stated if np.isnan(steering.rudder_delay) else steering.rudder_delay)
    sentences = [
        f"The trial is recognised as a {manoeuvre.label}.",
        order_sentence(delay, manoeuvre.approach_speed or np.nan),
        reversals_text([trial], steering),
    ]
    rows = [tuple(row.values()) for row in measured_criteria(trial, manoeuvre, vessel, delay)]
    return "\n".join(filter(None, [roll, *sentences])), rows
