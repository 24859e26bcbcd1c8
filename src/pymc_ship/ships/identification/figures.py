"""Figures of an identified ship: held-out windows and overshoots, scores of term sets."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pymc_ship.inference.trajectory.runs import Run
from pymc_ship.inference.trajectory.windows import thin_record, window_misfit
from pymc_ship.pages.drawing import BLUE, DOF_COLOURS, REFERENCE, RUST, house_style, subplots
from pymc_ship.pages.tables import percent
from pymc_ship.physics.vessel.term_sets import valid_at_any_speed
from pymc_ship.ships.ensemble.feasibility import FASTEST, TIGHTEST
from pymc_ship.ships.ensemble.index_table import index_rows
from pymc_ship.ships.identification.candidates import Candidate, Refusal, folds, modelled_windows
from pymc_ship.ships.identification.held_out_errors import QUANTILES
from pymc_ship.trial.channels import CHANNELS

BARS = 0.9  # probability of the intervals of the term sets
_BOOTSTRAPS = 2000


def held_out_windows(candidate: Candidate, trials: Sequence[xr.Dataset], k: int) -> list[tuple[Run, np.ndarray]]:
    """Windows of run ``k``, with forecasts (n_channels, n_blocks) by the other runs, NaN after divergence."""
    windows = modelled_windows(thin_record(trials[k], candidate.vessel), candidate.vessel)
    fits = [candidate.held_out.fits[k]] * len(windows)
    if len(trials) == 1:
        groups = zip(candidate.held_out.fits, folds([windows]), strict=True)
        fits = [fit for fit, group in groups for _ in group]
    return [
        (window.run, window.run.means - window_misfit(window, candidate.vessel, fit.coefficients))
        for window, fit in zip(windows, fits, strict=True)
    ]


def channel_panels(runs: Sequence[str], channels: Sequence[str]) -> tuple[Figure, np.ndarray]:
    """Panels against time, a column for each run and a row for each channel."""
    fig, axes = subplots(8.0, 1.75 * len(channels) + 0.7, len(channels), len(runs), sharex="col", sharey="row")
    for ax, name in zip(axes[0], runs, strict=True):
        ax.set_title(name, parse_math=False)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    for ax, channel in zip(axes[:, 0], channels, strict=True):
        ax.set_ylabel(CHANNELS[channel].axis)
    fig.align_ylabels(axes[:, 0])
    return fig, axes


@house_style
def restarted_motion(runs: Mapping[str, Sequence[tuple[Run, np.ndarray]]]) -> Figure:
    """Measured motion of runs, and held-out forecasts of their windows; a dot marks each restart."""
    channels = next(iter(runs.values()))[0][0].channels
    fig, axes = channel_panels(list(runs), channels)
    for column, windows in enumerate(runs.values()):
        for row, channel in enumerate(channels):
            ax, factor = axes[row, column], CHANNELS[channel].unit.display_factor
            time = np.concatenate([window.time for window, _ in windows])
            record = np.concatenate([window.means[row] for window, _ in windows])
            ax.plot(time, factor * record, color=REFERENCE, lw=0.9, label="measured")
            for k, (window, forecast) in enumerate(windows):
                labels = ("forecast by the fit to the other runs", "restart") if k == 0 else (None, None)
                ax.plot(window.time, factor * forecast[row], color=RUST, label=labels[0])
                ax.plot(window.time[0], factor * forecast[row, 0], "o", ms=3, color=RUST, label=labels[1])
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


@house_style
def held_out_overshoots(table: xr.Dataset) -> Figure:
    """Forecast against measured overshoots of held-out runs, with 95 %: angles, and times to the peaks."""
    fig, axes = subplots(8.0, 4.3, 1, 2)
    rows = list(index_rows(table))
    panels = (("angle", "overshoot angle", "deg"), ("time", "time to overshoot", "s"))
    for ax, (kind, title, unit) in zip(axes[0], panels, strict=True):
        ends = []
        for name, colour, marker in (("first", BLUE, "o"), ("second", RUST, "s")):
            index_rows_of_kind = [row for row in rows if row["index"] == f"{name}_overshoot_{kind}"]
            measured, forecast, sd = (
                np.array([row[key] for row in index_rows_of_kind]) for key in ("measured", "forecast", "sd")
            )
            style = {"fmt": marker, "ms": 4.5, "color": colour, "capsize": 2.5, "elinewidth": 0.9}
            ax.errorbar(measured, forecast, QUANTILES["95"] * sd, label=f"{name} overshoot", **style)
            ends += [*measured, *(forecast - QUANTILES["95"] * sd), *(forecast + QUANTILES["95"] * sd)]
        low, high = (min(ends), max(ends)) if ends else (0.0, 1.0)
        reach = 0.06 * (high - low) or 1.0
        limits = (low - reach, high + reach)
        ax.plot(limits, limits, color=REFERENCE, ls="--", lw=0.9, label="forecast = measured")
        ax.set(xlim=limits, ylim=limits, aspect="equal", title=f"{title}, held-out runs")
        ax.set_xlabel(f"measured [{unit}]")
        ax.set_ylabel(f"forecast, bars of 95 % [{unit}]")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


def score_differences(candidates: Sequence[Candidate], rng: np.random.Generator) -> list[dict]:
    """Held-out score (elpd) of each term set minus that of the first, per run, with a Bayesian bootstrap over runs.

    Rows have ``name``, ``differences`` (n_runs,), ``mean``, ``lower`` and ``upper``; NaN for a set that diverged.
    """
    first = candidates[0].held_out.log_density
    run_weights = rng.dirichlet(np.ones(first.size), _BOOTSTRAPS)
    rows = []
    for candidate in candidates[1:]:
        differences = candidate.held_out.log_density - first
        row = {"name": candidate.name, "differences": differences, "mean": np.nan, "lower": np.nan, "upper": np.nan}
        if np.isfinite(differences).all():
            ends = np.quantile(run_weights @ differences, [0.5 - 0.5 * BARS, 0.5 + 0.5 * BARS])
            row |= {"mean": float(differences.mean()), "lower": float(ends[0]), "upper": float(ends[1])}
        rows.append(row)
    return rows


@house_style
def term_set_scores(rows: Sequence[Mapping], best: str) -> Figure:
    """Score of each term set minus that of the ``best``, in every held-out run, with mean and interval."""
    fig, axes = subplots(8.0, 1.5 + 0.42 * len(rows))
    ax, colour = axes[0, 0], DOF_COLOURS["surge"]
    ax.axvline(0.0, color=REFERENCE, ls="--", lw=0.9)
    for position, row in enumerate(rows):
        if not np.isfinite(row["mean"]):
            settings = {"xycoords": ("axes fraction", "data"), "va": "center", "color": RUST}
            ax.annotate("a window diverged", (0.02, position), **settings)
            continue
        ax.plot(row["differences"], np.full(len(row["differences"]), position - 0.16), "|", ms=9, color=RUST)
        bar = [[row["mean"] - row["lower"]], [row["upper"] - row["mean"]]]
        ax.errorbar(row["mean"], position + 0.12, xerr=bar, fmt="o", ms=5, color=colour, capsize=3)
    ax.set_yticks(range(len(rows)), [row["name"] for row in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    if not np.isfinite([row["mean"] for row in rows]).any():
        ax.set_xlim(-1.0, 0.1)
    ax.set_xlabel(f"elpd less that of “{best}” [nats per run]; to the left is worse")
    marks = [
        Line2D([], [], ls="", marker="o", ms=5, color=colour, label=f"mean over the runs, bar of {percent(BARS)}"),
        Line2D([], [], ls="", marker="|", ms=9, color=RUST, label="single runs"),
    ]
    fig.legend(handles=marks, loc="outside upper center", ncols=2)
    return fig


@house_style
def diverging_motion(refusals: Sequence[Refusal]) -> Figure:
    """Speed and rate of turn of the diverging ships against time in L/U, with the feasible limits."""
    fig, axes = subplots(8.0, 4.2, 2, 1, sharex="col")
    speed_axes, turn_axes = axes[:, 0]
    motions = [(one.name, one.vessel, one.failure.motion) for one in refusals if one.vessel and one.failure]
    for name, vessel, ship in motions:
        particulars = vessel.particulars
        speed = np.hypot(ship["u"].values, ship["v"].values)
        time = ship["time"].values / particulars.ship_time
        (line,) = speed_axes.plot(time, speed / particulars.nominal_speed, label=name)
        turn = ship["r"].values * particulars.L / np.maximum(speed, 1e-3 * particulars.nominal_speed)
        turn_axes.plot(time, turn, color=line.get_color())
    speed_axes.axhline(FASTEST, color=REFERENCE, ls="--", lw=0.9)
    ahead = not all(valid_at_any_speed(vessel) for _, vessel, _ in motions)
    for side in (1.0, -1.0) if ahead else ():
        turn_axes.axhline(side / TIGHTEST, color=REFERENCE, ls="--", lw=0.9)
    speed_axes.set_ylabel("speed over nominal")
    turn_axes.set(xlabel="time [L/U]", ylabel="rL/U")
    fig.legend(*speed_axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig
