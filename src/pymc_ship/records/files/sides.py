"""Sides of a file: letters beside numbers, the side of a positive rudder by the record itself, the axes of the motion.

A motion and its mirror image, with y, psi, v, r, phi, p and delta reversed, agree with themselves equally well.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.columns import (
    MAGNETIC,
    Column,
    channels_of,
    is_from_true_north,
    is_unit,
    name_and_unit,
    plain_name,
)
from pymc_ship.records.files.format import TrialFormat
from pymc_ship.records.files.ship_scale import SIGNIFICANT, ShipScale, least_squares, ship_blocks, ship_scale
from pymc_ship.trial.cells import MISSING_CELLS, Cells, Numbers, cell_numbers, texts_of
from pymc_ship.trial.record import AXES

FOUND = "rudder_positive"  # attribute of a trial: side of the file's positive rudder, where the record showed it

_CORRELATED = 0.7  # correlation of yaw rate and rudder from which it shows the side, as in a long steady turn
_STEADY = 0.9  # correlation of a steady turn, whose sign prevails over that of the gain
_TURN = 0.5  # rad that the ship turns at least where the correlation alone shows the side
_BLOCK = 0.25  # L/U
_HINT = 3.0  # standard errors from which a record that is refused anyway shows the middle of its rudder
_FEWEST_SAMPLES = 20
_STILL = np.deg2rad(0.5)  # smallest movement of a rudder

MIRROR_IMAGE = (
    'a mirror image (ROS: x east, y north, psi counterclockwise, v to port): for that, state convention = "enu-flu"'
)

_OF_THE_EARTH = ("north", "northing", "east", "easting")  # headings of x and y
_OF_THE_COMPASS = ("hdt", "ths", "hdg", "gyro", "gyro heading")  # of psi
_OF_THE_BRIDGE = ("rot", "rate of turn")  # of r, positive to starboard


_STARBOARD = {"P": "-", "S": "", "PORT": "-", "STBD": "", "STARBOARD": ""}
_LETTERS = {"latitude": {"N": "", "S": "-"}, "longitude": {"E": "", "W": "-"}, "wind_direction": {"T": "", "R": ""}}
_LETTERS |= dict.fromkeys(("psi", "cog"), dict.fromkeys(("T", "M", "TRUE", "MAG", "MAGNETIC"), ""))
_LETTERS |= dict.fromkeys(("delta", "r", "v"), _STARBOARD)
"""Sign of a number by the letter beside it: hemispheres, true and other directions, port and starboard."""
_SIDES = frozenset(letter for signs in _LETTERS.values() for letter in signs)
_NORTH = _LETTERS["psi"].keys() | _LETTERS["wind_direction"].keys()
_BESIDE = {"", "n", "s", "ns", "e", "w", "ew", "p", "ps", "side", "dir", "direction", "hemisphere", "unit", "type"}
_BESIDE |= {"t", "m", "r", "ref", "reference", "north", "true", "mag", "magnetic"}
"""Words in the heading of a column of letters that belongs to the column beside it."""

_MINUTES = re.compile(
    r"(?P<before>[NSEW]?)\s*(?P<sign>[-+]?)(?P<degrees>\d{1,3})\s*[°:\s-]\s*"
    r"(?P<minutes>[0-5]?\d(?:[.,]\d+)?|60(?:[.,]0+)?)\s*['′’:\s]?\s*"
    r"(?:(?P<seconds>[0-5]?\d(?:[.,]\d+)?|60(?:[.,]0+)?)\s*(?:[\"″”]|'')?)?\s*(?P<behind>[NSEW]?)",
    re.IGNORECASE,
)  # 53°29.9996'N, 53 29 59.98 N, 53:29.9996, 53-29.9996N
_LETTER = re.compile(r"[^\W\d_]|[°:]|\d \d")
_NO_NUMBER = re.compile(r"[^-+.,0-9]")  # found faster than a letter where there is none
_NUMBER_AND_WORD = re.compile(
    r"(?:([^\W\d_]+)\s*)?([-+]?[\d.,]*\d)\s*(°|(?(1)(?!)|°?\s*[^\W\d_][^\s\d]*))?"
)  # P 3, 15.5 kn


@dataclass(frozen=True)
class RudderEffect:
    """Yaw acceleration per rudder angle and its standard error [U2/L2], and the lagged correlation of r and delta.

    ``side`` is that of a turn by positive angles, "port" or "starboard"; empty where the record does not show it.
    """

    gain: float
    error: float
    correlation: float
    side: str


def rudder_effect(trial: xr.Dataset, scale: ShipScale) -> RudderEffect:
    """Effect of the rudder on the yaw rate, by Nomoto's equation with a cubic term, or by lagged correlation.

    A rudder that is read early or late can turn the sign of the gain in a steady turn, which the correlation shows.
    """
    time, delta, r, acceleration = _yaw_blocks(trial, scale)
    coefficients, errors, _ = least_squares([delta, r, r * np.abs(r)], acceleration)
    gain, error = (float(values[0]) * scale.time**2 for values in (coefficients, errors))
    correlation = _lagged_correlation(delta, r, round(1.0 / _BLOCK))
    turn = np.ptp(np.cumsum(r * time)) if r.size else 0.0
    correlated = abs(correlation) >= _CORRELATED and turn >= _TURN
    steady = correlated and abs(correlation) >= _STEADY
    certain = abs(gain) > SIGNIFICANT * error and not (steady and gain * correlation < 0.0)
    shown = certain or correlated
    side = ("starboard" if (gain if certain else correlation) > 0.0 else "port") if shown else ""
    return RudderEffect(gain, error, correlation, side)


def rudder_middle(trial: xr.Dataset) -> float:
    """Reading [deg] about which the rudder turns the ship, where that is far from 0: a raw signal; else 0.

    Nomoto's equation with a cubic term and an unknown zero of the rudder.
    """
    turning = _with_turning(trial)
    if turning is None:
        return 0.0
    _, delta, r, acceleration = _yaw_blocks(turning, ship_scale(turning, None))
    columns = [delta, np.ones_like(delta), r, r * np.abs(r)]
    (gain, constant, *_), (error, *_), _ = least_squares(columns, acceleration)
    if abs(gain) <= _HINT * error:
        return 0.0
    low, high = np.quantile(trial["delta"].values, [0.05, 0.95])
    middle, is_one_sided = -constant / gain, low * high > 0.0
    return float(np.rad2deg(middle)) if is_one_sided and low < middle < high else 0.0


def raw_signal_text(middle: float) -> str:
    """What a rudder that moves about a middle [deg] is."""
    return f"delta moves about {middle:.3g} deg as read, not about 0: it is probably a raw signal (V, mA, counts)"


def _yaw_blocks(trial: xr.Dataset, scale: ShipScale) -> tuple[np.ndarray, ...]:
    """Length [s] of blocks, mean rudder angle and yaw rate in them, and the yaw acceleration, each (n_blocks - 1,)."""
    blocks = ship_blocks(trial, scale, _BLOCK)
    time = blocks.increments(trial["time"].values)
    delta, r = (blocks.middles(trial[name].values) for name in ("delta", "r"))
    return time, delta, r, blocks.increments(trial["r"].values) / time


def _lagged_correlation(delta: np.ndarray, r: np.ndarray, longest: int) -> float:
    """Largest correlation about zero, up to a lag of ``longest`` blocks of the yaw rate behind the rudder."""
    correlations = [0.0]
    for lag in range(min(longest, r.size - 2) + 1):
        ahead, behind = delta[: delta.size - lag], r[lag:]
        size = np.sqrt(np.sum(ahead**2) * np.sum(behind**2))
        correlations.append(float(np.sum(ahead * behind) / size) if size > 0.0 else 0.0)
    return max(correlations, key=abs)


def with_rudder_side(trial: xr.Dataset, stated: str, where: str) -> xr.Dataset:
    """Trial whose positive delta turns the ship to port, with a line in ``attrs["reading"]`` on a change.

    ``stated`` is the side of the file, or "auto" for that of the record; TrialError if the record does not show it.
    """
    if "delta" not in trial or not trial["delta"].values.any():
        return trial
    notes = trial.attrs["reading"].splitlines()
    side, why = stated, "the file counts it positive to starboard"
    if stated == "auto":
        effect = shown_effect(trial)
        if effect is None or not effect.side:
            if middle := rudder_middle(trial):
                raise TrialError(f"{where}: {raw_signal_text(middle)}; write the rudder angle into its column.")
            raise TrialError(
                f"{where}: the side that a positive rudder turns to must be stated, {_hidden_by(trial, effect)}; "
                'state it in a format file: the line [frame], below it rudder_positive = "starboard" (or "port").'
            )
        side = effect.side
        why = f"the record turns to {side} for positive angles, {_evidence(effect)}"
        trial = trial.assign_attrs({FOUND: side})
    if side == "starboard":
        trial = trial.assign(delta=("time", -trial["delta"].values, trial["delta"].attrs))
        notes.append(f"delta changed in sign: {why}.")
    elif stated == "auto":
        notes.append(f"delta as in the file: {why}.")
    return trial.assign_attrs(reading="\n".join(notes))


def with_yaw_rate(trial: xr.Dataset) -> xr.Dataset:
    """Trial with the rate of the heading where no yaw rate is recorded."""
    if "r" in trial or "psi" not in trial or trial.sizes["time"] < 3:
        return trial
    return trial.assign(r=("time", np.gradient(trial["psi"].values, trial["time"].values)))


def shown_effect(trial: xr.Dataset) -> RudderEffect | None:
    """Effect of the rudder, with the rate of the heading where no yaw rate is recorded; None for a short record."""
    turning = _with_turning(trial)
    return None if turning is None else rudder_effect(turning, ship_scale(turning, None))


def _with_turning(trial: xr.Dataset) -> xr.Dataset | None:
    """Trial with a yaw rate, of the heading where none is recorded; None without both, or for few samples."""
    trial = with_yaw_rate(trial)
    return trial if "r" in trial and trial.sizes["time"] >= _FEWEST_SAMPLES else None


def _evidence(effect: RudderEffect) -> str:
    if abs(effect.gain) > SIGNIFICANT * effect.error:
        return f"by {_standard_errors(effect):.0f} standard errors"
    return f"by a correlation of {abs(effect.correlation):.2f}"


def _standard_errors(effect: RudderEffect) -> float:
    """Effect of the rudder in standard errors, at most 999."""
    return min(abs(effect.gain) / max(effect.error, 1e-300), 999.0)


def _hidden_by(trial: xr.Dataset, effect: RudderEffect | None) -> str:
    """Reason for which a record does not show the side of its rudder."""
    if "r" not in trial and "psi" not in trial:
        return "since the record has no yaw rate and no heading"
    if np.ptp(trial["delta"].values) < _STILL:
        return f"since the rudder never moves from {np.rad2deg(trial['delta'].values[0]):.3g} deg"
    if effect is None:
        return f"since the record has {trial.sizes['time']} samples, fewer than {_FEWEST_SAMPLES}"
    errors = abs(effect.gain) / max(effect.error, 1e-300)
    return f"since the turn shows it by {errors:.2g} of {SIGNIFICANT:g} standard errors"


def check_one_side(trials: Mapping[str, xr.Dataset]) -> None:
    """Raise TrialError, which names the odd ones, unless the sides that the records showed agree."""
    sides = {name: trial.attrs[FOUND] for name, trial in trials.items() if FOUND in trial.attrs}
    groups = [[name for name, side in sides.items() if side == one] for one in ("port", "starboard")]
    if all(groups):
        odd = min(groups, key=len)
        most = "starboard" if odd is groups[0] else "port"
        raise TrialError(
            f"The files of one logger have one rudder sign, found positive angles that turn to {most}, but to "
            f"{sides[odd[0]]} in {', '.join(odd)}; check these, or state frame.rudder_positive in a format file."
        )


def shows_axes(columns: Mapping[str, Column], layout: TrialFormat) -> bool:
    """Whether the format or the headings show to which side heading and rate of turn are positive."""
    if layout.convention or layout.heading != "clockwise":
        return True
    names = {channel: plain_name(column.heading.split("[")[0]) for channel, column in columns.items()}
    if "psi" in columns and is_from_true_north(columns["psi"].heading):
        return True
    if names.get("psi") in _OF_THE_COMPASS or names.get("r") in _OF_THE_BRIDGE:
        return True
    earth = {names.get("x"), names.get("y")} & {*_OF_THE_EARTH} or {"latitude", "longitude", "cog"} & {*columns}
    return bool(earth) and "psi" in columns


def mirror_remarks(trials: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentence on the runs, by name, whose port and starboard rest on assumed axes."""
    runs = [name for name, trial in trials.items() if trial.attrs.get(AXES)]
    if not runs:
        return []
    which = f"Run {runs[0]} does" if len(runs) == 1 else f"Runs {', '.join(runs)} do"
    sides = 'port and starboard are those of convention = "ned"'
    return [f"{which} not show the axes of the file: {sides}, or the record is {MIRROR_IMAGE}."]


