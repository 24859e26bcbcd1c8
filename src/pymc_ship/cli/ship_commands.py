"""Commands on a ship: identify, forecast, design, score, trial-report."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli import texts
from pymc_ship.cli.files import (
    Outcome,
    Progress,
    made_by,
    model_argument,
    requested_manoeuvres,
    validated_trials,
    vessel_argument,
    write_csv,
)
from pymc_ship.cli.parser import SHIP_PRIORS, SIDES
from pymc_ship.inference.regression.tree import FILES, read_posterior
from pymc_ship.machine.errors import SimulationError
from pymc_ship.machine.files import staged_files, writable_folder
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.vessel.term_sets import supports_part_sets, valid_at_any_speed
from pymc_ship.physics.vessel.vessel import Vessel, check_same_vessel
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.records.files.format import load_format
from pymc_ship.records.steering.recognition import recognise_by_facility, unrecognised_text
from pymc_ship.ships.ensemble.files import FOLDER, load_ship, save_ship
from pymc_ship.ships.ensemble.ship import Ship
from pymc_ship.trial.quality_flags import ground_remarks, quality_remarks

_DESIGN_DRAWS = 400  # draws of a posterior that a design simulates


def identify(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Identify a ship, save it and write its page; the text has term sets, held-out manoeuvres and the next run."""
    from pymc_ship.machine.errors import FitError
    from pymc_ship.ships.design.outlook import manoeuvring_summary
    from pymc_ship.ships.identification.model import captive_comparison, identify_ship
    from pymc_ship.ships.identification.page import PAGE, write_refusals, write_ship_report

    vessel = vessel_argument(args.vessel, progress)
    any_speed = supports_part_sets(vessel) and not args.terms
    files = [(path, args.format) for path in args.trials]
    files += [(path, layout) for layout, *paths in args.facility for path in paths]
    _check_facilities(args)
    captive = ps.read_captive(args.captive, vessel, format=args.captive_format) if args.captive else None
    trials, checks = checked_trials(files, vessel, args, progress, any_speed=any_speed)
    out, rng = writable_folder(args.out), np.random.default_rng(args.seed)
    prior = args.prior if args.prior in (None, *SHIP_PRIORS) else load_ship(args.prior)
    settings = {"captive": captive, "names": list(trials), "terms": args.terms, "prior": prior, "draws": args.draws}
    try:
        identification = identify_ship(list(trials.values()), vessel, rng=rng, progress=progress, **settings)
    except FitError as error:
        if not error.refusals:
            raise
        page = write_refusals(error.refusals, vessel, checks, out, command=made_by(args))
        raise ValueError(f"{str(error).removesuffix('.')}; {page} shows where each fails.") from None
    progress("forecasting standard manoeuvres and choosing the next run")
    forecasts, summary = manoeuvring_summary(identification.ship, rng)
    made = {"command": made_by(args), "seed": args.seed, "given": vessel, "progress": progress}
    made |= {"forecasts": forecasts, "summary": summary, "captive": captive_comparison(identification, rng)}
    record: dict[str, Any] = {"runs": identification.names, "quality_flags": identification.quality_flags}
    with staged_files(out, last=PAGE.file, own=(*PAGE.own, f"{FOLDER}/*")) as folder:
        save_ship(identification.ship, folder, made_by=made_by(args), **record)
        write_ship_report(identification, trials, checks, folder, **made)
    text = [
        texts.term_set_text(identification),
        texts.compared_index_text(identification.held_out_indices, "Held-out runs and their forecasts"),
    ]
    text += ["\n".join(sentences) for sentences in (summary, identification.ship.remarks)]
    return "\n\n".join(filter(None, [*text, identification.quality_flags["record_remarks"]])), out / PAGE.file


def _names(paths: Sequence[str]) -> list[str]:
    """Names of runs: file names without suffixes, or the paths if two names are equal."""
    short = [Path(path).name.split(".")[0] for path in paths]
    return short if len(set(short)) == len(paths) else list(paths)


def _check_facilities(args: argparse.Namespace) -> None:
    for layout, *paths in args.facility:
        if not paths:
            raise ps.TrialError(
                f"--facility takes a format file and then its runs, found {layout} alone; add the runs."
            )
        if not load_format(layout).facility:
            raise ps.TrialError(
                f'The format file of --facility must name it, found no facility in {layout}; add facility = "basin B".'
            )


