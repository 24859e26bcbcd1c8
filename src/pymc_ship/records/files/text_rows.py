"""Lines of a text file as a table, block by block and thinned where they are many; logs of NMEA 0183 as tables."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from functools import reduce
from itertools import accumulate, batched, chain
from operator import xor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.clock import stamp_parts, thinning
from pymc_ship.records.files.columns import OF_CLOCK, channels_of, is_unit
from pymc_ship.records.files.format import TrialFormat
from pymc_ship.records.files.tables import check_size
from pymc_ship.trial.cells import Cells, end_to_end, number_columns, plain_text
from pymc_ship.trial.thinning import rows_for_one, thinned, thinning_note
from pymc_ship.trial.units import KNOT

_COMMENTS = ("#", "%")
_FEWEST_LINES, _MOST_TITLES = 4, 200  # lines of a table that have titles before the header, and the most of these
_LAST_LINES = 8  # that show how wide the rows are
_LONGEST_HEADING = 100  # letters
_BLOCK = 10_000  # rows whose cells are text at a time
_OPEN_QUOTE = re.compile(r'(?:^|[,;\t])"[^"]*$')  # of a cell that goes on in the next line
_BEGIN_OF_STAMP = re.compile(r"\s*\d+[-:/.]\d")
_DATE_AND_TIME = re.compile(r"(\d[-/.]\d+) +(\d+:\d)")  # of one heading, in columns between white space
_LINE_END = re.compile(r"\r\n|\n|\r")
AROUND_UNITS = " []{}()-"
"""Marks that stand around a unit of a row of units."""


class TextRows(NamedTuple):
    """Headings, units, columns and line numbers of the rows of a text file, its comments, and sentences.

    ``every``: rows of which one is left.
    """

    headings: list[str]
    units: list[str]
    columns: list[Cells]
    lines: np.ndarray
    comments: list[str]
    notes: list[str]
    every: int


class _Header(NamedTuple):
    """Line of headings with the delimiter, the cells of the line below, and the lines that may be repeated.

    ``titles``: number of lines before it; ``parted``: whether a blank parts the date from the time of a stamp.
    """

    line: str
    delimiter: str
    below: list[str]
    heads: list[str]
    titles: int
    parted: bool


class _Rows(NamedTuple):
    """Rows with the numbers of their lines; the widths also of empty ones, negative; the number of repeated headers."""

    texts: list[str]
    lines: np.ndarray
    widths: np.ndarray
    repeated: int


def line_blocks(texts: Iterable[str]) -> Iterator[list[str]]:
    """Lines of each block of a text; a quoted heading of the first one is in one line."""
    for k, text in enumerate(texts):
        lines = _LINE_END.split(plain_text(text))
        lines = lines if lines[-1] else lines[:-1]
        yield lines if k else _unbroken(lines)


def text_rows(blocks: Iterable[list[str]], n_lines: int, layout: TrialFormat, path: Path, *, whole: bool) -> TextRows:
    """Headings and columns of a file of so many lines, of which a block is in memory at a time.

    A long file is thinned. ``whole``: whether the first block is the only one. TrialError for lines that are no table.
    """
    blocks = iter(blocks)
    lines = next(blocks)
    content, comments = _content(lines, layout.skip_rows)
    header, content = _header(lines, content, layout, path)
    n_rows = (content.size if whole else n_lines) - len(header.heads)
    every = rows_for_one(n_rows, len(header.below), whole)
    check_size(path, [n_rows] * len(header.below), every)
    first = _rows_of(lines, content[len(header.heads) :], 1, header)
    headings = _headings(header.line, header.delimiter, max(len(header.below), np.abs(first.widths).max(initial=0)))
    units = [cell.strip(AROUND_UNITS) for cell in header.below] if len(header.heads) > 1 else []
    units += [""] * (len(headings) - len(units))
    plan = thinning(headings, layout.columns, every)
    notes = [f"{header.titles} lines before the header left out."] if header.titles else []
    pieces, numbers = [], []
    parts = chain([first], _later_rows(blocks, len(lines), header))
    for texts, rows in _whole_rows(parts, len(headings), header.delimiter, every, notes, path):
        pieces.append(thinned(_cells(texts, header.delimiter, headings), plan))
        numbers.append(rows[every // 2 :: every])
    columns = [end_to_end(cells) for cells in zip(*pieces, strict=True)]
    return TextRows(headings, units, columns, np.concatenate(numbers), comments=comments, notes=notes, every=every)


def _header(lines: list[str], content: np.ndarray, layout: TrialFormat, path: Path) -> tuple[_Header, np.ndarray]:
    """Header of the lines with content, and those from it on; TrialError without one, or without two rows."""
    begin, ends = ([lines[k] for k in some] for some in (content[:_MOST_TITLES], content[-_LAST_LINES:]))
    titles = _titles(begin, ends, layout.delimiter or "")
    content = content[titles:]
    line = lines[content[0]] if content.size else ""
    if content.size and all(map(is_number, cells_of_line(line, _delimiter(line)))):
        raise TrialError(
            f"{path}, line {content[0] + 1}: a trial has a header before its numbers, found "
            f"{line.strip()[:60]!r}; add a line such as time [s], u [kn], psi [deg]."
        )
    if content.size < 3:
        raise TrialError(f"{path}: a trial has a header and at least two rows, found {content.size} lines; check it.")
    delimiter = layout.delimiter or _delimiter(line)
    parted = delimiter == " " and len(lines[content[-1]].split()) == len(line.split()) + 1
    below, second = (cells_of_line(_joined_stamps(lines[k], parted), delimiter) for k in content[1:3])
    n_heads = 2 if is_unit_row(below) else 1
    if n_heads == 1 and is_unit_row(second) and not any(map(is_number, below)):  # words between headings and units
        below, n_heads = second, 3
    heads = [_joined_stamps(lines[k], parted).strip() for k in content[:n_heads]]
    return _Header(_joined_stamps(line, parted), delimiter, below, heads, titles, parted), content


def _joined_stamps(line: str, parted: bool) -> str:
    """Line whose dates and times are one stamp."""
    return _DATE_AND_TIME.sub(r"\1T\2", line) if parted else line


def _rows_of(lines: Sequence[str], at: np.ndarray, number: int, header: _Header) -> _Rows:
    """Rows at some lines of a block, the first line of which has this number in the file."""
    lines = [_joined_stamps(line, True) for line in lines] if header.parted else lines
    body = [k for k in at.tolist() if lines[k].strip() not in header.heads]
    widths = np.array([_width(cells_of_line(lines[k], header.delimiter)) for k in body], dtype=int)
    filled = np.array(body, dtype=int)[widths > 0]
    texts = [lines[k] for k in filled.tolist()]
    return _Rows(texts, filled + number, widths, at.size - len(body))


def _later_rows(blocks: Iterable[list[str]], n_lines: int, header: _Header) -> Iterator[_Rows]:
    """Rows of the blocks after the first ``n_lines`` lines of a file."""
    for lines in blocks:
        content = np.flatnonzero([_kind(line) == 1 for line in lines])
        yield _rows_of(lines, content, n_lines + 1, header)
        n_lines += len(lines)


def _whole_rows(
    parts: Iterable[_Rows], n: int, delimiter: str, every: int, notes: list[str], path: Path
) -> Iterator[tuple[list[str], np.ndarray]]:
    """Rows with a cell for each of n headings and their lines, without an incomplete last one, multiples of ``every``.

    Appends sentences on what is left out, and on the thinning. TrialError for a row of another width.
    """
    texts: list[str] = []
    numbers, rows, counts, broken = np.zeros(0, dtype=int), 0, Counter[str](), []
    for part, is_last in _with_last(parts):
        widths = part.widths[part.widths > 0]
        counts.update(header=part.repeated, empty=int((part.widths < 0).sum()))
        if is_last and widths.size and widths[-1] < n:
            last = f"Line {part.lines[-1]}, the last, left out: it breaks off after {widths[-1]} of {n} columns."
            part, widths, broken = part._replace(texts=part.texts[:-1], lines=part.lines[:-1]), widths[:-1], [last]
        _check_widths(part, widths, n, delimiter, path)
        texts, numbers = [*texts, *part.texts], np.append(numbers, part.lines)
        rows += len(part.texts)
        if is_last and rows // every < 2:
            raise TrialError(f"{path}: a trial has a header and at least two rows, found {rows} complete; check it.")
        size = len(texts) // every * every
        if size:
            yield texts[:size], numbers[:size]
        texts, numbers = texts[size:], numbers[size:]
    again, empty = counts["header"], counts["empty"]
    notes += [f"The header is repeated {again} times: these lines left out."] if again else []
    notes += [f"{empty} empty rows left out."] if empty else []
    notes += [*broken, *([thinning_note(rows, every)] if every > 1 else [])]


def _with_last(parts: Iterable[_Rows]) -> Iterator[tuple[_Rows, bool]]:
    """Parts, and whether each is the last."""
    parts = iter(parts)
    part = next(parts)
    for following in parts:
        yield part, False
        part = following
    yield part, True


def _check_widths(part: _Rows, widths: np.ndarray, n: int, delimiter: str, path: Path) -> None:
    """Raise TrialError for a row of fewer cells than n, or with more that are filled."""
    for k in np.flatnonzero(widths != n):
        if widths[k] < n or any(map(str.strip, cells_of_line(part.texts[k], delimiter)[n:])):
            raise TrialError(
                f"{path}, line {part.lines[k]}: the header has {n} columns, found {widths[k]}; mend it, or state how "
                "many lines stand before the header, skip_rows, in a format file."
            )


def _cells(texts: Sequence[str], delimiter: str, headings: Sequence[str]) -> list[Cells]:
    """Cells of each column of some rows; parts of a stamp are text, whose zeros count."""
    parts = stamp_parts(headings)
    rows = (cells_of_line(text, delimiter) for text in texts)
    blocks = (list(zip(*block, strict=False)) for block in batched(rows, _BLOCK))
    numbers = number_columns(blocks, [k for k in range(len(headings)) if k not in parts])
    columns: dict[int, list[str]] = {k: [] for k in range(len(headings)) if k not in numbers}
    for text in texts if columns else ():
        row = cells_of_line(text, delimiter)
        for k, cells in columns.items():
            cells.append(row[k])
    return [numbers[k] if k in numbers else columns[k] for k in range(len(headings))]


def _content(lines: list[str], skipped: int) -> tuple[np.ndarray, list[str]]:
    """Lines with the header first, and comments; the header may be the last comment, whose mark is then taken off."""
    kinds = np.array([k >= skipped and _kind(line) for k, line in enumerate(lines)], dtype=int)
    content, comments = np.flatnonzero(kinds == 1), np.flatnonzero(kinds == 2)
    texts = [lines[k] for k in comments]
    begin = lines[content[0]] if content.size else ""
    first = cells_of_line(begin, _delimiter(begin))[0] if begin else ""
    if is_number(first) or _BEGIN_OF_STAMP.match(first):
        before = comments[comments < content[0]][-1:]
        for k in before:
            lines[k] = lines[k].strip(" \t#%")
        content = np.append(before, content)
    return content, texts


def _kind(line: str) -> int:
    """0 for an empty line, 1 for content, 2 for a comment."""
    text = line.strip()
    return 0 if not text else 2 if text.startswith(_COMMENTS) else 1


def _unbroken(lines: list[str]) -> list[str]:
    """Lines with each quoted heading in one of them; those that it took are empty."""
    lines = list(lines)
    for k in [k for k, line in enumerate(lines[:_MOST_TITLES]) if _OPEN_QUOTE.search(line)]:
        quotes = accumulate(line.count('"') for line in lines[k : k + _MOST_TITLES])
        last = k + next((more for more, count in enumerate(quotes) if count % 2 == 0), 0)
        taken = lines[k + 1 : last + 1]
        if not any(is_number(cells_of_line(line, _delimiter(line))[0]) for line in taken if line.strip()):
            lines[k : last + 1] = [" ".join([lines[k], *taken]), *[""] * len(taken)]
    return lines


def _titles(begin: Sequence[str], ends: Sequence[str], delimiter: str) -> int:
    """Number of lines before the header, which is filled, of words, and as wide as most rows at the end of the file."""
    mark = delimiter or Counter(map(_delimiter, ends)).most_common(1)[0][0] if ends else " "
    width, rows = Counter(len(cells_of_line(line, mark)) for line in ends).most_common(1)[0] if ends else (0, 0)
    if mark == " " or len(begin) < _FEWEST_LINES or rows <= 0.5 * len(ends):
        return 0
    for titles, line in enumerate(begin):
        cells = cells_of_line(line, mark)
        if len(cells) == width and sum(map(bool, map(str.strip, cells))) > 0.5 * width:
            return 0 if is_unit_row(cells) or any(map(is_number, cells)) else titles
    return 0


def _delimiter(header: str) -> str:
    plain = re.sub(r"\[[^\[\]]*\]|\([^()]*\)", "", header)
    return next((delimiter for delimiter in (";", "\t", ",") if delimiter in plain), " ")


def cells_of_line(line: str, delimiter: str) -> list[str]:
    """Cells between delimiters, or between white space for a blank."""
    if delimiter == " ":
        return line.split()
    if '"' in line:
        with suppress(csv.Error, StopIteration):
            return next(csv.reader([line], delimiter=delimiter))
    return line.split(delimiter)


def _width(cells: Sequence[str]) -> int:
    """Number of cells, negative for an empty row."""
    return len(cells) if any(map(str.strip, cells)) else -len(cells)


def _headings(line: str, delimiter: str, n_cells: int) -> list[str]:
    """Names in the header, but for a last one without cells, such as remarks, in rows of ``n_cells`` at most.

    In a table with white space a bracketed unit belongs to the name before it.
    """
    if delimiter != " ":
        headings = [heading.strip() for heading in cells_of_line(line, delimiter)]
    else:
        joined = re.sub(r"(?<!\s)\s+([\[(])", r"\1", line.strip())
        headings = joined.split()
        if len(headings) != n_cells:
            headings = re.split(r"\s{2,}|\t", joined)
    while headings and not headings[-1]:
        headings.pop()
    if len(headings) == n_cells + 1 and any(map(channels_of, headings)) and not channels_of(headings[-1]):
        headings.pop()
    return [*map(plain_heading, headings)]


def plain_heading(text: str) -> str:
    """First letters of a heading, those that are not printed replaced."""
    plain = re.sub(r"\s", " ", plain_text(text[:_LONGEST_HEADING]))
    return "".join(letter if letter.isprintable() else "?" for letter in plain)


def is_unit_row(cells: list[str]) -> bool:
    """Whether the cells of a row are units."""
    if not any(map(is_unit, cells)) or any(map(is_number, cells)):
        return False
    named = [cell for cell in cells if channels_of(cell) and not is_unit(cell)]
    return all(OF_CLOCK.fullmatch(cell.strip(AROUND_UNITS)) for cell in named)


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a point or a comma."""
    try:
        float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True