def letters_of(heading: str) -> tuple[str, Mapping[str, str]]:
    """Channel of a heading whose numbers may have letters beside them, and the sign by letter; empty for others."""
    return next(((one.name, _LETTERS[one.name]) for one in channels_of(heading) if one.name in _LETTERS), ("", {}))


def with_letters_beside(headings: Sequence[str], columns: Sequence[Cells]) -> tuple[list[str], list[Cells]]:
    """Headings and columns where letters in a column of their own, such as N and S, stand behind the numbers beside."""
    named, beside = list(headings), list(columns)
    for k, heading in enumerate(headings):
        cells = beside[k]
        if isinstance(cells, Numbers) or next(filter(None, map(_letter, cells)), "") not in _SIDES:
            continue
        letters = {*map(_letter, cells)} - {""}
        sided = [j for j, name in enumerate(named) if letters <= letters_of(name)[1].keys()]
        word = plain_name(heading).split(" ")[0]
        targets = [j for j in sided if word and name_and_unit(named[j])[0].startswith(word)]
        is_beside = not _BESIDE.isdisjoint(re.split(r"\W+", plain_name(heading)))
        targets += [j for j in (k - 1, k + 1) if j in sided and is_beside]
        numbers = texts_of(beside[targets[0]]) if targets else []
        if targets and (letters <= _NORTH or not any(number.strip().startswith("-") for number in numbers)):
            named[k] = ""
            pairs = zip(numbers, cells, strict=True)
            beside[targets[0]] = [f"{number} {letter}" if number.strip() else "" for number, letter in pairs]
    return named, beside


