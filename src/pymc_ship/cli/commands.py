"""Commands on one trial or one posterior: read, call the API, write, return the text to print.

A command ``f(args, progress)`` returns its text, the path of its output and, if a check of the results failed, a
sentence. It reads its inputs, checks that the output can be written, and then computes.
"""

import argparse
import json
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli import texts
from pymc_ship.cli.files import (
    Outcome,
    Progress,
    made_by,
    model_argument,
    output_file,
    requested_manoeuvres,
    trial_argument,
    validated_trials,
    vessel_argument,
    write_csv,
    write_trial_file,
)
from pymc_ship.cli.parser import FAMILIES
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from pymc_ship.inference.regression.tune import BoundWarning, bound_text, tune_prior
from pymc_ship.machine.errors import SimulationError, TrialError
from pymc_ship.machine.files import staged_files, staged_path, writable_folder
from pymc_ship.machine.text import TextError, file_text
from pymc_ship.physics.manoeuvre.criteria import imo_criteria
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.physics.motion.inputs import speed_remarks
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.trial.channels import CHANNELS, unmodelled_roll_text
from pymc_ship.trial.record import nonzero_channels, sampling_interval

_PROGRAMME_HEADER = ["time", "delta_deg"]
_ROW_INTERVAL = 1.0  # s, of Xue et al. (2020)
_STEP_ERROR = 0.02  # of the range of heading, that half the step of a simulation may change
OFFSETS = {"auto": None, "yes": True, "no": False}  # argument ``offsets`` by the choices of ``--offsets``


