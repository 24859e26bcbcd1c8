"""What each command of the command line does: reads, calls the API, writes, returns the text to print.

Every command takes the parsed words and a function that shows progress, and returns its text, the path it wrote and,
where a check of the results can fail, the sentence that says so.
Inputs are read first, then the output is tried, then the long work begins.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.command_texts import (
    check_text,
    coefficient_rows,
    coefficient_table,
    criteria_table,
    design_text,
    divergence,
    forecast_text,
    index_table,
    table,
    trajectory_rows,
    trajectory_text,
    tuning_text,
)
from pymc_ship.forecast import BANDS, stated_shares
from pymc_ship.manoeuvres import Manoeuvre, ManoeuvreError
from pymc_ship.output import OutputError, staged, writable_folder
from pymc_ship.posterior import read_posterior, write_posterior
from pymc_ship.trial import CHANNELS, UNITS, TrialError
from pymc_ship.vessel import Vessel

Progress = Callable[..., None]
Outcome = tuple[str, Path | None] | tuple[str, Path | None, str]

_PROGRAMME_HEADER = ["time", "delta_deg"]
_COEFFICIENT_HEADER = ("dof", "family", "coefficient", "reference", "mean", "sd", "quantile_5", "quantile_95")
OFFSETS = {"auto": None, "yes": True, "no": False}
"""Whether sensors may have constant offsets, by the words of the command line."""

_NOT_RECORDED = ("command", "out", "quiet")


def study(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Run the paper's study; the text is empty, the page says it all."""
    from pymc_ship.agreement import failure
    from pymc_ship.report import reported_study

    out = args.out or Path("reports", Path(args.vessel).stem)
    result, page = reported_study(out, vessel=args.vessel, level=args.level, seed=args.seed, progress=progress)
    return "", page, failure(result.comparisons)