def _letter(cell: str) -> str:
    return cell.strip().upper()


class BareNumbers(NamedTuple):
    """Cells of a column without units and letters, its unit, sentences, and what the letters state, by key."""

    cells: list[str]
    unit: str
    stated: dict[str, str]
    notes: list[str]


def bare_numbers(heading: str, unit: str, column: Cells) -> BareNumbers | None:
    """Numbers of a column with a unit, or the letter of a side, beside each of them; None for another column."""
    if isinstance(column, Numbers):
        return None
    channel, signs = letters_of(heading)
    first = next((cell for cell in column if cell.strip().lower() not in MISSING_CELLS), "")
    text = "".join(column) if signs else first
    if not _NO_NUMBER.search(text) or not _LETTER.search(text):
        return None
    cells, notes = [cell.strip() for cell in column], []
    degrees = [_decimal_degrees(cell) for cell in cells] if channel in ("latitude", "longitude") else cells
    if degrees != cells:
        cells, unit, notes = degrees, unit or "deg", [f"{heading}: degrees and minutes of each position read."]
    found = [_NUMBER_AND_WORD.fullmatch(cell) for cell in cells]
    words = {_word(one) for one in found if one} - {""}
    letters, stated = {word.upper() for word in words}, unit or name_and_unit(heading)[1]
    sided = letters <= signs.keys() and not letters >= _LETTERS["wind_direction"].keys()
    same_unit = len(words) == 1 and all(is_unit(word) and stated in (None, word) for word in words)
    bare = [_bare(one, signs, sided) if one else "" for one in found]
    whole = all(one or cell.lower() in MISSING_CELLS for one, cell in zip(bare, cells, strict=True))
    if not words or not whole or not (sided or same_unit):
        return BareNumbers(cells, unit, {}, notes) if notes and not words else None
    unit = unit or (words.pop() if not sided else "" if "P" in signs else "deg")
    seen = " and ".join(sorted(letters) if letters <= _NORTH else [*signs][:2])
    notes.append(f"{heading}: {seen if sided else unit} behind each number read.")
    return BareNumbers(bare, *_meaning(channel, {letter[0] for letter in letters} if sided else set(), unit), notes)


