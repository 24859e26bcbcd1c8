"""Damaged trial files of every format: ``python -m tests.records.files.file_fuzz [COUNT] [FIRST SEED]``.

Each file is read to a trial, or refused in one sentence, in a few seconds and in bounded memory. A process of its own
reads the files one after another, so that a crash or an endless loop is a fault of one file.
"""

from __future__ import annotations

import gzip
import io
import multiprocessing
import sys
import time
import traceback
import warnings
import zipfile
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import pymc_ship as ps
from pymc_ship.machine.memory import peak_memory
from pymc_ship.trial.record import check_trial
from tests.records.files.cases import columns, record
from tests.records.files.mutated import flipped_bytes, mutated
from tests.records.files.test_nmea import log
from tests.records.files.test_tables import WRITERS

LONGEST = 150.0  # s of one file, after which its reading counts as endless; more than the wait for a process of its own
MOST_SECONDS = 5.0  # of the processor, for one file
MOST_MEMORY = 3e8  # bytes that the reader may add to the peak of its process

KINDS = (*("run.csv", "run.txt.gz", "run.nmea", "run.parquet", "run.xlsx", "run.nc", "run73.mat") * 3, *WRITERS)
"""Format of each file in turn; MAT 5, which a process reads, least often."""

_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-320, 0.0, 1e9, 4294967295.0, -1.0)
_HEADINGS = ("time", "u", "psi [deg]", "", " ", "u [kn]", "Heading", "rudder", "lat", "lon", "sog [kn]", "t [ms]")
_LINES = (
    b"\x00",
    b"1," * 30_000,
    b"9" * 5_000,
    b'"' * 999,
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"[" * 5_000,
    "٣,ψ,\u2028\u0085\x0b".encode(),
    b"nan,inf,-inf,1e999,NaN,1e-320,0x1f",
    b"$GPGGA,,,,,,,,,,,,,,*56",
    b"$" + b"A" * 9_000,
    b"2020-02-30T25:61:61Z,-292277022657-01-27,9999999999999999999",
)