def study(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Run the study of the paper; no text."""
    from pymc_ship.diagnostics.agreement import failure_sentence
    from pymc_ship.replication.page import reported_study

    model_argument(args.vessel, progress)
    out = args.out or Path("reports", Path(args.vessel).stem)
    result, page = reported_study(out, vessel=args.vessel, level=args.level, seed=args.seed, progress=progress)
    return "", page, failure_sentence(result.comparisons)


def simulate(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Simulate a trial; the text has the indices and IMO criteria of the run without noise."""
    vessel, manoeuvre = model_argument(args.vessel, progress), _manoeuvre(args)
    out = output_file(args.out)
    progress(f"simulating the {manoeuvre.label}")
    run = ps.simulate(vessel, manoeuvre, duration=args.duration, step=args.step, method=args.method)
    trial = run.isel(time=np.isfinite(run["psi"].values))
    if run["diverged"] and trial.sizes["time"] < 2:
        speed, nominal = run.attrs["approach_speed"], vessel.particulars.nominal_speed
        raise SimulationError(
            f"A ship must sail for two steps, found a divergence at once, at {speed:g} m/s with a step of "
            f"{args.step:g} s; give a --speed nearer to the nominal {nominal:g} m/s, or a smaller --step."
        )
    if trial.sizes["time"] < 2:
        raise TrialError("A trial must have two samples or more, found 1; give a longer --duration or smaller --step.")
    diverged = f"The run diverged at t = {float(run['diverged_at']):g} s; the trial ends there."
    text = [diverged] if run["diverged"] else []
    text += _step_remark(run, vessel, manoeuvre, args) + speed_remarks([vessel], run.attrs["approach_speed"])
    if manoeuvre.traits.indices:
        indices = ps.indices(run)
        text += [texts.index_text(indices, {"value": indices}), texts.criteria_text(imo_criteria(indices, vessel))]
    if args.noise is not None:
        kind = {"noise" if isinstance(args.noise, tuple) else "level": args.noise}
        trial = ps.pollute(trial, **kind, rng=np.random.default_rng(args.seed))
    write_trial_file(trial, out, args)
    return "\n\n".join(filter(None, text)), out


def _step_remark(run: xr.Dataset, vessel: Vessel, manoeuvre: Manoeuvre, args: argparse.Namespace) -> list[str]:
    """Remark on a run whose heading half the step changes by more than 2 % of its range."""
    if args.method == "dop853":
        return []
    half = {"step": 0.5 * args.step, "record_interval": args.step}
    finer = ps.simulate(vessel, manoeuvre, duration=args.duration, method=args.method, **half)["psi"].values
    psi, finer = run["psi"].values, finer[: run.sizes["time"]]
    both = np.isfinite(psi) & np.isfinite(finer)
    if np.abs(psi - finer)[both].max() <= _STEP_ERROR * max(np.ptp(finer[both]), np.deg2rad(1.0)):
        return []
    return [
        f"The step of {args.step:g} s is too long: with half of it the heading differs by more than {_STEP_ERROR:.0%} "
        "of its range; give a smaller --step or --method dop853."
    ]


def _fit_arguments(
    paths: Sequence[str], args: argparse.Namespace, progress: Progress
) -> tuple[list[xr.Dataset], Vessel]:
    """Corrected trials and the vessel to fit to them; roll that the vessel does not model is printed."""
    vessel = model_argument(args.vessel, progress)
    trials, _ = validated_trials(paths, args.format, vessel, args, progress)
    for path, trial in zip(paths, trials, strict=True):
        if sentence := unmodelled_roll_text(nonzero_channels(trial), vessel.dofs):
            progress(f"{path}: {sentence}", remark=True)
    return trials, vessel


def denoise(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Denoise a trial; the text has the noise sd of each channel."""
    trial = trial_argument(args.trial, args.format, progress)
    out = output_file(args.out)
    progress("denoising")
    smooth = ps.denoise(trial, args.wavelet, args.prior, not args.decimated, method=args.method)
    names = smooth.attrs["denoised"].split()
    write_trial_file(smooth, out, args)
    chosen = [key for key in smooth[names[0]].attrs if key.startswith("denoise_")]
    rows = [
        (name, smooth[name].attrs["noise_sdev"], CHANNELS[name].unit.name, *(smooth[name].attrs[key] for key in chosen))
        for name in names
    ]
    header = ("channel", "noise sd", "unit", *(key.removeprefix("denoise_") for key in chosen))
    return texts.table_text(header, rows, "Noise of each channel"), out


def regress(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Regress a trial; the text has mean, sd and 5 to 95 % of each coefficient, and the value of the vessel file."""
    from pymc_ship.inference.regression.identify import identify as identified

    (trial,), vessel = _fit_arguments([args.trial], args, progress)
    out = writable_folder(args.out)
    rng = np.random.default_rng(args.seed)
    families = FAMILIES if args.family == "both" else (args.family,)
    settings = {"interval": _row_interval(trial, args), "derivative": args.derivative, "selection": args.select}
    trial = _smooth(trial, args, progress)
    with warnings.catch_warnings(action="ignore", category=BoundWarning):  # the text has them
        result = identified(trial, vessel, families=families, rng=rng, progress=progress, **settings)
    rows, bounds = [], []
    with staged_files(out) as folder:
        for family in families:
            edges = result.edges(family)
            bounds += [f"{bound_text(f'The {family} prior of the {dof}', at)}." for dof, at in edges.items()]
            progress(f"posterior draws, {family}")
            for dof, tree in result.posteriors(family, draws=args.draws, rng=rng).items():
                tree.attrs |= {"seed": args.seed, "made_by": made_by(args)}
                write_posterior(tree, folder / f"{dof}-{family}.nc")
            rows += texts.coefficient_rows(vessel, family, result.exact[family])
        write_csv(folder / "coefficients.csv", texts.CoefficientRow._fields, rows, args)
    text = [trial.attrs["record_remarks"], "\n".join(bounds), texts.coefficient_text(rows, families)]
    return "\n\n".join(filter(None, text)), out


def fit(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Fit trajectories; the text has noise model, diagnostics of the fit and coefficients."""
    trials, vessel = _fit_arguments(args.trials, args, progress)
    out = writable_folder(args.out)
    settings = {"channels": args.channels, "noise": args.noise_model, "offsets": OFFSETS[args.offsets]}
    progress(f"fitting the trajectories of {len(trials)} trial{'s' if len(trials) > 1 else ''}")
    rng = np.random.default_rng(args.seed)
    tree = ps.trajectory_posterior(
        trials, vessel, args.prior, draws=args.draws, rng=rng, method=args.method, **settings
    )
    tree.attrs |= {"seed": args.seed, "made_by": made_by(args)}
    rows = texts.trajectory_rows(vessel, tree)
    with staged_files(out) as folder:
        write_posterior(tree, folder / "trajectory.nc")
        write_csv(folder / "coefficients.csv", texts.CoefficientRow._fields, rows, args)
    text = [tree.attrs["record_remarks"], texts.trajectory_text(tree), texts.coefficient_text(rows, ("trajectory",))]
    return "\n\n".join(filter(None, text)), out


def tune(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Tune a prior; the text has the hyperparameters and their scores."""
    (trial,), vessel = _fit_arguments([args.trial], args, progress)
    out = output_file(args.out) if args.out else None
    trial = _smooth(trial, args, progress)
    data = ps.regression_data(trial, vessel, args.dof, interval=_row_interval(trial, args), derivative=args.derivative)
    progress(f"tuning the {args.family} prior of the {args.dof}: {args.evaluations} evaluations")
    settings = {"evaluations": args.evaluations, "folds": args.folds, "split": args.split}
    with warnings.catch_warnings(action="ignore", category=BoundWarning):  # the text has them
        tuned = tune_prior(data, args.family, rng=np.random.default_rng(args.seed), **settings)
    if out:
        scores = {name: getattr(tuned, name) for name in ("score", "score_se", "evidence_score", "log_evidence")}
        table = {**tuned.prior.hyperparameters(), **scores, "dof": args.dof, "made_by": made_by(args)}
        with staged_path(out) as partial:
            partial.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")
    return texts.tuning_text(tuned), out


def montecarlo(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Run a Monte-Carlo study; the text has its main table."""
    from pymc_ship.experiments.run import read_study, reported_montecarlo

    study = read_study(args.study)
    for sentence in study.remarks():
        progress(sentence, remark=True)
    settings = {"workers": args.workers, "scheduler": args.scheduler, "progress": progress}
    rows, page = reported_montecarlo(args.study, args.out, **settings)
    return texts.montecarlo_text(rows, study.columns(rows)), page


def report(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Report on saved posteriors; the text has the verdict of each."""
    from pymc_ship.diagnostics.agreement import comparisons, failure_sentence
    from pymc_ship.diagnostics.page import PAGE, check_posteriors, diagnostic_content, posterior_kind
    from pymc_ship.pages.page import write_page

    vessel = vessel_argument(args.vessel, progress) if args.vessel else None
    paths = {Path(path).stem: path for path in args.posteriors}
    if len(paths) < len(args.posteriors):
        paths = {path: path for path in args.posteriors}
    trees = {name: read_posterior(path) for name, path in paths.items()}
    check_posteriors(trees, vessel)
    out, compared = writable_folder(args.out), comparisons(trees)
    page = write_page(PAGE, out, diagnostic_content(compared, vessel, seed=args.seed, progress=progress))
    verdicts = ["\n".join([one.name, *posterior_kind(one.posterior).verdict(one)]) for one in compared]
    return "\n\n".join(verdicts), page, failure_sentence(compared)


def _manoeuvre(args: argparse.Namespace) -> Manoeuvre:
    if args.programme is not None:
        if args.side:
            raise SimulationError("--programme has its own rudder angles, found --side; leave out --side.")
        return ps.rudder_programme(*_read_programme(args.programme), approach_speed=args.speed)
    (manoeuvre,) = requested_manoeuvres(args, (args.side or "port",), approach_speed=args.speed)
    return manoeuvre


def _read_programme(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and rudder angles [rad] of a CSV with the header ``time,delta_deg``."""
    try:
        lines = file_text(path).splitlines()
        header, *rows = [line.split(",") for line in lines if line.strip() and line[0] != "#"] or [[]]
        if [name.strip() for name in header] != _PROGRAMME_HEADER:
            raise ValueError(f"the header is not time,delta_deg but {','.join(header)!r}")
        time, delta_deg = np.array(rows, dtype=float).reshape(len(rows), len(_PROGRAMME_HEADER)).T
    except TextError as error:
        raise SimulationError(f"The rudder programme {path} cannot be read: {error}.") from None
    except ValueError as error:
        raise SimulationError(f"The rudder programme {path} cannot be read: {error}; correct the file.") from None
    return time, np.deg2rad(delta_deg)


def _row_interval(trial: xr.Dataset, args: argparse.Namespace) -> float | None:
    """Interval of the rows [s] that a command asks for; None for the default of the library."""
    from pymc_ship.inference.rows.from_trials import WEAK

    if args.interval == "all" or (args.interval == "auto" and args.derivative in WEAK):
        return None
    step = sampling_interval(trial)
    return step * max(round(_ROW_INTERVAL / step), 1) if args.interval == "auto" else args.interval


def _smooth(trial: xr.Dataset, args: argparse.Namespace, progress: Progress) -> xr.Dataset:
    """Denoised trial; unchanged with ``--raw`` or the weak form, which smooths by itself."""
    from pymc_ship.inference.rows.from_trials import WEAK

    if args.raw or args.derivative in WEAK:
        return trial
    progress("denoising")
    return ps.denoise(trial)