def _meaning(channel: str, letters: Set[str], unit: str) -> tuple[str, dict[str, str]]:
    """Unit of the numbers of a channel beside these letters, and what the letters state, by key."""
    if channel == "delta" and letters:
        return unit, {"rudder_positive": "starboard"}
    if channel == "wind_direction" and "R" in letters:
        return unit, {"wind": "relative"}
    return MAGNETIC if "M" in letters else unit, {}


def with_minutes(columns: dict[str, Column], table: Sequence[Cells]) -> tuple[dict[str, Column], list[str]]:
    """Columns of positions that have degrees and minutes in one number, as most are none in degrees; a sentence."""
    pair = [columns[name] for name in ("latitude", "longitude") if name in columns]
    if len(pair) < 2 or any(one.code != Column.code or one.factor == 1.0 for one in pair):
        return columns, []
    angles = np.abs([_with_decimal_points(table[one.index]) for one in pair])
    angles = angles[:, np.isfinite(angles).all(axis=0)]
    if not angles.size or (np.median(angles, axis=1) <= [90.0, 360.0]).all() or (angles % 100.0 >= 60.0).any():
        return columns, []
    note = f"{' and '.join(one.heading for one in pair)}: degrees and minutes in one number (ddmm.mmmm) read."
    return columns | {one.channel: replace(one, code="ddmm") for one in pair}, [note]


