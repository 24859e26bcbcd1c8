"""What each command of the command line does: reads, calls the API, writes, returns the text to print.

Every command takes the parsed words and a function that shows progress, and returns its text, the path it wrote and,
where it is not 0, the exit status.
Inputs are read first, then the output is tried, then the long work begins.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.forecast import BANDS
from pymc_ship.manoeuvres import Manoeuvre, ManoeuvreError
from pymc_ship.output import OutputError, staged, writable_folder
from pymc_ship.posterior import read_posterior, write_posterior
from pymc_ship.trial import CHANNELS, UNITS, TrialError
from pymc_ship.vessel import Vessel

if TYPE_CHECKING:
    from pymc_ship.tune import TunedPrior

Progress = Callable[[str], None]
Outcome = tuple[str, Path | None] | tuple[str, Path | None, int]

_PROGRAMME_HEADER = ["time", "delta_deg"]
_COEFFICIENT_HEADER = ("dof", "family", "coefficient", "reference", "mean", "sd", "quantile_5", "quantile_95")
_NOT_RECORDED = ("command", "out", "quiet")
_GATE_FAILS = 3


def study(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Run the paper's study; the text is empty, the page says it all."""
    out = args.out or Path("reports", Path(args.vessel).stem)
    return "", ps.study(out, vessel=args.vessel, level=args.level, seed=args.seed, progress=progress)


