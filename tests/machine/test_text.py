import codecs
import gzip
import os
import socket
from functools import partial

import pytest

import pymc_ship as ps
from pymc_ship.machine.memory import peak_memory
from pymc_ship.machine.text import MOST_BYTES, TextError, file_text, utf8
from pymc_ship.records.files.format import load_format
from tests.sentences import refused


def test_utf8_with_or_without_its_mark_is_text():
    assert utf8("δ\r\n".encode()) == utf8(codecs.BOM_UTF8 + "δ\r\n".encode()) == "δ\r\n"
    assert utf8(b"") == ""


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        ("time,u\n".encode("utf-16"), "it is UTF-16 text; save it as UTF-8"),
        (codecs.BOM_UTF16_BE + "time,u\n".encode("utf-16-be"), "it is UTF-16 text; save it as UTF-8"),
        ("time,u\n".encode("utf-32"), "it is UTF-32 text; save it as UTF-8"),
        ("time,u\n".encode("utf-16-le"), "it is UTF-16 text or no text, line 1 has a zero byte; save it as UTF-8"),
        (b"time\nu\0\n", "it is UTF-16 text or no text, line 2 has a zero byte; save it as UTF-8"),
        (b"time\n\xe9\n", "it is not UTF-8 text, line 2; save it as UTF-8"),
    ],
)
def test_what_is_no_utf8_is_named(raw, sentence):
    with pytest.raises(TextError) as error:
        utf8(raw)
    assert str(error.value) == sentence


def pipe(path):
    os.mkfifo(path)
    return path


def socket_file(path):
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))
    return path


def link_to_a_device(path):
    path.symlink_to("/dev/zero")
    return path


def endless_line(path):
    path.write_bytes(b"7," * 2**20)
    return path


def bomb(path):
    """More text than a record may have, in a gzip file of a thousandth of it."""
    path.write_bytes(gzip.compress(b"time,u\n" + b"0,1\n" * (MOST_BYTES // 4), 1))
    return path


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: "/dev/zero", "it is a device, which may never end; copy its text to a file"),
        (link_to_a_device, "it is a device, which may never end; copy its text to a file"),
        (pipe, "it is a pipe, which may never end; copy its text to a file"),
        (socket_file, "it is a socket, which may never end; copy its text to a file"),
        (endless_line, "its first line has more than 1048576 bytes; give a text with line ends"),
        (bomb, "its text has more than 134 MB; split it, or leave out columns or rows"),
        (lambda path: path, "No such file or directory; check the path"),
        (lambda path: path.parent, "Is a directory; check the path"),
    ],
)
def test_a_file_that_has_no_end_is_refused_at_once(tmp_path, make, sentence):
    path = make(tmp_path / "run.csv")
    before = peak_memory()
    with pytest.raises(TextError) as error:
        file_text(path)
    assert str(error.value) == sentence
    assert peak_memory() - before < 4 * MOST_BYTES


@pytest.mark.parametrize(
    "read", [ps.read_trial, ps.load_vessel, load_format, partial(ps.read_captive, vessel="kvlcc2")]
)
def test_every_reader_of_a_file_refuses_it(tmp_path, read):
    with refused(ps.ShipError, "device"):
        read(link_to_a_device(tmp_path / "run.toml"))
    with refused(ps.ShipError, "pipe"):
        read(pipe(tmp_path / "pipe.toml"))