_BEFORE = " ,;\t[]"  # about the stamp of a logger, which stands before a sentence
_TAGS = re.compile(r"\\(?:[^\\]*\bc:(\d+))?[^\\]*\\")  # tag block of IEC 61162-450, with its clock if it has one
_SENTENCE = re.compile(r"[$!](P[A-Z0-9]{2,}|[A-Z]{5}),")
_NMEA = {  # unit, and type and fields of the sentences of each quantity, the first choice first
    "psi": (
        "deg",
        (
            ("HDT", "heading"),
            ("THS", "heading"),
            ("HDG", "true heading"),
            ("VHW", "heading_true"),
            ("HDG", "magnetic heading"),
            ("HDM", "magnetic heading"),
        ),
    ),
    "r": ("deg/min", (("ROT", "rate_of_turn"),)),
    "delta": ("deg", (("RSA", "rsa_starboard"), ("RSA", "rsa_port"))),
    "phi": ("deg", (("XDR", "roll"),)),
    "u": ("kn", (("VBW", "lon_water_spd"), ("VHW", "water_speed_knots"))),
    "v": ("kn", (("VBW", "trans_water_spd"),)),
    "sog": ("kn", (("VTG", "spd_over_grnd_kts"), ("RMC", "spd_over_grnd"))),
    "cog": ("deg", (("VTG", "true_track"), ("RMC", "true_course"))),
    "latitude": ("deg", (("GGA", "latitude"), ("RMC", "latitude"), ("GLL", "latitude"))),
    "longitude": ("deg", (("GGA", "longitude"), ("RMC", "longitude"), ("GLL", "longitude"))),
    "n": ("rpm", (("RPM", "speed"),)),
    "wind_speed": ("kn", (("MWD", "true speed"), ("MWV", "relative speed"))),
    "wind_direction": ("deg", (("MWD", "direction_true"), ("MWV", "relative angle"))),
}
_STATUS = {"rsa_starboard": "rsa_starboard_status", "rsa_port": "rsa_port_status"}
_STATUS |= dict.fromkeys(("lon_water_spd", "trans_water_spd"), "data_validity_water_spd")
_FIELDS_OF_THS = (("Heading", "heading"), ("Mode", "status"))
_KNOTS = {"N": 1.0, "M": 1.0 / KNOT, "K": 1.0 / 3.6 / KNOT}  # by unit of a wind speed
_ROLL = ("ROLL", "HEEL")  # names of a transducer


