"""Results of several runs at one place, and of runs that are killed: old or new, whole, with nothing left beside."""

from __future__ import annotations

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

from pymc_ship.machine import files
from pymc_ship.machine.errors import OutputError
from pymc_ship.machine.files import OLD, final_path, finish_killed_runs, staged_files, staged_path, writable_folder
from tests.machine.writers import PARTS, read, started, write
from tests.sentences import refused

HOWS = ("file", "folder", "files")


def partials(folder):
    return sorted(path.name for path in folder.rglob(".partial*"))


def prepared(how, out):
    """Folder with an earlier result and what is not of it."""
    if how == "files":
        (out / "result").mkdir()
        (out / "result" / "kept").write_text("kept")
    write(how, out, "old")
    return out


@pytest.mark.parametrize("how", HOWS)
def test_two_runs_at_one_place_leave_the_result_of_one_of_them(tmp_path, how):
    out = prepared(how, tmp_path)
    writers = [started("write_many", how, out, mark, 60) for mark in ("one", "two")]
    seen = 0
    while any(writer.poll() is None for writer in writers):
        if how == "file":  # the others are told in the head of machine.files: no reader without finish_killed_runs
            found = read(how, out)
            assert (len(found), len(set(found))) == (PARTS, 1)
            seen += 1
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen > 10 or how != "file"
    found = read(how, out)
    assert (len(found), len(set(found))) == (PARTS, 1)
    assert partials(out) == []


@pytest.mark.parametrize(
    ("how", "step"), [("file", 1), ("folder", 1), ("folder", 2), *(("files", k) for k in (1, 2, 20, PARTS + 1))]
)
def test_a_run_that_is_killed_at_any_step_leaves_old_or_new(tmp_path, how, step):
    out = prepared(how, tmp_path)
    assert started("killed_at", how, out, "new", step).wait() == -signal.SIGKILL
    finish_killed_runs(out)
    finish_killed_runs(out / "result")
    assert read(how, out) == ["old" if step == 1 else "new"] * PARTS
    assert partials(out) == []
    if how == "files":
        assert (out / "result" / "kept").read_text() == "kept"


def test_files_of_an_earlier_result_go_with_a_killed_move_too(tmp_path):
    out = prepared("files", tmp_path)
    (out / "result" / "part99").write_text("of an earlier one")
    assert started("killed_at", "files", out, "new", 5).wait() == -signal.SIGKILL
    finish_killed_runs(out / "result")
    assert read("files", out) == ["new"] * PARTS


@pytest.mark.parametrize("how", HOWS)
def test_the_next_run_removes_what_a_killed_one_left(tmp_path, how):
    out = prepared(how, tmp_path)
    assert started("killed_at", how, out, "new", 1).wait() == -signal.SIGKILL
    assert len(partials(out)) >= 1
    write(how, out, "next")
    assert read(how, out) == ["next"] * PARTS
    assert partials(out) == []


@pytest.mark.parametrize("step", [1, 2, 3, 20, PARTS + 3, PARTS + 4, PARTS + 5])
def test_a_run_that_is_killed_while_it_removes_its_partial_results_leaves_them_to_the_next(tmp_path, step):
    """The lock is removed last; an empty folder without one is left behind by whatever run."""
    out = prepared("folder", tmp_path)
    assert started("killed_in_removal", "folder", out, "new", step).wait() == -signal.SIGKILL
    assert len(partials(out)) >= 1
    finish_killed_runs(out)
    assert partials(out) == []
    assert read("folder", out) == ["new"] * PARTS


def test_a_run_whose_empty_folder_was_taken_for_left_behind_makes_another(tmp_path, monkeypatch):
    made, taken = files.tempfile.mkdtemp, []

    def mkdtemp(**settings):
        box = made(**settings)
        if not taken:
            taken.append(box)
            finish_killed_runs(tmp_path)
        return box

    monkeypatch.setattr(files.tempfile, "mkdtemp", mkdtemp)
    write("file", tmp_path, "new")
    assert not os.path.exists(taken[0])
    assert read("file", tmp_path) == ["new"] * PARTS
    assert partials(tmp_path) == []


def test_a_run_that_lives_keeps_its_partial_results(tmp_path):
    with staged_path(tmp_path / "a.csv") as mine, staged_files(tmp_path) as others:
        mine.write_text("mine")
        (others / "b.csv").write_text("others")
        write("file", tmp_path, "between")
        finish_killed_runs(tmp_path)
        writable_folder(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "b.csv", "result"]