def simulate(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Simulate a trial; the text has the indices and IMO criteria of the clean run."""
    vessel, manoeuvre = ps.load_vessel(args.vessel), _manoeuvre(args)
    out = _output_file(args.out)
    progress(f"simulating the {manoeuvre.label}")
    run = ps.simulate(vessel, manoeuvre, duration=args.duration, step=args.step, method=args.method)
    text = [divergence(run)] if run["diverged"] else []
    if manoeuvre.kind != "rudder_programme":
        found = ps.indices(run)
        text += [index_table(found, {"value": found}), criteria_table(ps.imo_criteria(found, vessel))]
    trial = run.isel(time=np.isfinite(run["psi"].values))
    if trial.sizes["time"] < 2:
        raise TrialError(f"A trial has at least two samples, found {trial.sizes['time']}; change duration or step.")
    if args.noise is not None:
        trial = ps.pollute(trial, level=args.noise, rng=np.random.default_rng(args.seed))
    _write_trial(trial, out, args)
    return "\n\n".join(filter(None, text)), out


def check(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Check a trial; the text has the verdict of each check and what was corrected."""
    from pymc_ship.trial_checks import failed_checks

    vessel = ps.load_vessel(args.vessel) if args.vessel else None
    trial = _trial(args.trial, args, progress)
    out = _output_file(args.out) if args.out else None
    progress("checking")
    checks = ps.trial_checks(trial, vessel)
    failure = failed_checks(checks)
    if failure or not out:
        return check_text(checks), None, failure
    corrected = ps.corrected_trial(trial, checks)
    _write_trial(corrected, out, args)
    return "\n".join([check_text(checks), "", *(corrected.attrs["corrections"] or ["Nothing to correct."])]), out


def denoise(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Denoise a trial; the text has the noise found on each channel."""
    trial = _trial(args.trial, args, progress)
    out = _output_file(args.out)
    progress("denoising")
    smooth = ps.denoise(trial, args.wavelet, args.prior, not args.decimated)
    names = smooth.attrs["denoised"].split()
    _write_trial(smooth, out, args)
    return table(("channel", "noise sd", ""), [(n, smooth[n].attrs["noise_sdev"], UNITS[n]) for n in names]), out


def identify(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Identify a vessel; the text has mean, sd and 5 to 95 % of each coefficient beside the vessel file's value."""
    from pymc_ship.identification import EXACT
    from pymc_ship.identification import identify as identified

    vessel, trial = ps.load_vessel(args.vessel), _trial(args.trial, args, progress)
    out = writable_folder(args.out)
    rng = np.random.default_rng(args.seed)
    families = tuple(EXACT) if args.family == "both" else (args.family,)
    settings = {"interval": args.interval, "derivative": args.derivative, "selection": args.select}
    trial = _smooth(trial, args, progress)
    found = identified(trial, vessel, families=families, rng=rng, progress=progress, **settings)
    rows = []
    with _staged_files(out) as folder:
        for family in families:
            progress(f"posterior draws, {family}")
            for dof, tree in found.posteriors(family, draws=args.draws, rng=rng).items():
                tree.attrs |= {"seed": args.seed, "made_by": _provenance(args)}
                write_posterior(tree, folder / f"{dof}-{family}.nc")
            rows += coefficient_rows(vessel, family, found.exact[family])
        _write_csv(folder / "coefficients.csv", _COEFFICIENT_HEADER, rows, args)
    return coefficient_table(rows, families), out


def fit(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Fit trajectories; the text has what the noise is, how far to trust the fit, and each coefficient."""
    vessel, trials = ps.load_vessel(args.vessel), [_trial(path, args, progress) for path in args.trials]
    out = writable_folder(args.out)
    settings = {"channels": args.channels, "noise": args.noise_model, "offsets": OFFSETS[args.offsets]}
    progress(f"fitting the trajectories of {len(trials)} trial{'s' if len(trials) > 1 else ''}")
    rng = np.random.default_rng(args.seed)
    tree = ps.trajectory_posterior(
        trials, vessel, args.prior, draws=args.draws, rng=rng, method=args.method, **settings
    )
    tree.attrs |= {"seed": args.seed, "made_by": _provenance(args)}
    rows = trajectory_rows(vessel, tree)
    with _staged_files(out) as folder:
        write_posterior(tree, folder / "trajectory.nc")
        _write_csv(folder / "coefficients.csv", _COEFFICIENT_HEADER, rows, args)
    return "\n\n".join([trajectory_text(tree), coefficient_table(rows, ("trajectory",))]), out


def tune(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Tune a prior; the text has the hyperparameters, their score and what the optimisation gained."""
    vessel, trial = ps.load_vessel(args.vessel), _trial(args.trial, args, progress)
    out = _output_file(args.out) if args.out else None
    trial = _smooth(trial, args, progress)
    data = ps.regression_data(trial, vessel, args.dof, interval=args.interval, derivative=args.derivative)
    progress(f"tuning the {args.family} prior of the {args.dof}: {args.evaluations} evaluations")
    settings = {"evaluations": args.evaluations, "folds": args.folds, "split": args.split}
    tuned = ps.tune_prior(data, args.family, rng=np.random.default_rng(args.seed), **settings)
    if out:
        scores = {name: getattr(tuned, name) for name in ("score", "score_se", "evidence_score", "log_evidence")}
        table = {**tuned.prior.hyperparameters(), **scores, "dof": args.dof, "made_by": _provenance(args)}
        with staged(out) as partial:
            partial.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")
    return tuning_text(tuned), out


def forecast(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Forecast manoeuvres; the text has the indices of each beside those of the vessel file's ship."""
    vessel = ps.load_vessel(args.vessel)
    manoeuvres = [ps.zigzag(*angles, side=args.side) for angles in args.zigzag]
    manoeuvres += [ps.turning_circle(rudder, side=args.side) for rudder in args.turn]
    if not manoeuvres:
        raise ManoeuvreError("A forecast needs a manoeuvre, found none; add --zigzag 10/10 or --turn 35.")
    posteriors, ending = _posteriors(Path(args.posterior), args.family, vessel)
    out, text = writable_folder(args.out), []
    with _staged_files(out) as folder:
        for manoeuvre in manoeuvres:
            progress(f"forecasting the {manoeuvre.label}")
            rng = np.random.default_rng(args.seed)
            tree = ps.forecast(vessel, posteriors, manoeuvre, draws=args.draws, rng=rng, duration=args.duration)
            name = manoeuvre.label.replace(" ", "-").replace("/", "-")
            _write_bands(folder / f"{name}-{ending}.csv", tree, args)
            reference = ps.simulate(vessel, manoeuvre, duration=args.duration, record_interval=0.5)
            text.append(forecast_text(tree, ps.indices(reference)))
    return "\n\n".join(text), out


def design(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Design the next runs; the text has the gain of each candidate and the accuracy that the chosen ones promise."""
    vessel, rng = ps.load_vessel(args.vessel), np.random.default_rng(args.seed)
    posterior = _of_vessel(read_posterior(args.posterior), Path(args.posterior), vessel)
    candidates = ps.candidate_trials(vessel, duration=args.duration, rng=rng)
    out, settings = writable_folder(args.out), {"criterion": args.criterion, "duration": args.duration}
    progress(f"simulating {len(candidates)} candidates")
    found = ps.design_trials(vessel, posterior, candidates, args.n, rng=rng, **settings)
    with _staged_files(out) as folder:
        for label in np.unique(found["chosen"].values):
            if (manoeuvre := candidates[label]).kind == "rudder_programme":
                rows = zip(manoeuvre.time, np.rad2deg(manoeuvre.delta).round(6).tolist(), strict=True)
                path = folder / f"{label.replace('m/s', 'mps').replace(' ', '-')}.csv"
                _write_csv(path, _PROGRAMME_HEADER, rows, args, remark=label)
        table = found.drop_dims(("stage", "coefficient")).to_dataframe().reset_index()
        _write_csv(folder / "design.csv", tuple(table), table.itertuples(index=False), args)
        sd = found["sd"].transpose("coefficient", "stage")
        header = ("coefficient", "sd", *(f"sd_after_{k}" for k in sd["stage"].values[1:]))
        rows = zip(sd["coefficient"].values, *sd.values.T.tolist(), strict=True)
        _write_csv(folder / "predicted_sd.csv", header, rows, args)
    return design_text(found), out


def frontier(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Measure every method against the Cramer-Rao bound; the text has each number beside its aim."""
    from pymc_ship.frontier_report import reported_frontier

    return reported_frontier(args.out, seeds=args.seeds, seed=args.seed, progress=progress)


def report(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Report on saved posteriors; the text has the verdict on each."""
    from pymc_ship.agreement import comparisons, failure
    from pymc_ship.diagnostic_report import check_trees, verdict, write_diagnostics

    vessel = ps.load_vessel(args.vessel) if args.vessel else None
    paths = {Path(path).stem: path for path in args.posteriors}
    if len(paths) < len(args.posteriors):
        paths = {path: path for path in args.posteriors}
    trees = {name: read_posterior(path) for name, path in paths.items()}
    check_trees(trees, vessel)
    out, compared = writable_folder(args.out), comparisons(trees)
    page = write_diagnostics(compared, out, vessel, seed=args.seed, progress=progress)
    return "\n\n".join("\n".join([one.name, *verdict(one)]) for one in compared), page, failure(compared)


def _manoeuvre(args: argparse.Namespace) -> Manoeuvre:
    if args.programme is not None:
        if args.side:
            raise ManoeuvreError("A rudder programme has its own sides, found --side; leave it out.")
        return ps.rudder_programme(*_read_programme(args.programme), approach_speed=args.speed)
    settings = {"side": args.side or "port", "approach_speed": args.speed}
    return ps.zigzag(*args.zigzag, **settings) if args.zigzag else ps.turning_circle(args.turn, **settings)


def _read_programme(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and rudder angles [rad] of a CSV with the header ``time,delta_deg``."""
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
        header, *rows = [line.split(",") for line in lines if line.strip() and line[0] != "#"] or [[]]
        if [name.strip() for name in header] != _PROGRAMME_HEADER:
            raise ValueError(f"the header is not time,delta_deg but {','.join(header)!r}")
        time, delta_deg = np.array(rows, dtype=float).reshape(len(rows), len(_PROGRAMME_HEADER)).T
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ManoeuvreError(f"The rudder programme {path} cannot be read: {reason}; mend it.") from None
    return time, np.deg2rad(delta_deg)


def _trial(path: str, args: argparse.Namespace, progress: Progress) -> xr.Dataset:
    """Trial of a file; what was interpreted or changed in it is shown."""
    trial = ps.read_trial(path, format=args.format)
    for sentence in trial.attrs["reading"].splitlines():
        progress(f"{path}: {sentence}", remark=True)
    return trial


def _smooth(trial: xr.Dataset, args: argparse.Namespace, progress: Progress) -> xr.Dataset:
    """Denoised trial; as it is where it was smooth before or the weak form smooths for itself."""
    from pymc_ship.regression_data import WEAK

    if args.raw or args.derivative in WEAK:
        return trial
    progress("denoising")
    return ps.denoise(trial)


def _posteriors(path: Path, family: str, vessel: Vessel) -> tuple[xr.DataTree | dict[str, xr.DataTree], str]:
    """Joint posterior of a file or those of each DOF that `identify` wrote, and how a result of them is called."""
    if path.suffix in (".nc", ".zarr"):
        return _of_vessel(read_posterior(path), path, vessel), path.stem
    return {dof: _posterior(path, dof, family, vessel) for dof in vessel.dofs}, family


def _posterior(folder: Path, dof: str, family: str, vessel: Vessel) -> xr.DataTree:
    """Posterior that `identify` wrote, of the vessel asked for."""
    path = folder / f"{dof}-{family}.nc"
    tree = read_posterior(path)
    if tree.attrs.get("dof") != dof:
        raise ValueError(f"{path} is no posterior of the {dof}; run `pymc-ship identify` first.")
    return _of_vessel(tree, path, vessel)


def _of_vessel(tree: xr.DataTree, path: Path, vessel: Vessel) -> xr.DataTree:
    """The posterior itself, where it is of the vessel."""
    found = tree.attrs.get("vessel")
    if found != vessel.name:
        raise ValueError(f"The posterior is to be of {vessel.name!r}, found {found!r} in {path}; use its own vessel.")
    return tree


def _output_file(path: str) -> Path:
    """Path of a file that can be written; its folder is created where it is missing."""
    if Path(path).is_dir():
        raise OutputError(f"{path} is a folder; give the name of a file in it.")
    writable_folder(Path(path).parent)
    return Path(path)


@contextmanager
def _staged_files(folder: Path) -> Iterator[Path]:
    """Temporary folder whose files move to ``folder`` together when the block ends without an exception."""
    with tempfile.TemporaryDirectory(prefix=".partial-", dir=folder) as partial:
        yield Path(partial)
        for path in sorted(Path(partial).iterdir()):
            os.replace(path, folder / path.name)


def _provenance(args: argparse.Namespace) -> str:
    """What made a file: version, command and options, but not where it was written."""
    options = {key: value for key, value in sorted(vars(args).items()) if key not in _NOT_RECORDED}
    for key in ("trial", "format", "posterior", "programme", "vessel"):
        if options.get(key):
            options[key] = Path(options[key]).name
    return f"pymc-ship {ps.__version__} {args.command} {json.dumps(options)}"


def _write_trial(trial: xr.Dataset, path: Path, args: argparse.Namespace) -> None:
    with staged(path) as partial:
        text = ps.write_trial(trial, partial).read_text(encoding="utf-8")
        remarks = [f"# {remark}\n" for remark in (_provenance(args), *trial.attrs.get("corrections", ()))]
        partial.write_text("".join(remarks) + text, encoding="utf-8")


def _write_csv(
    path: Path, header: Sequence[str], rows: Iterable[Sequence], args: argparse.Namespace, remark: str = ""
) -> None:
    remarks = [f"# {text}" for text in (_provenance(args), remark) if text]
    lines = [*remarks, ",".join(header), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_bands(path: Path, forecast: xr.DataTree, args: argparse.Namespace) -> None:
    bands = forecast["bands"].to_dataset()
    names = [f"{channel}_{band}" for channel in CHANNELS for band in BANDS]
    columns = [bands[channel].sel(band=band).values for channel in CHANNELS for band in BANDS]
    rows = np.column_stack([bands["time"].values, *columns]).tolist()
    _write_csv(path, ("time", *names), rows, args, remark=stated_shares(forecast))