def _true_heading(message: Any) -> float:
    """Magnetic heading plus deviation and variation, easterly positive; TypeError without the variation."""
    deviation = float(message.deviation or 0.0) * (-1.0 if message.dev_dir == "W" else 1.0)
    return float(message.heading) + deviation + float(message.variation) * (-1.0 if message.var_dir == "W" else 1.0)


def _roll(message: Any) -> float | None:
    """Angle [deg] of the first transducer of roll."""
    sensors = map(message.get_transducer, range(message.num_transducers))
    return next((float(one.value) for one in sensors if one.type == "A" and one.id.strip().upper() in _ROLL), None)


def _true_wind_speed(message: Any) -> float | None:
    """Speed [kn] beside a direction from true north."""
    if message.direction_true is None:
        return None
    knots = message.wind_speed_knots
    return float(message.wind_speed_meters) / KNOT if knots is None else float(knots)


def _relative_wind_speed(message: Any) -> float | None:
    return float(message.wind_speed) * _KNOTS[message.wind_speed_units] if message.reference == "R" else None


_CALCULATED: Mapping[str, Callable[[Any], Any]] = {
    "true heading": _true_heading,
    "magnetic heading": lambda message: f"{float(message.heading)} M",
    "roll": _roll,
    "true speed": _true_wind_speed,
    "relative speed": _relative_wind_speed,
    "relative angle": lambda message: f"{float(message.wind_angle)} R" if message.reference == "R" else "",
}
"""Value of what is no field of its own; M and R are the letters of a magnetic heading and a relative wind."""
_SHORTEST_LOG = 0.5  # fraction of the first lines that are sentences


