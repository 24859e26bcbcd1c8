"""The commands of a naval architect: identify a ship from her trials, forecast what she will do."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.files import (
    Outcome,
    Progress,
    check_options,
    judged_arguments,
    made_by,
    requested_manoeuvres,
    vessel_argument,
    write_csv,
)
from pymc_ship.cli.parser import SHIP_PRIORS
from pymc_ship.cli.texts import (
    forecast_text,
    form_text,
    held_out_text,
    index_text,
    next_runs_text,
    probability_text,
    score_text,
    term_set_text,
)
from pymc_ship.machine.errors import SimulationError
from pymc_ship.machine.files import staged_files, writable_folder
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.vessel.term_sets import holds_any_speed, takes_part_sets
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.records.files.format import load_format
from pymc_ship.records.steering.recognition import recognise_by_facility, unrecognised
from pymc_ship.ships.forecasting.index_error import BEYOND, error_rows
from pymc_ship.ships.identification.files import FOLDER, forecast_ship, load_ship, save_ship
from pymc_ship.ships.identification.model import IdentifiedShip
from pymc_ship.trial.record import facility_of

SIDES = ("port", "starboard")


def identify(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Identify a ship from her trials, report on it and save it."""
    from pymc_ship.machine.errors import FitError
    from pymc_ship.ships.identification.model import identify_ship
    from pymc_ship.ships.identification.page import PAGE, write_ship_report
    from pymc_ship.ships.identification.refusal_page import write_refusal_page

    vessel = vessel_argument(args.vessel, progress)
    any_speed = takes_part_sets(vessel) and not args.terms
    files = [(path, args.format) for path in args.trials]
    files += [(path, layout) for layout, *paths in args.facility for path in paths]
    _check_facilities(args)
    captive = ps.read_captive(args.captive, vessel, format=args.captive_format) if args.captive else None
    trials, checks = checked_trials(files, vessel, args, progress, any_speed=any_speed)
    out, rng = writable_folder(args.out), np.random.default_rng(args.seed)
    settings = {
        "captive": captive,
        "names": list(trials),
        "terms": args.terms,
        "prior": args.prior if args.prior in (None, *SHIP_PRIORS) else load_ship(args.prior),
        "draws": args.draws,
    }
    try:
        model = identify_ship(list(trials.values()), vessel, rng=rng, progress=progress, **settings)
    except FitError as error:
        if not error.refusals:
            raise
        page = write_refusal_page(error.refusals, vessel, checks, out, command=made_by(args))
        raise ValueError(f"{str(error).removesuffix('.')}; {page} shows where each fails.") from None
    made = {"command": made_by(args), "seed": args.seed, "given": vessel, "progress": progress}
    with staged_files(out, last=PAGE.file, own=(*PAGE.own, f"{FOLDER}/*")) as folder:
        save_ship(model, folder, made_by=made_by(args))
        write_ship_report(model, trials, checks, folder, **made)
    text = [term_set_text(model), held_out_text(model), "\n".join(model.outlook), "\n".join(model.remarks)]
    return "\n\n".join(filter(None, [*text, model.judgement["record_remarks"]])), out / PAGE.file


def _names(paths: Sequence[str]) -> list[str]:
    """Names of runs: those of the files without endings or, where two are alike, the paths."""
    short = [Path(path).name.split(".")[0] for path in paths]
    return short if len(set(short)) == len(paths) else list(paths)


def _check_facilities(args: argparse.Namespace) -> None:
    """Refuse runs of another facility without its name: their gear would be taken for that of the others."""
    for layout, *paths in args.facility:
        if not paths:
            raise ps.TrialError(
                f"A facility has its format file and then its runs, found {layout} alone; add the runs."
            )
        if not load_format(layout).facility:
            raise ps.TrialError(f'{layout} names no facility; add a line such as facility = "basin B".')


def checked_trials(
    files: Sequence[tuple[str, str | None]],
    vessel: Vessel,
    args: argparse.Namespace,
    progress: Progress,
    *,
    any_speed: bool = False,
) -> tuple[dict[str, xr.Dataset], dict[str, tuple[Check, ...]]]:
    """Corrected trials and their checks by name, from files and their format files, facility by facility."""
    names = _names([path for path, _ in files])
    trials: dict[str, xr.Dataset] = {}
    checks: dict[str, tuple[Check, ...]] = {}
    for layout in dict.fromkeys(layout for _, layout in files):
        mine = {name: path for name, (path, of) in zip(names, files, strict=True) if of == layout}
        found = judged_arguments(list(mine.values()), layout, vessel, args, progress, any_speed=any_speed)
        for table, values in zip((trials, checks), found, strict=True):
            table |= dict(zip(mine, values, strict=True))
    return trials, checks