def checked_trials(
    files: Sequence[tuple[str, str | None]],
    vessel: Vessel,
    args: argparse.Namespace,
    progress: Progress,
    *,
    any_speed: bool = False,
) -> tuple[dict[str, xr.Dataset], dict[str, tuple[Check, ...]]]:
    """Corrected trials and their checks by name, from pairs of trial file and format file."""
    names = _names([path for path, _ in files])
    trials: dict[str, xr.Dataset] = {}
    checks: dict[str, tuple[Check, ...]] = {}
    for layout in dict.fromkeys(layout for _, layout in files):
        paths = {name: path for name, (path, of) in zip(names, files, strict=True) if of == layout}
        pair = validated_trials(list(paths.values()), layout, vessel, args, progress, any_speed=any_speed)
        trials |= dict(zip(paths, pair[0], strict=True))
        checks |= dict(zip(paths, pair[1], strict=True))
    return trials, checks


def is_ship_folder(path: str) -> bool:
    """Whether a path is a folder that `identify` wrote."""
    return (Path(path) / FOLDER).is_dir()


def _ship_of(
    args: argparse.Namespace, rng: np.random.Generator, progress: Progress, *, draws: int
) -> tuple[Ship, Vessel]:
    """Ship of a folder of `identify`, or of a posterior with ``--vessel``, and the vessel of its page."""
    if is_ship_folder(args.posterior):
        ship = load_ship(args.posterior)
        return ship, vessel_argument(args.vessel, progress) if args.vessel else ship.vessel
    if args.vessel is None:
        raise ValueError(
            f"The posterior {args.posterior} needs the particulars of its ship, found no --vessel; add --vessel."
        )
    vessel = model_argument(args.vessel, progress)
    posteriors = read_posteriors(Path(args.posterior), args.family, vessel)
    return Ship.from_posterior(vessel, posteriors, draws=draws, rng=rng), vessel


def read_posteriors(path: Path, family: str, vessel: Vessel) -> xr.DataTree | dict[str, xr.DataTree]:
    """Joint posterior of a file, or the posteriors by DOF that `regress` wrote."""
    if path.suffix in FILES:
        return _posterior(path, vessel)
    return {dof: _posterior(path / f"{dof}-{family}.nc", vessel, dof) for dof in vessel.dofs}


def _posterior(path: Path, vessel: Vessel, dof: str = "") -> xr.DataTree:
    """Posterior of a file; ValueError for another DOF than a stated one, VesselError for another vessel."""
    tree = read_posterior(path)
    found = tree.attrs.get("dof")
    if dof and found != dof:
        raise ValueError(f"{path} must be a posterior of {dof}, found one of {found}; run `pymc-ship regress` first.")
    check_same_vessel("The posterior", tree.attrs, vessel, f" in {path}")
    return tree