@pytest.mark.parametrize("locked", [True, False])
def test_partial_results_of_another_machine_go_when_they_are_old_by_the_clock_of_the_file_system(
    tmp_path, monkeypatch, locked
):
    """Its clock and ours play no part, and neither does a lock that cannot be seen from here."""
    monkeypatch.setattr(time, "time", lambda: 0.0)
    box = tmp_path / f".partial-{'0' * 12}-77-abcdefgh"
    (box / "new").mkdir(parents=True)
    if locked:
        (box / ".lock").touch()
    finish_killed_runs(tmp_path)
    assert box.exists()
    now = box.stat().st_mtime
    for path in (*box.rglob("*"), box):
        os.utime(path, (now - OLD - 60.0,) * 2)
    (box / "new").touch()
    finish_killed_runs(tmp_path)
    assert box.exists()
    os.utime(box / "new", (now - OLD - 60.0,) * 2)
    finish_killed_runs(tmp_path)
    assert not box.exists()


def test_folders_of_others_are_left_alone(tmp_path):
    for name in (".partial-download", ".partial-0-1-2", "partial"):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (0.0, 0.0))
    write("file", tmp_path, "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        ".partial-0-1-2",
        ".partial-download",
        "partial",
        "result",
    ]


def test_without_locks_results_are_written_and_nothing_is_taken_for_left_behind(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OSError(95, "Operation not supported")

    assert started("killed_at", "file", tmp_path, "new", 1).wait() == -signal.SIGKILL
    (left,) = partials(tmp_path)
    monkeypatch.setattr(files, "lock_descriptor", refuse)
    for how in HOWS[::2]:
        (tmp_path / how / "result").mkdir(parents=True) if how == "files" else (tmp_path / how).mkdir()
        write(how, tmp_path / how, "new")
        assert read(how, tmp_path / how) == ["new"] * PARTS
    finish_killed_runs(tmp_path)
    assert partials(tmp_path) == [left]


@pytest.mark.parametrize("how", HOWS)
def test_where_an_open_file_cannot_be_removed_nothing_is_left_either(tmp_path, monkeypatch, how):
    """As on Windows: a lock is closed before it is removed, and stays where another run has it open."""
    unlink = Path.unlink

    def unlink_closed(path, missing_ok=False):
        if str(path) in map(os.path.realpath, Path("/proc/self/fd").iterdir()):
            raise PermissionError(13, "Access is denied")
        unlink(path, missing_ok)

    out = prepared(how, tmp_path.resolve())
    assert started("killed_at", how, out, "killed", 1).wait() == -signal.SIGKILL
    monkeypatch.setattr(files, "os", SimpleNamespace(**vars(os) | {"name": "nt"}))
    monkeypatch.setattr(Path, "unlink", unlink_closed)
    write(how, out, "new")
    assert read(how, out) == ["new"] * PARTS
    assert partials(out) == []


@pytest.mark.parametrize("how", HOWS[:2])
def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path, how):
    (tmp_path / "target").mkdir()
    prepared(how, tmp_path / "target")
    (tmp_path / "result").symlink_to("target/result")
    write(how, tmp_path, "new")
    assert (tmp_path / "result").is_symlink()
    assert read(how, tmp_path / "target") == ["new"] * PARTS
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result", "target"]


def test_a_link_to_nothing_yet_leads_to_the_new_file(tmp_path):
    (tmp_path / "result").symlink_to(tmp_path / "later")
    write("file", tmp_path, "new")
    assert (tmp_path / "result").is_symlink()
    assert (tmp_path / "later").read_text().split() == ["new"] * PARTS


@pytest.mark.parametrize(("place", "kind"), [("/dev/null", "device"), ("pipe", "pipe"), ("link", "device")])
def test_a_device_or_a_pipe_is_refused_and_stays(tmp_path, place, kind):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    with refused(OutputError, kind):
        final_path(tmp_path / place)
    with refused(OutputError, kind), staged_path(tmp_path / place):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "pipe"]
    assert not os.path.isfile("/dev/null")


def test_a_link_in_a_circle_is_refused(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with refused(OutputError, "loop"), staged_path(tmp_path / "loop"):
        pass


def test_the_final_path_is_found_while_another_run_replaces_the_result(tmp_path):
    result, before = tmp_path / "result", tmp_path / "before"
    result.mkdir()

    def replaced():
        for _ in range(3000):
            result.rename(before)
            before.rename(result)

    with ThreadPoolExecutor(1) as other:
        run = other.submit(replaced)
        while not run.done():
            assert final_path(result) == result
        run.result()