def holds_ship(path: str) -> bool:
    """Whether a path is the folder of an identified ship."""
    return (Path(path) / FOLDER).is_dir()


def forecast_identified(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Forecast manoeuvres of an identified ship and write the page; the text has indices and IMO verdicts."""
    from pymc_ship.ships.forecasting.page import write_forecast_page
    from pymc_ship.ships.forecasting.steady_turns import spiral_sentence, steady_turns
    from pymc_ship.ships.forecasting.stopping import stopping, stopping_sentence

    ship = load_ship(args.posterior)
    vessel = vessel_argument(args.vessel, progress) if args.vessel else ship.vessel
    manoeuvres = requested_manoeuvres(args, (args.side,) if args.side else SIDES)
    measured = _measured(args, ship, progress)
    known = {manoeuvre.label for manoeuvre, _ in measured.values()}
    wanted = {manoeuvre.label: manoeuvre for manoeuvre in manoeuvres if manoeuvre.label not in known}
    wanted |= {label: manoeuvre for label, (manoeuvre, _) in measured.items()}
    turns = steady_turns(ship.models) if args.spiral else None
    stop = None if args.stop is None else stopping(ship.models, astern=args.stop)
    if not wanted and turns is None and stop is None:
        raise SimulationError(
            "A forecast needs a manoeuvre, found none; add --zigzag 10/10, --turn 35, --spiral, --stop or --measured."
        )
    out = writable_folder(args.out or args.posterior)
    trees, text = {}, []
    for label, manoeuvre in wanted.items():
        progress(f"forecasting the {label}")
        settings = {"draws": 1000 if args.draws is None else args.draws, "duration": args.duration}
        settings |= {"n": args.n, "wind": args.wind, "current": args.current}
        settings["facility"] = args.facility or _facility(ship, measured.get(label))
        trees[label] = forecast_ship(ship, manoeuvre, rng=np.random.default_rng(args.seed), **settings)
        text.append(_text(trees[label], label, measured, ship.vessel))
    text += [spiral_sentence(turns)] if turns is not None else []
    text += [stopping_sentence(stop)] if stop is not None else []
    page = write_forecast_page(
        trees,
        vessel,
        out,
        measured={label: trial for label, (_, trial) in measured.items()},
        models=ship.models,
        motion=ship.motion,
        turns=turns,
        stop=stop,
        remarks=(*ship.remarks, *_remarks(ship, trees)),
        command=made_by(args),
        progress=progress,
    )
    return "\n\n".join(text), page


def design_identified(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Design the next runs of an identified ship; the text has what each candidate promises and its sea room."""
    check_options(args, of_posterior=("vessel", "criterion", "duration"))
    ship, out = load_ship(args.posterior), writable_folder(args.out)
    room = np.inf if args.sea_room is None else args.sea_room
    found = ps.next_runs(ship, n=args.n, sea_room=room, wind=args.wind, progress=progress)
    with staged_files(out) as folder:
        ratio = found["width_ratio"].transpose("candidate", "step")
        header = ("candidate", "sea_room", *(f"width_ratio_{k}" for k in ratio["step"].values))
        rows = zip(found["candidate"].values, found["sea_room"].values, *ratio.values.T, strict=True)
        write_csv(folder / "next_runs.csv", header, rows, args)
        width = found["half_width"].transpose("target", "stage")
        header = ("manoeuvre", "index", "units", "half_width", *(f"after_{k}" for k in width["stage"].values[1:]))
        targets = [str(target).split(", ") for target in found["target"].values]
        rows = zip(*zip(*targets, strict=True), found["units"].values, *width.values.T, strict=True)
        write_csv(folder / "half_widths.csv", header, rows, args)
    return next_runs_text(found), out


def score(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Score a ship on records in which she is restarted; the text has every channel of every run."""
    ship = load_ship(args.ship) if holds_ship(args.ship) else vessel_argument(args.ship, progress)
    vessel = ship.vessel if isinstance(ship, IdentifiedShip) else ship
    models = [one for one, _ in ship.models] if isinstance(ship, IdentifiedShip) else [ship]
    any_speed = any(map(holds_any_speed, models))
    files = [(path, args.format) for path in args.trials]
    trials, _ = checked_trials(files, vessel, args, progress, any_speed=any_speed)
    out = writable_folder(args.out) if args.out else None
    progress("replaying windows")
    settings = {"length": args.length, "every": args.every, "draws": args.draws}
    found = ps.score(ship, list(trials.values()), names=list(trials), **settings)
    rows = ps.score_indices(ship, list(trials.values()), names=list(trials), seed=args.seed)
    text = "\n\n".join(filter(None, [score_text(found), index_text(rows)]))
    if out is None:
        return text, None
    from pymc_ship.ships.identification.score_page import write_score_page

    return text, write_score_page(ship, trials, found, rows, out, draws=args.draws, command=made_by(args))


def trial_report(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Report on a sea trial; the text has the form's manoeuvring data and what was not corrected."""
    vessel = vessel_argument(args.vessel, progress)
    ship = load_ship(args.ship) if args.ship else None
    full_load = vessel_argument(args.full_load, progress) if args.full_load else None
    files = [(path, args.format) for path in args.trials]
    trials, _ = checked_trials(files, vessel, args, progress, any_speed=True)
    out = writable_folder(args.out)
    settings = {"conditions": args.conditions, "ship": ship, "full_load": full_load, "rng": args.seed}
    found = ps.sea_trial(trials, vessel, progress=progress, **settings)
    progress("writing the page")
    text = "\n\n".join(filter(None, [form_text(found.form), "\n".join(found.remarks)]))
    return text, ps.trial_report(found, out, command=made_by(args))


def _measured(
    args: argparse.Namespace, ship: IdentifiedShip, progress: Progress
) -> dict[str, tuple[Manoeuvre, xr.Dataset]]:
    """Measured trials by the label of the manoeuvre they were recognised as; a second one carries its file's name."""
    found: dict[str, tuple[Manoeuvre, xr.Dataset]] = {}
    if not args.measured:
        return found
    files = [(path, args.format) for path in args.measured]
    trials, _ = checked_trials(files, ship.vessel, args, progress)
    manoeuvres, _ = recognise_by_facility(list(trials.values()), ship.vessel)
    for (name, trial), manoeuvre in zip(trials.items(), manoeuvres, strict=True):
        if manoeuvre is None:
            raise SimulationError(f"{name} cannot stand beside a forecast. {unrecognised(trial)} Leave it out.")
        label = manoeuvre.label if manoeuvre.label not in found else f"{manoeuvre.label} {name}"
        found[label] = manoeuvre, trial
    return found


def _facility(ship: IdentifiedShip, measured: tuple[Manoeuvre, xr.Dataset] | None) -> str | None:
    """Facility of a measured trial, where the ship was identified at it."""
    name = facility_of(measured[1]) if measured else ""
    return name if name and name in ship.facilities else None


def _text(tree: xr.DataTree, label: str, measured: Mapping[str, tuple[Manoeuvre, xr.Dataset]], vessel: Vessel) -> str:
    """Bands of the indices beside what was measured, where it was, and the probability of each IMO criterion."""
    from pymc_ship.records.steering.measured import measured_indices

    beside = {"measured": measured_indices(measured[label][1], tree.attrs)} if label in measured else {}
    verdicts = ps.imo_probabilities(tree, vessel)
    parts = [
        forecast_text(tree, beside),
        tree.attrs["steering"],
        _refused(tree),
        probability_text(verdicts),
        tree.attrs.get("reliability", "") if verdicts else "",
    ]
    return "\n".join(filter(None, parts))


def _refused(tree: xr.DataTree) -> str:
    """Sentence on the draws that run away in a manoeuvre; empty where none does."""
    share = 100.0 * tree.attrs["share_refused"]
    return f"{share:.2g} % of the draws run away in the {tree.attrs['label']} and are left out." if share else ""


def _remarks(ship: IdentifiedShip, trees: Mapping[str, xr.DataTree]) -> list[str]:
    """How the intervals of an identified ship are made."""
    widened = ", ".join(
        "{kind} {median:.2g} of {unit} (95 % below {upper:.2g})".format(**row)
        for row in error_rows(ship.model_error, ship.vessel)
    )
    found = [
        f"{len(ship.models)} term sets take part by their score on held-out runs: their scatter and that of the "
        "coefficients make the bands, tracks and force curves.",
        *(f"{label}: {tree.attrs['steering']}" for label, tree in trees.items()),
        *filter(None, map(_refused, trees.values())),
        *dict.fromkeys(tree.attrs["reliability"] for tree in trees.values() if "reliability" in tree.attrs),
    ]
    if widened:
        found.append(
            "Intervals of the indices also hold the error that foreign ships and held-out manoeuvres show beyond it. "
            f"Its sd by kind of index is: {widened}."
        )
    return [
        *found,
        f"They hold the error of a model where no run has been, too: an sd of {BEYOND:g} of the swing, of L/U and of L "
        "for each range of the runs by which the median ship leaves their motion, as foreign ships showed it.",
    ]