def forecast(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Forecast manoeuvres and write the page; the text has indices and probabilities of the IMO criteria."""
    from pymc_ship.ships.forecasting.page import measured_doubts, write_forecast_page
    from pymc_ship.ships.forecasting.steady_turns import spiral_sentence, steady_turns
    from pymc_ship.ships.forecasting.stopping import stopping, stopping_sentence

    rng = np.random.default_rng(args.seed)
    ship, vessel = _ship_of(args, rng, progress, draws=args.draws)
    state, simulated = rng.bit_generator.state, None if is_ship_folder(args.posterior) else vessel
    manoeuvres = requested_manoeuvres(args, (args.side,) if args.side else SIDES)
    measured = _measured(args, ship, progress)
    known = {manoeuvre.label for manoeuvre, _ in measured.values()}
    wanted = {manoeuvre.label: manoeuvre for manoeuvre in manoeuvres if manoeuvre.label not in known}
    wanted |= {label: manoeuvre for label, (manoeuvre, _) in measured.items()}
    turns = steady_turns(ship) if args.spiral else None
    stop = None if args.stop is None else stopping(ship, astern=args.stop)
    if not wanted and turns is None and stop is None:
        raise SimulationError(
            "A forecast needs a manoeuvre, found none; add --zigzag 10/10, --turn 35, --spiral, --stop or --measured."
        )
    path = Path(args.posterior)
    out = writable_folder(args.out or (path.parent if path.suffix in FILES else path))
    trees, text = {}, []
    for label, manoeuvre in wanted.items():
        progress(f"forecasting the {label}")
        rng.bit_generator.state = state  # the same random numbers for every manoeuvre
        trees[label] = _forecast(args, ship, manoeuvre, measured.get(label), rng)
        reference = _reference(manoeuvre, simulated, trees[label], **_surroundings(args))
        text.append(_text(trees[label], label, measured, ship.vessel, reference))
    text += [spiral_sentence(turns)] if turns is not None else []
    text += [stopping_sentence(stop)] if stop is not None else []
    trials = {label: trial for label, (_, trial) in measured.items()}
    settings: dict[str, Any] = {"vessel": vessel, "measured": trials, "turns": turns, "stop": stop}
    page = write_forecast_page(ship, trees, out, **settings, command=made_by(args), progress=progress)
    text.append("\n".join(measured_doubts(trials, trees)))
    return "\n\n".join(filter(None, text)), page


def _surroundings(args: argparse.Namespace) -> dict[str, Any]:
    return {"n": args.n, "wind": args.wind, "current": args.current}


def _forecast(
    args: argparse.Namespace,
    ship: Ship,
    manoeuvre: Manoeuvre,
    recorded: tuple[Manoeuvre, xr.Dataset] | None,
    rng: np.random.Generator,
) -> xr.DataTree:
    """Forecast of a manoeuvre; that of a recorded one is at its facility, and in its wind if none is stated."""
    from pymc_ship.ships.forecasting.forecast import known_facility, recorded_forecast

    settings, around = {"duration": args.duration, "draws": args.draws, "rng": rng}, _surroundings(args)
    if recorded is not None and all(one is None for one in (args.facility, *around.values())):
        return recorded_forecast(ship, *recorded, **settings)
    at = None if recorded is None else known_facility(ship, recorded[1])
    return ps.forecast(ship, manoeuvre, facility=args.facility or at, **settings, **around)


def _reference(manoeuvre: Manoeuvre, vessel: Vessel | None, tree: xr.DataTree, **around: Any) -> xr.Dataset | None:
    """Indices of the reference vessel, in steps and surroundings of its forecast; None without a vessel or indices."""
    if vessel is None or not manoeuvre.traits.indices:
        return None
    forecast = tree["trajectories"].dataset
    time, settings = forecast["time"].values, {name: forecast.attrs[name] for name in ("step", "method")}
    settings |= {"duration": time[-1], "record_interval": time[1] - time[0]}
    return ps.indices(ps.simulate(vessel, manoeuvre, **settings, **around))


def design(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Choose the next runs; the text has interval widths and sea room of each candidate."""
    ship, _ = _ship_of(args, np.random.default_rng(args.seed), progress, draws=_DESIGN_DRAWS)
    out, room = writable_folder(args.out), np.inf if args.sea_room is None else args.sea_room
    result = ps.design(ship, n=args.n, sea_room=room, wind=args.wind, progress=progress)
    with staged_files(out) as folder:
        ratio = result["width_ratio"].transpose("candidate", "step")
        header = ("candidate", "sea_room", *(f"width_ratio_{k}" for k in ratio["step"].values))
        rows = zip(result["candidate"].values, result["sea_room"].values, *ratio.values.T, strict=True)
        write_csv(folder / "next_runs.csv", header, rows, args)
        width = result["half_width"].transpose("target", "stage")
        header = ("manoeuvre", "index", "units", "half_width", *(f"after_{k}" for k in width["stage"].values[1:]))
        targets = [str(target).split(", ") for target in result["target"].values]
        rows = zip(*zip(*targets, strict=True), result["units"].values, *width.values.T, strict=True)
        write_csv(folder / "half_widths.csv", header, rows, args)
    return texts.design_text(result), out


def score(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Score open-loop simulations of windows of records; the text has the errors of every channel and run."""
    ship = load_ship(args.ship) if is_ship_folder(args.ship) else Ship.from_vessel(vessel_argument(args.ship, progress))
    any_speed = any(valid_at_any_speed(vessel) for vessel, _ in ship.models)
    files = [(path, args.format) for path in args.trials]
    trials, _ = checked_trials(files, ship.vessel, args, progress, any_speed=any_speed)
    out = writable_folder(args.out) if args.out else None
    progress("simulating windows along the measured inputs")
    settings = {"length": args.length, "every": args.every, "draws": args.draws}
    scores = ps.score(ship, list(trials.values()), names=list(trials), **settings)
    rows = ps.score_indices(ship, list(trials.values()), names=list(trials), rng=args.seed)
    tables = [texts.score_text(scores), texts.compared_index_text(rows, "Indices of recorded manoeuvres", scored=True)]
    text = "\n\n".join(filter(None, [*tables, "\n".join(quality_remarks(trials) + ground_remarks(trials))]))
    if out is None:
        return text, None
    from pymc_ship.ships.identification.score_page import write_score_page

    return text, write_score_page(ship, trials, scores, rows, out, draws=args.draws, command=made_by(args))


def trial_report(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Report on a sea trial; the text has manoeuvring data and missing corrections."""
    vessel = vessel_argument(args.vessel, progress)
    ship = load_ship(args.ship) if args.ship else None
    full_load = vessel_argument(args.full_load, progress) if args.full_load else None
    files = [(path, args.format) for path in args.trials]
    trials, _ = checked_trials(files, vessel, args, progress, any_speed=True)
    out = writable_folder(args.out)
    settings = {"conditions": args.conditions, "ship": ship, "full_load": full_load, "rng": args.seed}
    report = ps.sea_trial(trials, vessel, progress=progress, **settings)
    progress("writing the page")
    unmet = [row for row in report.conditions if row["conformity"] == "not met"]
    parts = [texts.form_text(report.form), texts.conditions_text(unmet), "\n".join(report.remarks)]
    return "\n\n".join(filter(None, parts)), ps.trial_report(report, out, command=made_by(args))


def _measured(args: argparse.Namespace, ship: Ship, progress: Progress) -> dict[str, tuple[Manoeuvre, xr.Dataset]]:
    """Measured trials by the label of their recognised manoeuvre; a repeated label gets the name of the file."""
    recognised: dict[str, tuple[Manoeuvre, xr.Dataset]] = {}
    if not args.measured:
        return recognised
    files = [(path, args.format) for path in args.measured]
    trials, _ = checked_trials(files, ship.vessel, args, progress)
    manoeuvres, _ = recognise_by_facility(list(trials.values()), ship.vessel)
    for (name, trial), manoeuvre in zip(trials.items(), manoeuvres, strict=True):
        if manoeuvre is None:
            raise SimulationError(
                f"--measured needs a recognised manoeuvre, found none in {name}. "
                f"{unrecognised_text(trial, ship.vessel.particulars.ship_time)} Leave it out."
            )
        label = manoeuvre.label if manoeuvre.label not in recognised else f"{manoeuvre.label} {name}"
        recognised[label] = manoeuvre, trial
    return recognised


def _text(
    tree: xr.DataTree,
    label: str,
    measured: Mapping[str, tuple[Manoeuvre, xr.Dataset]],
    vessel: Vessel,
    reference: xr.Dataset | None,
) -> str:
    """Bands of the indices, measured and reference values, and the probability of each IMO criterion."""
    from pymc_ship.records.steering.measured import measured_indices
    from pymc_ship.ships.forecasting.page import refused_sentence, unreached_sentence, verdict_rows

    columns: dict[str, Mapping[Any, Any]] = (
        {"measured": measured_indices(measured[label][1], tree.attrs)} if label in measured else {}
    )
    columns |= {} if reference is None else {"reference": reference}
    verdicts = verdict_rows(label, tree, vessel, measured[label][1] if label in measured else None)
    parts = [
        texts.forecast_text(tree, columns),
        tree.attrs["steering"],
        refused_sentence(tree),
        unreached_sentence(tree),
        *(f"IMO MSC.137(76): {row['verdict']}" for row in verdicts),
        tree.attrs.get("reliability", "") if verdicts else "",
    ]
    return "\n".join(filter(None, parts))
