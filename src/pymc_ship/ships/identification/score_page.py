"""Page of a score: replays of a ship along records."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.machine.arguments import check_counts, check_kind
from pymc_ship.pages.drawing import BLUE, REFERENCE, RUST, house_style, subplots
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import fixed_point, heads, number, table
from pymc_ship.ships.ensemble.ship import ShipLike, as_ship
from pymc_ship.ships.identification.figures import channel_panels
from pymc_ship.ships.identification.replay import SCORED, channel_rows, index_errors, replay, run_rows
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.quality_flags import ground_remarks, quality_remarks
from pymc_ship.trial.record import named_trials

PAGE = Page(
    "score.html",
    Path(__file__).with_name("score_page.html.j2"),
    own=("figures/score_*.png", "tables/score_*.csv"),
    packages=("pymc-ship", "numpy", "xarray", "numba", "matplotlib"),
)
"""Page of a score; its folder may hold that of the identification, too."""

SHOWN = 4  # runs whose windows are drawn
_DRAWN = SCORED[:-1]


def write_score_page(
    ship: ShipLike,
    trials: Mapping[str, xr.Dataset],
    scores: xr.Dataset,
    indices: xr.Dataset,
    out: str | Path,
    *,
    draws: int,
    command: str,
) -> Path:
    """Write the page of a score.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
    trials : mapping of str to Dataset
        Scored records, by name.
    scores : Dataset
        From :func:`pymc_ship.score`.
    indices : Dataset, dims (run, index)
        From :func:`pymc_ship.score_indices`.
    out : str or Path
        Folder, created where it is missing.
    draws : int
        Draws of the windows in the figure.
    command : str
        Command that repeats the page.

    Returns
    -------
    Path
        ``out/score.html``; its figures and tables are in folders there.

    Raises
    ------
    TrialError
        For trials without names, or no trials.
    OutputError
        When the folder cannot be written.
    """
    check_counts(draws=draws)
    ship, trials = as_ship(ship), named_trials(trials)
    check_kind("scores", scores, xr.Dataset, "make them by ps.score")
    check_kind("indices", indices, xr.Dataset, "make them by ps.score_indices")
    rows, runs = channel_rows(scores), run_rows(scores)
    n, percent = number(3), fixed_point(0)
    channels = heads(str, run="run", channel="channel") | heads(n, rmse="RMSE [SI]", relative="RMSE over motion")
    channels |= heads(percent, coverage="inside %") | heads(n, crps="CRPS [SI]")
    by_run = heads(str, run="run") | heads(percent, windows="windows", diverged="diverged") | heads(n, score="score")
    columns = heads(str, run="run", manoeuvre="manoeuvre", index="index")
    columns |= heads(n, measured="measured", forecast="forecast", error="error", lower="95 % from", upper="to")
    columns |= heads(str, inside="inside 95 %")
    index_error_rows, selected = index_errors(indices), list(trials)[:SHOWN]
    values = {
        "vessel": ship.vessel,
        "attrs": scores.attrs,
        "single": ship.draws == 1,
        "covered": 100.0 * float(scores["coverage"].mean()),
        "tables": {
            "channels": table([row | {"coverage": 100.0 * row["coverage"]} for row in rows], channels),
            "runs": table(runs, by_run),
            "indices": table(index_error_rows, columns),
        },
        "missed": _missed(index_error_rows),
        "remarks": quality_remarks(trials) + ground_remarks(trials),
        "shown": selected,
        "command": command,
    }
    selected_trials = {name: trials[name] for name in selected}
    length, ci_prob = scores.attrs["length"], scores.attrs["ci_prob"]
    every = max(length, scores.attrs["every"])
    windows = windows_of(ship, selected_trials, length, every, draws, ci_prob=ci_prob)
    figures = {"score_channels": errors_by_channel(scores), "score_windows": windows}
    tables = {"score_channels": rows, "score_runs": runs, "score_indices": index_error_rows}
    return write_page(PAGE, out, Content(values, figures, tables))


def _missed(rows: Sequence[Mapping]) -> str:
    known = [row for row in rows if row["inside"]]
    missed = [row for row in known if row["inside"] == "no"]
    listed = "; ".join(f"{row['index']} of {row['run']}" for row in missed)
    text = f"{len(missed)} of {len(known)} measured indices lie outside the intervals of 95 %: {listed}."
    return text if missed else ""


@house_style
def errors_by_channel(scores: xr.Dataset) -> Figure:
    """Error over the motion and coverage of the bands by channel, a dot for each run, from :func:`pymc_ship.score`."""
    fig, axes = subplots(8.0, 3.2, 1, 2)
    positions = np.arange(scores.sizes["channel"])
    offsets = np.linspace(-0.2, 0.2, scores.sizes["run"]) if scores.sizes["run"] > 1 else np.zeros(1)
    panels = (("relative", 1.0, "RMSE over motion"), ("coverage", 100.0, "instants inside the bands [%]"))
    for ax, (key, factor, label) in zip(axes[0], panels, strict=True):
        values = factor * scores[key]
        for offset, row in zip(offsets, values.values, strict=True):
            ax.plot(positions + offset, row, "o", ms=4, color=BLUE, alpha=0.7)
        mean = factor * scores[key].mean("run").values
        ax.plot(positions, mean, "_", ms=22, mew=1.6, color=RUST, label="mean of the runs")
        ax.set_xticks(positions, scores["channel"].values.tolist())
        ax.set_ylabel(label)
        ax.set_ylim(0.0, None if key == "relative" else 104.0)
    axes[0, 1].axhline(100.0 * scores.attrs["ci_prob"], color=REFERENCE, ls="--", lw=0.9, label="nominal")
    fig.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


@house_style
def windows_of(
    ship: ShipLike,
    trials: Mapping[str, xr.Dataset],
    length: float,
    every: float,
    draws: int,
    *,
    ci_prob: float,
) -> Figure:
    """Measured motion of runs, and replays in windows of a ``length``, one ``every`` [s], with their bands."""
    fig, axes = channel_panels(list(trials), _DRAWN)
    for column, trial in enumerate(trials.values()):
        time = trial["time"].values
        begins = np.arange(time[0], time[-1] - length + 1e-9, every)
        trees = [replay(ship, trial, start=float(at), duration=length, draws=draws, ci_prob=ci_prob) for at in begins]
        for row, channel in enumerate(_DRAWN):
            ax, factor = axes[row, column], CHANNELS[channel].unit.display_factor
            ax.plot(time, factor * trial[channel].values, color=REFERENCE, lw=0.9, label="measured")
            for k, tree in enumerate(trees):
                bands = tree["bands"].dataset
                lower, median, upper = factor * bands[channel].values
                at, labels = bands["time"].values, ("ship", "band", "restart") if k == 0 else (None,) * 3
                ax.plot(at, median, color=RUST, label=labels[0])
                ax.fill_between(at, lower, upper, color=RUST, alpha=0.25, lw=0.0, label=labels[1])
                ax.plot(at[0], median[0], "o", ms=3, color=RUST, label=labels[2])
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return fig
