"""Trial files with random damage, for the fuzz of the reader."""

from __future__ import annotations

import gzip
from contextlib import suppress

import numpy as np

CELLS = (
    "",
    "nan",
    "-",
    "1e999",
    "-inf",
    "1e300",
    "1e-320",
    "x",
    "1_0",
    "0x1f",
    "12:01:05",
    "1,5",
    '"',
    "٣",
    "#",
    "\x00",
)
HEADINGS = ("time", "u", "U kn", "Heading (deg)", "psi [grad]", "rudder", "r_deg/s", "n [rpm]", "", "x [N]", "t [ms]")


def swapped(rng, lines):
    i, j = rng.integers(0, len(lines), 2)
    lines[i], lines[j] = lines[j], lines[i]
    return lines


def dropped(rng, lines):
    begin = rng.integers(0, len(lines))
    return lines[:begin] + lines[begin + rng.integers(1, 40) :]


def duplicated(rng, lines):
    begin = rng.integers(0, len(lines))
    end = begin + rng.integers(1, 20)
    return lines[:end] + lines[begin:]


def other_cell(rng, lines):
    i = rng.integers(0, len(lines))
    cells = lines[i].split(",")
    cells[rng.integers(0, len(cells))] = str(rng.choice(CELLS))
    lines[i] = ",".join(cells)
    return lines


def emptied_cells(rng, lines):
    column, begin = rng.integers(0, 8), rng.integers(1, len(lines) + 1)
    for i in range(begin, min(len(lines), begin + rng.integers(1, 60))):
        cells = lines[i].split(",")
        if column < len(cells):
            cells[column] = ""
        lines[i] = ",".join(cells)
    return lines


def other_heading(rng, lines):
    cells = lines[0].split(",")
    cells[rng.integers(0, len(cells))] = str(rng.choice(HEADINGS))
    return [",".join(cells), *lines[1:]]


def other_delimiter(rng, lines):
    begin = rng.integers(0, len(lines)) if rng.random() < 0.3 else 0
    delimiter = str(rng.choice([";", "\t", " ", "|", ", ", ",,"]))
    return lines[:begin] + [line.replace(",", delimiter) for line in lines[begin:]]


def decimal_commas(rng, lines):
    return [line.replace(",", ";").replace(".", ",") for line in lines]


def rounded_time(rng, lines):
    digits = rng.integers(1, 6)
    for i in range(1, len(lines)):
        time, *cells = lines[i].split(",")
        with suppress(ValueError):
            lines[i] = ",".join([f"{float(time):.{digits}g}", *cells])
    return lines


def unit_row(rng, lines):
    units = rng.choice(["s", "deg", "[m/s]", "kn", "-", "", "furlong"], lines[0].count(",") + 1)
    return [lines[0], ",".join(units.tolist()), *lines[1:]]


def restarted(rng, lines):
    return lines + lines[1 : rng.integers(2, len(lines) + 2)]


ON_LINES = (
    swapped,
    dropped,
    duplicated,
    other_cell,
    emptied_cells,
    other_heading,
    other_delimiter,
    decimal_commas,
    rounded_time,
    unit_row,
    restarted,
)


def flipped_bytes(rng, raw):
    spoilt = np.frombuffer(raw, dtype=np.uint8).copy()
    places = rng.integers(0, spoilt.size, rng.integers(1, 4))
    spoilt[places] ^= (1 << rng.integers(0, 8, places.size)).astype(np.uint8)
    return spoilt.tobytes()


def mutated(text, rng):
    """Bytes of a file: one to three kinds of damage to the lines, then to its bytes, plain or gzip."""
    lines = text.splitlines()
    for mutate in rng.choice(np.array(ON_LINES, dtype=object), rng.integers(0, 4)):
        lines = mutate(rng, lines) or [""]
    raw = ("\r\n" if rng.random() < 0.1 else "\n").join(lines).encode()
    compressed = rng.random() < 0.2
    if compressed:
        raw = gzip.compress(raw, 1)
    if raw and rng.random() < 0.25:
        raw = raw[: rng.integers(0, len(raw)) + 1]
    if raw and rng.random() < 0.3:
        raw = flipped_bytes(rng, raw)
    return raw
