"""First screen of the page of a ship: what was measured, what was missed, and what no run supports."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_ship.pages.tables import fixed_point, number, rounded_percent
from pymc_ship.physics.manoeuvre.kinds import UNITS
from pymc_ship.ships.forecasting.extrapolation import percentage_outside
from pymc_ship.ships.forecasting.page import index_rows
from pymc_ship.ships.forecasting.stopping import stopping_advice
from pymc_ship.ships.identification.held_out_errors import QUANTILES, coverage, harder_index_rows, overshoot_errors
from pymc_ship.ships.identification.model import ShipIdentification

DOUBTS = ("doubtful", "bad")  # verdicts of checks that the page lists
_SHOWN = 5  # missed indices that the page names
_WORDS = {"first": "First overshoot angle", "second": "Second overshoot angle"}
_TURN, _ZIGZAGS = "turning circle 35", ("zigzag 10/10", "zigzag 20/20")
_SUMMARY = (  # manoeuvre and indices of each sentence of the summary
    (_TURN, ("advance", "transfer", "tactical diameter")),
    (_ZIGZAGS[0], ("first overshoot angle", "second overshoot angle", "initial turning distance")),
    (_ZIGZAGS[1], ("first overshoot angle", "second overshoot angle")),
)


def measured_sentences(
    result: ShipIdentification, held_out: Sequence[Mapping], forecasts: Mapping[str, xr.DataTree]
) -> list[str]:
    """Sentences: runs, held-out indices outside their intervals, and forecasts that no run supports.

    ``held_out`` are rows of :func:`.index_error_rows`; ``forecasts`` are those of the page, by label.
    """
    labels = [manoeuvre.label for manoeuvre in result.manoeuvres if manoeuvre is not None]
    others = len(result.manoeuvres) - len(labels)
    runs = [*dict.fromkeys(labels), *([f"{others} of no standard manoeuvre"] if others else [])]
    sentences = [f"Measured: {', '.join(runs)}."]
    missed = sorted((row for row in held_out if abs(row["z"]) > QUANTILES["95"]), key=lambda row: -abs(row["z"]))
    if missed:
        more = f"; and {len(missed) - _SHOWN} more" if len(missed) > _SHOWN else ""
        sentences.append(f"Measured and missed: {'; '.join(map(_missed, missed[:_SHOWN]))}{more}.")
    if held_out:
        kinds = " and ".join(dict.fromkeys(f"{row['manoeuvre'].rpartition(' ')[0]}" for row in held_out))
        sentences.append(
            f"Held-out runs: {_inside(held_out)} of {len(held_out)} measured indices lie inside the intervals "
            f"of 95 %. This covers {kinds} only."
        )
    else:
        sentences.append("No measured manoeuvre was predicted from other runs: the intervals are not tested.")
    if harder := harder_index_rows(result.ship):
        turns = ", ".join(dict.fromkeys(row["manoeuvre"] for row in harder))
        sentences.append(
            f"Harder runs ({turns}), forecast by the milder ones alone: {_inside(harder)} of {len(harder)} measured "
            "indices lie inside."
        )
    unsupported = [f"{label} ({_outside(tree)})" for label, tree in forecasts.items() if label not in labels]
    if unsupported:
        sentences.append(
            f"Not measured, forecast only: {'; '.join(unsupported)}. Extrapolated intervals can be too narrow; compare "
            "a run with them before you rely on them."
        )
    return sentences


def _inside(rows: Sequence[Mapping]) -> int:
    return sum(abs(row["z"]) <= QUANTILES["95"] for row in rows)


def _missed(row: Mapping) -> str:
    n, unit = fixed_point(1), UNITS[row["kind"]]
    return (
        f"{row['index'].replace('_', ' ')} of {row['run']} {n(row['measured'])} {unit}, forecast "
        f"{n(row['forecast'])} ± {n(QUANTILES['95'] * row['sd'])} {unit}"
    )


def _outside(tree: xr.DataTree) -> str:
    fraction = tree.attrs["extrapolated_fraction"]
    if not np.isfinite(fraction):
        return "extrapolation not assessed"
    return f"{percentage_outside(fraction)} extrapolated" if fraction else "inside the motion of the runs"


def opening_sentences(
    result: ShipIdentification, verdicts: Sequence[Mapping], forecasts: Mapping[str, xr.DataTree]
) -> list[str]:
    """Sentences for the ship's master: turn, overshoots, IMO criteria and stop; empty without forecasts.

    ``verdicts`` are rows of :func:`.verdict_rows` of the ``forecasts``.
    """
    if not verdicts:
        return []
    rows = {label: {row["index"]: row for row in index_rows(tree, result.vessel)} for label, tree in forecasts.items()}

    def less_favourable(manoeuvre: str, index: str) -> str:
        of_side = {label: of[index] for label, of in rows.items() if label.startswith(manoeuvre) and index in of}
        of_side = {label: row for label, row in of_side.items() if np.isfinite(row["median"])}
        if not of_side:
            return f"{index} unknown"
        label, row = max(of_side.items(), key=lambda pair: pair[1]["median"])
        n = fixed_point(1 if row["units"] == "deg" else 2)
        beyond = " extrapolated" if forecasts[label].attrs["extrapolated_fraction"] > 0.0 else ""
        return f"{index} {n(row['median'])} {row['units']} ({n(row['lower'])} to {n(row['upper'])}{beyond})"

    sentences = [
        f"{manoeuvre.capitalize()}: {'; '.join(less_favourable(manoeuvre, index) for index in indices)}."
        for manoeuvre, indices in _SUMMARY
    ]
    return [*sentences, _criteria(verdicts), stopping_advice(result.ship)]


def _criteria(verdicts: Sequence[Mapping]) -> str:
    """Sentence: number of IMO criteria that the ship passes to both sides, with the least favourable side."""
    sides: dict[tuple[str, str], list[Mapping]] = {}
    for row in verdicts:
        sides.setdefault((row["manoeuvre"].rpartition(" ")[0], row["criterion"]), []).append(row)
    worst = [min(("fails", "open", "passes").index(row["conformity"]) for row in rows) for rows in sides.values()]
    fails, is_open, passes = (worst.count(rank) for rank in range(3))
    beyond = sum(
        rank == 2 and any(row["extrapolated"] > 0.0 for row in rows)
        for rank, rows in zip(worst, sides.values(), strict=True)
    )
    extrapolated = f" ({beyond} by extrapolation)" if beyond else ""
    return (
        f"IMO MSC.137(76): of {len(sides) + 1} criteria the forecasts pass {passes} to both sides{extrapolated} and "
        f"fail {fails}; {is_open} are open, and stopping is not assessed."
    )


def fit_sentences(result: ShipIdentification, rows: Mapping[str, list[dict]], summary: Sequence[str]) -> list[str]:
    """Sentences on the fit, held-out runs, checks and the recommended run, from the rows of the page's tables."""
    best, drawn = result.candidates[0], [row for row in rows["term_sets"] if row["draws"]]
    fraction = sum(row["weight"] * row["infeasible_fraction"] for row in drawn)
    worst = [row["run"] for row in rows["runs"] if row["verdict"] in DOUBTS]
    n_sets, verdict = len(result.candidates), "is doubtful" if rows["checks"] else "was made"
    weighs = f"{n_sets} term sets fitted; “{best.name}” weighs most, {100.0 * best.weight:.0f} %."
    sentences = [
        weighs if n_sets > 1 else f"One term set fitted: “{best.name}”.",
        *held_out_sentences(rows["held_out_indices"]),
        f"Runs with a doubtful check: {', '.join(worst)}." if worst else f"No check of a run {verdict}.",
    ]
    text = f"{rounded_percent(fraction)} diverged and were replaced by new draws" if fraction else "none diverged"
    return [*sentences, f"Every draw of the coefficients was simulated in six standard manoeuvres; {text}.", *summary]


def held_out_sentences(rows: Sequence[Mapping]) -> list[str]:
    """Sentences on overshoots, times and coverage of held-out manoeuvres."""
    if not rows:
        return []
    errors, n = overshoot_errors(rows), number(2)
    sentences = [
        f"{word} of held-out zigzags: mean absolute error {n(errors[f'{name}_overshoot_angle_mean'])} deg, largest "
        f"{n(errors[f'{name}_overshoot_angle_max'])} deg."
        for name, word in _WORDS.items()
        if np.isfinite(errors[f"{name}_overshoot_angle_mean"])
    ]
    if np.isfinite(errors["overshoot_time_median"]):
        sentences.append(f"Time to overshoot: median absolute error {n(errors['overshoot_time_median'])} %.")
    covered = coverage(rows)
    text = f"Intervals of 90 % cover {covered['90']} and of 95 % cover {covered['95']} of {len(rows)} held-out indices"
    others = (
        f" With the model error of the other runs alone, they cover {covered['90_leave_one_out']} and "
        f"{covered['95_leave_one_out']}."
    )
    known = all(np.isfinite(row["leave_one_out_sd"]) for row in rows)
    return [*sentences, f"{text}.{others if known else ''}"]
