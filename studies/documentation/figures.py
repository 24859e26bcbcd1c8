"""Figures of the documentation, each from tables in ``reports``."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.pages.drawing import BLUE, METHOD_COLOURS, REFERENCE, RUST, house_style, subplots
from studies.documentation.tables import foreign_diameters, table

NORMAL_95 = 1.96
"""Half width of an interval of 95 % of the normal law [standard deviations]."""

_LEVELS = (BLUE, RUST, "#3a8f4d")  # colours of the noise levels

SHORTENED = re.compile(
    ", least ESS|, with compilation|, translation invariant|, bands, indices|, kernels from the cache"
    "| of the equations.*| in the lanes of one core"
)
"""What a label of the figure of speed leaves out."""


@house_style
def what_to_expect() -> Figure:
    """Median error and half width of the forecast indices of a population, by the trials of the ship."""
    rows = [line for line in table("ships/tables/trials") if line["group"] != "all"]
    height = np.arange(len(rows))[::-1]
    fig, axes = subplots(6.4, 2.9)
    ax = axes[0, 0]
    for column, colour, marker, label in (
        ("median_error", BLUE, "o", "median error"),
        ("half_width", RUST, "|", "median half width of the 95 % interval"),
    ):
        values = [float(line[column]) for line in rows]
        ax.plot(values, height, marker, color=colour, ms=6.0 if marker == "o" else 11.0, mew=2.0, label=label)
    ax.set_yticks(height, [line["group"] for line in rows])
    ax.set_xlim(left=0.0)
    ax.set_xlabel("in ship lengths, in L/U for times, in swings of the heading for overshoots")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


@house_style
def foreign_diameters_by_case() -> Figure:
    """Error of the forecast tactical diameter of every case of the foreign ships, with its interval of 95 %."""
    cases = foreign_diameters()
    height = np.arange(len(cases))[::-1]
    fig, axes = subplots(6.4, 5.6)
    ax = axes[0, 0]
    for k, (colour, marker, label) in enumerate(((BLUE, "o", "starboard"), (RUST, "s", "port"))):
        median, lower, upper = np.array([sides[k] for sides in cases.values()]).T
        style = {"color": colour, "ls": "none", "ms": 4.0, "elinewidth": 0.8, "capsize": 2.0}
        bars = np.maximum((median - lower, upper - median), 0.0)
        ax.errorbar(median, height + 0.16 - 0.32 * k, xerr=bars, marker=marker, label=label, **style)
    ax.axvline(0.0, color=REFERENCE, ls="--", lw=0.9)
    ax.set_yticks(height, list(cases))
    ax.set_xlabel("forecast minus true tactical diameter, with the 95 % interval [%]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


@house_style
def coefficient_coverage() -> Figure:
    """Share of the coefficients inside their intervals of 90 %, by method and noise level, with two standard errors."""
    rows = table("montecarlo/cells")
    fig, axes = subplots(6.4, 3.4)
    ax = axes[0, 0]
    for colour, marker, method in zip(
        METHOD_COLOURS[1:],
        "o^sD",
        ("trajectory fit", "weak form", "paper's pipeline", "central difference"),
        strict=True,
    ):
        mine = [line for line in rows if line["method"] == method]
        level, share, error = np.array(
            [[float(line[c]) for c in ("level", "coverage", "coverage_se")] for line in mine]
        ).T
        ax.errorbar(100.0 * level, share, 2.0 * error, color=colour, marker=marker, ms=4.0, capsize=2.0, label=method)
    ax.axhline(90.0, color=REFERENCE, ls="--", lw=0.9, label="stated")
    ax.set_xscale("log")
    ax.set_xticks([0.1, 0.3, 1.0, 3.0, 5.0], ["0.1", "0.3", "1", "3", "5"])
    ax.minorticks_off()
    ax.set_ylim(0.0, 101.0)
    ax.set_xlabel("noise level [%]")
    ax.set_ylabel("coefficients inside [%]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside right center")
    return fig


@house_style
def intervals_by_ship() -> Figure:
    """Share of coefficients inside intervals of 90 and 50 %, by ship, manoeuvre and noise, with standard errors."""
    cells: dict[tuple[str, str], list[dict[str, str]]] = {}
    for line in table("intervals/cells"):
        cells.setdefault((line["ship"], line["manoeuvre"].removesuffix(" port")), []).append(line)
    height = np.arange(len(cells))[::-1]
    fig, axes = subplots(6.4, 5.2)
    ax = axes[0, 0]
    for name, nominal, marker in (("coverage", 90.0, "o"), ("coverage_half", 50.0, "s")):
        ax.axvline(nominal, color=REFERENCE, ls="--", lw=0.9)
        for k, colour in enumerate(_LEVELS):
            rows = [lines[k] for lines in cells.values()]
            values, errors = ([float(line[column]) for line in rows] for column in (name, f"{name}_se"))
            label = f"noise {100.0 * float(rows[0]['level']):g} %" if nominal > 50.0 else None
            style = {"color": colour, "ls": "none", "ms": 4.0, "elinewidth": 0.8, "marker": marker}
            ax.errorbar(values, height + 0.25 - 0.25 * k, xerr=errors, label=label, **style)
    ax.set_yticks(height, [f"{ship}, {manoeuvre}" for ship, manoeuvre in cells])
    ax.set_xlabel("coefficients inside intervals of 50 % (squares) and 90 % (circles) [%]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return fig


@house_style
def model_error() -> Figure:
    """Errors of held-out indices of the KVLCC2 over their standard deviation, without and with the model error."""
    rows = table("kvlcc2/tables/held_out_indices")
    error, total = np.array([(float(line["error"]), float(line["sd"])) for line in rows]).T
    known = known_sd(rows)
    fig, axes = subplots(6.4, 2.2)
    ax = axes[0, 0]
    ax.axvspan(-NORMAL_95, NORMAL_95, color=BLUE, alpha=0.12, lw=0.0, label="interval of 95 %")
    for height, colour, sd in ((1.0, RUST, known), (0.0, BLUE, total)):
        jitter = 0.3 * np.sin(np.arange(len(rows)) * 2.4)
        ax.plot(error / sd, height + jitter, "o", color=colour, ms=3.5, alpha=0.8)
    ax.set_yticks([0.0, 1.0], ["with model error", "without"])
    ax.set_xlabel("forecast minus measured index [standard deviations]")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center")
    return fig


def known_sd(rows: list[dict[str, str]]) -> np.ndarray:
    """Standard deviation of every index by draws, term sets and noise of the sensors, without the model error."""
    names = ("parameter_sd", "model_sd", "measured_sd")
    return np.linalg.norm([[float(line[name]) for name in names] for line in rows], axis=1)


@house_style
def esso_osaka_inputs() -> Figure:
    """Score of the Esso Osaka by state, with and without the measured wind and revolutions."""
    rows = [line for line in table("esso_osaka/scores") if line["trained_on"] == "TRZ"]
    states = ("u", "v", "r", "heading", "position")
    fig, axes = subplots(6.4, 3.0)
    ax = axes[0, 0]
    for k, (line, colour) in enumerate(zip(rows, (BLUE, METHOD_COLOURS[0], RUST, "#e9b79c"), strict=True)):
        place = np.arange(len(states)) + 0.2 * (k - 1.5)
        ax.bar(place, [float(line[state]) for state in states], 0.19, color=colour, label=line["inputs"])
    ax.set_xticks(range(len(states)), states)
    ax.set_ylabel("error over the size of the motion")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=4, title="measured inputs")
    return fig


@house_style
def speed() -> Figure:
    """Time of a peer over that of the package, by what is timed."""
    rows = [line for line in table("benchmarks/benchmarks") if line["ratio"]]
    height = np.arange(len(rows))[::-1]
    ratio = np.array([float(line["ratio"]) for line in rows])
    fig = Figure(figsize=(7.6, 0.9 + 0.22 * len(rows)))
    ax = fig.add_axes((0.5, 0.08, 0.48, 0.91))  # the constrained layout cuts labels as long as these
    ax.barh(height, np.log10(ratio), 0.7, color=[BLUE if value >= 1.0 else RUST for value in ratio])
    labels = [f"{SHORTENED.sub('', line['what'])} | {re.split(r',| [(]', line['peer'])[0]}" for line in rows]
    ax.set_yticks(height, labels, fontsize=7.5)
    ax.set_ylim(-0.7, len(rows) - 0.3)
    ticks = np.array([0.01, 0.1, 1.0, 10.0, 100.0])
    ax.set_xticks(np.log10(ticks), [f"{tick:g}" for tick in ticks])
    ax.set_xlabel("times as fast as the peer")
    return fig


FIGURES = {
    "what_to_expect": what_to_expect,
    "foreign_ships": foreign_diameters_by_case,
    "coefficient_coverage": coefficient_coverage,
    "intervals_by_ship": intervals_by_ship,
    "model_error": model_error,
    "esso_osaka_inputs": esso_osaka_inputs,
    "speed": speed,
}
"""Figures by the name of their file in ``docs/figures``."""