def simulate(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Simulate a trial; the text has the indices and IMO criteria of the clean run."""
    vessel, manoeuvre = ps.load_vessel(args.vessel), _manoeuvre(args)
    out = _output_file(args.out)
    progress(f"simulating the {manoeuvre.label}")
    run = ps.simulate(vessel, manoeuvre, duration=args.duration, step=args.step, method=args.method)
    text = [_divergence(run)] if run["diverged"] else []
    if manoeuvre.kind != "rudder_programme":
        found = ps.indices(run)
        text += [_index_table(found, {"value": found}), _criteria_table(ps.imo_criteria(found, vessel))]
    trial = run.isel(time=np.isfinite(run["psi"].values))
    if trial.sizes["time"] < 2:
        raise TrialError(f"A trial has at least two samples, found {trial.sizes['time']}; change duration or step.")
    if args.noise is not None:
        trial = ps.pollute(trial, level=args.noise, rng=np.random.default_rng(args.seed))
    _write_trial(trial, out, args)
    return "\n\n".join(filter(None, text)), out


def denoise(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Denoise a trial; the text has the noise found on each channel."""
    trial = ps.read_trial(args.trial)
    out = _output_file(args.out)
    progress("denoising")
    smooth = ps.denoise(trial, args.wavelet, args.prior, not args.decimated)
    names = smooth.attrs["denoised"].split()
    _write_trial(smooth, out, args)
    return _table(("channel", "noise sd", ""), [(n, smooth[n].attrs["noise_sdev"], UNITS[n]) for n in names]), out


def identify(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Identify a vessel; the text has mean, sd and 5 to 95 % of each coefficient beside the vessel file's value."""
    from pymc_ship.identification import EXACT
    from pymc_ship.identification import identify as identified

    vessel, trial = ps.load_vessel(args.vessel), ps.read_trial(args.trial)
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
            rows += _coefficient_rows(vessel, family, found.exact[family])
        _write_csv(folder / "coefficients.csv", _COEFFICIENT_HEADER, rows, args)
    return _coefficient_table(rows, families), out


def tune(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Tune a prior; the text has the hyperparameters, their score and what the optimisation gained."""
    vessel, trial = ps.load_vessel(args.vessel), ps.read_trial(args.trial)
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
    return _tuning_text(tuned), out


def forecast(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Forecast manoeuvres; the text has the indices of each beside those of the vessel file's ship."""
    vessel = ps.load_vessel(args.vessel)
    manoeuvres = [ps.zigzag(*angles, side=args.side) for angles in args.zigzag]
    manoeuvres += [ps.turning_circle(rudder, side=args.side) for rudder in args.turn]
    if not manoeuvres:
        raise ManoeuvreError("A forecast needs a manoeuvre, found none; add --zigzag 10/10 or --turn 35.")
    posteriors = {dof: _posterior(Path(args.folder), dof, args.family, vessel) for dof in vessel.dofs}
    out, text = writable_folder(args.out), []
    with _staged_files(out) as folder:
        for manoeuvre in manoeuvres:
            progress(f"forecasting the {manoeuvre.label}")
            rng = np.random.default_rng(args.seed)
            tree = ps.forecast(vessel, posteriors, manoeuvre, draws=args.draws, rng=rng, duration=args.duration)
            name = manoeuvre.label.replace(" ", "-").replace("/", "-")
            _write_bands(folder / f"{name}-{args.family}.csv", tree["bands"].to_dataset(), args)
            reference = ps.simulate(vessel, manoeuvre, duration=args.duration, record_interval=0.5)
            text.append(_forecast_text(tree, ps.indices(reference)))
    return "\n\n".join(text), out


def report(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Report on saved posteriors; the text has the verdict on each, the status is 3 when a gate fails."""
    from pymc_ship.diagnostic_parts import verdict
    from pymc_ship.diagnostic_report import check_trees
    from pymc_ship.diagnostics import gates

    vessel = ps.load_vessel(args.vessel) if args.vessel else None
    paths = {Path(path).stem: path for path in args.posteriors}
    if len(paths) < len(args.posteriors):
        paths = {path: path for path in args.posteriors}
    trees = {name: read_posterior(path) for name, path in paths.items()}
    check_trees(trees, vessel)
    page = ps.diagnostic_report(trees, args.out, vessel, seed=args.seed, progress=progress)
    text = "\n\n".join("\n".join([name, *verdict(tree)]) for name, tree in trees.items())
    holds = all(gate["holds"] for tree in trees.values() for gate in gates(tree))
    return text, page, 0 if holds else _GATE_FAILS


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


def _smooth(trial: xr.Dataset, args: argparse.Namespace, progress: Progress) -> xr.Dataset:
    if args.raw:
        return trial
    progress("denoising")
    return ps.denoise(trial)


def _posterior(folder: Path, dof: str, family: str, vessel: Vessel) -> xr.DataTree:
    """Posterior that `identify` wrote, of the vessel asked for."""
    path = folder / f"{dof}-{family}.nc"
    tree = read_posterior(path)
    if "posterior" not in tree.children or tree.attrs.get("dof") != dof:
        raise ValueError(f"{path} is no posterior of the {dof}; run `pymc-ship identify` first.")
    if tree.attrs["vessel"] != vessel.name:
        raise ValueError(
            f"The posterior is to be of {vessel.name!r}, found {tree.attrs['vessel']!r} in {path}; use its own vessel."
        )
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
    for key in ("trial", "folder", "programme", "vessel"):
        if options.get(key):
            options[key] = Path(options[key]).name
    return f"pymc-ship {ps.__version__} {args.command} {json.dumps(options)}"


def _write_trial(trial: xr.Dataset, path: Path, args: argparse.Namespace) -> None:
    with staged(path) as partial:
        text = ps.write_trial(trial, partial).read_text(encoding="utf-8")
        partial.write_text(f"# {_provenance(args)}\n{text}", encoding="utf-8")


def _write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence], args: argparse.Namespace) -> None:
    lines = [f"# {_provenance(args)}", ",".join(header), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_bands(path: Path, bands: xr.Dataset, args: argparse.Namespace) -> None:
    names = [f"{channel}_{band}" for channel in CHANNELS for band in BANDS]
    columns = [bands[channel].sel(band=band).values for channel in CHANNELS for band in BANDS]
    _write_csv(path, ("time", *names), np.column_stack([bands["time"].values, *columns]).tolist(), args)


def _coefficient_rows(vessel: Vessel, family: str, exact: Mapping[str, object]) -> list[tuple]:
    rows = []
    for dof, posterior in exact.items():
        reference = vessel.coefficients(dof)
        columns = (reference.values, posterior.mean, posterior.sd, *posterior.quantiles([0.05, 0.95]))
        names = reference["coefficient"].values.tolist()
        rows += [(dof, family, name, *values) for name, *values in zip(names, *np.array(columns).tolist(), strict=True)]
    return rows


def _tuning_text(tuned: TunedPrior) -> str:
    """Chosen prior and its rivals with their scores, and what the optimisation gained over the evidence."""
    rivals = {
        "chosen": (tuned.prior, tuned.score),
        "best seen": (tuned.seen_prior, tuned.seen_score),
        "best of the Gaussian process": (tuned.surrogate_prior, tuned.surrogate_score),
        "evidence maximum": (tuned.evidence_prior, tuned.evidence_score),
    }
    rows = [(name, prior.shape, prior.scale, prior.kappa, f"{score:.4f}") for name, (prior, score) in rivals.items()]
    return (
        f"{_table(('prior', 'shape', 'scale', 'kappa', 'score'), rows)}\n\n"
        f"Score (log predictive density per held-out row): {tuned.score:.4f} ± {tuned.score_se:.4f}.\n"
        f"Log evidence at its maximum: {tuned.log_evidence:.2f}.\n"
        f"Bayesian optimisation gained {tuned.score - tuned.evidence_score:+.4f} a row over the evidence maximum."
    )


def _coefficient_table(rows: list[tuple], families: Sequence[str]) -> str:
    """One line for each coefficient, the families side by side."""
    lines: dict[tuple, list] = {}
    for dof, _, name, reference, *values in rows:
        lines.setdefault((name, dof), [1e5 * reference]).extend(1e5 * value for value in values)
    columns = [column for family in families for column in (f"{family} mean", "sd", "5 %", "95 %")]
    return _table(("times 1e5", "dof", "reference", *columns), [(*key, *line) for key, line in lines.items()])


def _divergence(run: xr.Dataset) -> str:
    return f"The run diverged at t = {float(run['diverged_at']):g} s; the trial holds what was before."


def _index_table(found: xr.Dataset, columns: Mapping[str, xr.Dataset]) -> str:
    rows = [
        (name.replace("_", " "), *(float(values[name]) for values in columns.values()), found[name].attrs["units"])
        for name in found.data_vars
    ]
    return _table(("index", *columns, ""), rows)


def _criteria_table(criteria: list[dict]) -> str:
    words = {True: "pass", False: "fail", None: "not reached"}
    rows = [(c["criterion"], c["value"], c["limit"], c["units"], words[c["passed"]]) for c in criteria]
    return _table(("IMO MSC.137(76)", "value", "limit", "", ""), rows) if rows else ""


def _forecast_text(tree: xr.DataTree, reference: xr.Dataset) -> str:
    """Reference, median and band of each index, under the manoeuvre and the share of ships that diverged."""
    bands = tree["index_bands"].to_dataset()
    columns = {band: bands.sel(band=band) for band in BANDS}
    share, draws = tree.attrs["share_diverged"], tree.attrs["draws"]
    title = (
        f"{tree.attrs['label']}: {draws} ships, {100.0 * share:.3g} % diverged, bands of {tree.attrs['ci_prob']:.0%}"
    )
    return f"{title}\n{_index_table(reference, {'reference': reference, **columns})}"


def _table(header: Sequence[str], rows: Iterable[Sequence]) -> str:
    """Columns of text, the first one flush left and the others flush right."""
    cells = [list(header), *([_cell(value) for value in row] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = (
        "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in cells
    )
    return "\n".join(line.rstrip() for line in lines)


def _cell(value: str | float) -> str:
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"