def nmea_columns(lines: Sequence[str], path: Path) -> tuple[dict[str, list[str]], dict[str, str], list[str]] | None:
    """Cells and units by heading of a log of NMEA 0183, with sentences; None for another text.

    The time is the stamp of the logger before each sentence, or the last UTC of one sensor. A sensor has one column.
    """
    first = [line for line in lines[:200] if line.strip()][:50]
    if sum(bool(_SENTENCE.search(line)) for line in first) <= _SHORTEST_LOG * len(first):
        return None
    summed = sum("*" in line for line in first) > _SHORTEST_LOG * len(first)
    readings, unread, damaged = _sentences(lines, path, summed)
    logger = sum(bool(stamp) for stamp, _ in readings) > 0.5 * len(readings)
    messages = [message for _, message in readings]
    sources, notes = _sensors(messages, unread)
    clocks = [stamp for stamp, _ in readings] if logger else _clocks(messages, sources.get("latitude", ("", ""))[0][:2])
    rows: list[dict[str, str]] = []
    for time, message in zip(clocks, messages, strict=True):
        cells = {name: _field(message, of) for name, (sensor, of) in sources.items() if sensor == _sensor(message)}
        cells = {name: cell for name, cell in cells.items() if cell}
        if not time or not cells:
            continue
        if rows and rows[-1]["time"] == time and not cells.keys() & rows[-1].keys():
            rows[-1] |= cells
        else:
            rows.append({"time": time, **cells})
    notes += [f"{damaged} damaged sentences left out."] if damaged else []
    notes += [] if summed else ["The sentences have no checksum, which would show damaged ones."]
    columns = {name: [row.get(name, "") for row in rows] for name in ("time", *sources)}
    return columns, {name: _NMEA[name][0] for name in sources}, notes