def spoilt_table(table: dict[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Table with other headings, cells and columns."""
    spoilt = {name: values.copy() for name, values in table.items()}
    for _ in range(rng.integers(0, 4)):
        names = list(spoilt)
        name = names[rng.integers(0, len(names))]
        values, kind = spoilt[name], rng.integers(0, 8)
        if kind == 0 and len(names) > 1:
            del spoilt[name]
        elif kind == 1:
            spoilt[str(rng.choice(_HEADINGS))] = spoilt.pop(name)
        elif kind == 2:
            values[rng.integers(0, values.size, rng.integers(1, values.size))] = rng.choice(_NUMBERS)
        elif kind == 3:
            spoilt[name] = values[rng.permutation(values.size)]
        elif kind == 4:
            with np.errstate(all="ignore"):
                spoilt[name] = values * float(rng.choice([1e-9, 1e3, 1e9, -1.0, 1e30, 0.0]))
        elif kind == 5:
            spoilt[name] = np.full(values.size, rng.choice(_NUMBERS))
        elif kind == 6:
            spoilt[name] = np.round(values, int(rng.integers(-2, 3)))
        else:
            rows = rng.integers(0, values.size, values.size)
            spoilt = {other: column[np.sort(rows)] for other, column in spoilt.items()}
    return spoilt


def spoilt_bytes(raw: bytes, rng: np.random.Generator) -> bytes:
    """Bytes with a piece that is cut, doubled, zeroed, random, or a line of its own; or with a few bits that differ."""
    begin, end = np.sort(rng.integers(0, len(raw) + 1, 2)).tolist()
    kind = rng.integers(0, 8)
    if kind == 0:
        return raw[:end]
    if kind == 1:
        return raw[:begin] + raw[min(end, begin + 200) :]
    if kind == 2:
        return raw[:end] + raw[begin:]
    if kind == 3:
        return raw[:begin] + bytes(min(end - begin, 64)) + raw[min(end, begin + 64) :]
    if kind == 4:
        return raw[:begin] + rng.bytes(16) + raw[begin + 16 :]
    if kind == 5:
        return raw[:begin] + b"\n" + _LINES[rng.integers(0, len(_LINES))] + b"\n" + raw[begin:]
    if kind == 6:
        return raw[:begin] + b"\xff\xff\xff\x7f" + raw[begin + 4 :]
    return flipped_bytes(rng, raw)


def spoilt_archive(raw: bytes, rng: np.random.Generator) -> bytes:
    """Archive whose largest texts are damaged inside, with the checksums of the damaged texts."""
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = sorted(members)
    for name in rng.choice(names, rng.integers(1, 3)).tolist():
        text = members[name]
        words = [b'r="', b"<c ", b"</row>", b't="n"', b"<v>", b"<sheetData>", b"><"]
        word = words[rng.integers(0, len(words))]
        if rng.random() < 0.5 and word in text:
            other = [b'r="XFD', b'r="99999999999', b't="d"', b"<v>1e999", b"&a;", b"", b't="s"', b"<row r='0'>"]
            text = text.replace(word, other[rng.integers(0, len(other))], int(rng.integers(1, 4)))
        else:
            text = spoilt_bytes(text, rng)
        members[name] = text
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return packed.getvalue()


def spoilt_file(seed: int, run, folder: Path) -> Path:
    """A damaged file of the format whose turn it is."""
    rng = np.random.default_rng(seed)
    name = KINDS[seed % len(KINDS)]
    path, table = folder / name, columns(run)
    if name in WRITERS:
        whole = rng.random() < 0.5
        try:
            WRITERS[name](path, spoilt_table(table, rng) if whole else table)
        except Exception:  # the writer takes no such table, and may not close its file
            path.unlink(missing_ok=True)
            WRITERS[name](path, table)
        raw = path.read_bytes()
        if not whole and name == "run.xlsx" and rng.random() < 0.7:
            raw = spoilt_archive(raw, rng)
        elif not whole:
            raw = spoilt_bytes(raw, rng)
    elif name == "run.nmea":
        raw = mutated("\n".join(log(run, bool(rng.integers(0, 2)))), rng)
        raw = spoilt_bytes(raw, rng) if raw and rng.random() < 0.5 else raw
    else:
        rows = zip(*spoilt_table(table, rng).values(), strict=True)
        text = "\n".join([",".join(table), *(",".join(map(repr, map(float, row))) for row in rows)])
        raw = mutated(text, rng)
        raw = spoilt_bytes(raw, rng) if raw and rng.random() < 0.5 else raw
        raw = gzip.compress(raw, 1) if name.endswith(".gz") else raw
    path.write_bytes(raw)
    return path


def reading(path: Path) -> str:
    """How a file is read, "read" or "refused"; AssertionError for anything but a trial or a sentence."""
    try:
        trial = ps.read_trial(path)
    except ps.TrialError as error:
        sentence = str(error)
        assert str(path) in sentence, sentence
        assert sentence.isprintable(), sentence
        assert sentence.endswith("."), sentence
        assert len(sentence) < 2_000, sentence[:300]
        return "refused"
    check_trial(trial, trial.data_vars)
    assert len(trial.data_vars) > 0
    assert trial.sizes["time"] > 1
    assert all(line.endswith(".") for line in trial.attrs["reading"].splitlines()), trial.attrs["reading"]
    return "read"


def _read_files(parent: Connection, folder: str) -> None:
    """Read the file of each seed that comes from the parent, and send its name, outcome, seconds and bytes."""
    warnings.simplefilter("error")
    run = record(ps.load_vessel("container"), 12.0)
    while True:
        path = spoilt_file(parent.recv(), run, Path(folder))
        parent.send(path.name)
        begin, memory = time.process_time(), peak_memory() or 0
        try:
            outcome = reading(path)
        except BaseException:
            outcome = traceback.format_exc()
        parent.send((outcome, time.process_time() - begin, (peak_memory() or 0) - memory))


def main(count: int, first: int) -> int:
    """Print faults as they come, then the outcomes by format; the number of faults."""
    counts: Counter[tuple[str, str]] = Counter()
    context, reader = multiprocessing.get_context("spawn"), None
    with TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            if reader is None:
                parent, child = context.Pipe()
                reader = context.Process(target=_read_files, args=(child, folder), daemon=True)
                reader.start()
                child.close()
            parent.send(seed)
            name, outcome, seconds, memory = "?", "endless", 0.0, 0
            try:
                name = parent.recv()
                if parent.poll(LONGEST):
                    outcome, seconds, memory = parent.recv()
            except EOFError:
                outcome = "crash"
            if outcome in ("endless", "crash"):
                reader.kill()
                reader = None
            if seconds > MOST_SECONDS or memory > MOST_MEMORY:
                outcome += f" in {seconds:.1f} s and {memory / 1e6:.0f} MB"
            fault = outcome not in ("read", "refused")
            counts[name, "fault" if fault else outcome] += 1
            if fault:
                print(f"seed {seed}, {name}: {outcome}", flush=True)
    for (name, outcome), number in sorted(counts.items()):
        print(f"{name}: {number} {outcome}")
    return sum(number for (_, outcome), number in counts.items() if outcome == "fault")


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:3]]
    sys.exit(min(main(*given, *(10_000, 0)[len(given) :]), 1))