def _with_decimal_points(cells: Cells) -> np.ndarray:
    """Numbers of cells with points or commas, NaN for text."""
    if isinstance(cells, Numbers):
        return cells.values
    return np.array(cell_numbers([cell.replace(",", ".") for cell in cells]), dtype=float)  # None is NaN


def _word(matched: re.Match[str]) -> str:
    """Unit or letter beside a number; ``deg`` for the sign of degrees."""
    before, _, behind = matched.groups("")
    return before or behind.strip("° ") or behind.strip().replace("°", "deg")


def _bare(matched: re.Match[str], signs: Mapping[str, str], sided: bool) -> str:
    """Number of a cell with the sign of its side; empty if it has no unit or letter and is not amidships."""
    word, number = _word(matched), matched[2]
    if not word:
        return number if "P" in signs and sided and not number.strip("+-0.,") else ""
    return (signs[word.upper()] if sided else "") + number


def _decimal_degrees(cell: str) -> str:
    """Text of a position in degrees and minutes, perhaps seconds, as decimal degrees with its letter; others as is."""
    matched = _MINUTES.fullmatch(cell)
    if not matched:
        return cell
    part = matched.groupdict("")
    minutes, seconds = (float(part[name].replace(",", ".") or 0.0) for name in ("minutes", "seconds"))
    degrees = int(part["degrees"]) + minutes / 60.0 + seconds / 3600.0
    number = f"{part['sign']}{degrees:.10f}{part['before'] or part['behind']}"
    return number.replace(".", ",") if "," in cell else number