def _sentences(lines: Sequence[str], path: Path, summed: bool) -> tuple[list[tuple[str, Any]], set[str], int]:
    """Messages with the stamps before them, kinds of whole sentences that are not read, number of damaged ones."""
    try:
        import pynmea2
    except ImportError:
        raise TrialError(f"{path}: NMEA 0183 needs pynmea2, found none; pip install 'pymc-ship[formats]'.") from None
    type("THS", (pynmea2.TalkerSentence,), {"fields": _FIELDS_OF_THS})  # it lacks this one
    readings, unread, damaged = [], set(), 0
    for line in lines:
        matched = _SENTENCE.search(line)
        text = line[matched.start() :].strip() if matched else ""
        try:
            message = pynmea2.parse(text, check=summed) if matched else None
            whole = True
        except (pynmea2.ParseError, ValueError, TypeError) as error:
            message, whole = None, _is_whole(text) if summed else isinstance(error, pynmea2.SentenceTypeError)
        if matched and hasattr(message, "talker"):
            readings.append((_TAGS.sub(r"\1", line[: matched.start()]).strip(_BEFORE), message))
        elif matched and whole:
            unread.add(matched[1])
        else:
            damaged += bool(line.strip())
    return readings, unread, damaged


def _is_whole(sentence: str) -> bool:
    """Whether the checksum of a sentence is that of its letters."""
    body, _, stated = sentence[1:].partition("*")
    return stated[:2].upper() == f"{reduce(xor, body.encode(), 0):02X}"


