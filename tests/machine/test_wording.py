"""Sentences of the errors of this wing, each checked once."""

from __future__ import annotations

import os
from functools import partial

from pymc_ship.machine.arguments import (
    check_choice,
    check_flags,
    check_kind,
    finite_number,
    name_list,
    probability_array,
)
from pymc_ship.machine.errors import OutputError
from pymc_ship.machine.files import staged_path, writable_folder
from tests.sentences import wording


def taken_place(tmp_path, place):
    (tmp_path / "file.txt").write_text("kept")
    writable_folder(tmp_path / place)


def written_to(tmp_path, place):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with staged_path(tmp_path / place) as part:
        part.write_text("x")


test_value_errors = wording(
    ValueError,
    (
        r"^The sign is one of ',', '\\t', tab; found '\|'; choose one of them\.$",
        lambda: check_choice("The sign", "|", (",", "\t", "tab")),
    ),
    (
        r"^The size must be a number from 0\.5 up, found 0\.4; correct it\.$",
        lambda: finite_number("The size", 0.4, least=0.5),
    ),
    (r"^progress is True or False, found 'no'; choose one of them\.$", lambda: check_flags(progress="no")),
    (
        r"^The table must be a dict, found <class 'list'>; write it by name\.$",
        lambda: check_kind("The table", [], dict, "write it by name"),
    ),
    (
        r"^The channels must be a list of names, found 'psi'; put one name into a list\.$",
        lambda: name_list("The channels", "psi"),
    ),
    (
        r"^The names of runs must differ, found a, b more than once; rename or leave out\.$",
        lambda: name_list("The names of runs", ["b", "a", "b", "a", "c"]),
    ),
    (r"^Probabilities must lie from 0 to 1, found 1\.5; correct it\.$", lambda: probability_array([0.0, 1.5])),
)

test_output_errors = wording(
    OutputError,
    *(
        (r"file\.txt.* cannot be written: .+; choose another path\.", partial(taken_place, place=place))
        for place in ["file.txt", "file.txt/below"]
    ),
    *(
        (message, partial(written_to, place=place))
        for place, message in [
            ("/dev/null", "A result is written to a file or a folder, found a device at .*; choose another path"),
            ("pipe", "A result is written to a file or a folder, found a pipe at .*; choose another path"),
            ("link", "A result is written to a file or a folder, found a device at .*; choose another path"),
            ("loop", "loop cannot be written: Too many levels of symbolic links"),
            ("folder", "folder cannot be written: Is a directory; choose another path"),
            ("missing/table.csv", r"table\.csv cannot be written: .+; choose another path"),
        ]
    ),
)