def _clocks(messages: Sequence[Any], talker: str) -> list[str]:
    """UTC at each message, never backwards: of the sensor of a talker that shows most stamps before its others do."""
    stamps, clocks, clock = [], [], ""
    for message in messages:
        stamps.append("")
        with suppress(AttributeError, ValueError, TypeError):
            stamps[-1] = f"{message.timestamp:%H:%M:%S.%f}" if message.timestamp else ""
    given = [(stamp, _sensor(message)) for stamp, message in zip(stamps, messages, strict=True) if stamp]
    given = [(stamp, sensor) for stamp, sensor in given if sensor.startswith(talker)] or given
    most, firsts = Counter(sensor for _, sensor in given), Counter(dict(reversed(given)).values())
    usual = [sensor for sensor in most if most[sensor] > 0.5 * max(most.values())]
    sensor = max(usual, key=lambda one: firsts[one], default="")
    for stamp, message in zip(stamps, messages, strict=True):
        if stamp and _sensor(message) == sensor and (stamp > clock or (clock[:2], stamp[:2]) == ("23", "00")):
            clock = stamp
        clocks.append(clock)
    return clocks


def _sensor(message: Any) -> str:
    """Name of a sensor: talker, type, and for revolutions source and number."""
    more = f" {message.source}{message.engine_no}" if message.sentence_type == "RPM" else ""
    return f"{message.talker}{message.sentence_type}{more}"


def _sensors(messages: Sequence[Any], unread: Set[str]) -> tuple[dict[str, tuple[str, str]], list[str]]:
    """Sensor and field of each quantity, and a sentence on the sensors that are not used."""
    sources = {}
    for name, (_, choices) in _NMEA.items():
        for kind, of in choices:
            given = [message for message in messages if message.sentence_type == kind and _field(message, of)]
            if known := Counter(map(_sensor, given)):
                sources[name] = (max(known, key=lambda sensor: (" E" not in sensor, known[sensor])), of)
                break
    used = {sensor for sensor, _ in sources.values()}
    unused = sorted({*map(_sensor, messages), *unread} - used)
    notes = ["NMEA 0183: " + ", ".join(f"{name} of {sensor}" for name, (sensor, _) in sources.items()) + "."]
    notes += [f"Sensors left out: {', '.join(unused)}."] if unused else []
    if " E" in sources.get("n", ("", ""))[0]:
        notes.append("RPM has an engine alone: n is its speed, which a gear may change.")
    if sources.get("delta", ("", ""))[1] == "rsa_port":
        notes.append("RSA has a port rudder alone: delta is that one.")
    elif any(message.sentence_type == "RSA" and _field(message, "rsa_port") for message in messages):
        notes.append("RSA has a port rudder, which is left out: delta is the starboard one.")
    return sources, notes


def _field(message: Any, name: str) -> str:
    """Number of a field as text; empty if it is missing or declared invalid."""
    status = _STATUS.get(name, "status")
    is_fix = getattr(message, "lat", "") and str(getattr(message, "gps_qual", "1")) != "0"
    modes = {getattr(message, key, "") for key in ("faa_mode", "mode_indicator")}
    if str(getattr(message, status, "A") or "A") == "V" or "N" in modes or (name.endswith("itude") and not is_fix):
        return ""
    try:
        value = _CALCULATED[name](message) if name in _CALCULATED else getattr(message, name, "")
        return value if isinstance(value, str) and value[-1:] in "MR" else repr(float(value))
    except (ValueError, TypeError, KeyError, AttributeError):
        return ""
