import os

import pytest

from pymc_ship.machine.errors import OutputError
from pymc_ship.machine.files import staged_files, staged_path, writable_folder
from tests.sentences import refused


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def write_half(partial, stop):
    partial.write_text("half")
    raise stop


def test_a_file_appears_only_when_the_block_ends(tmp_path):
    path = tmp_path / "table.csv"
    with staged_path(path) as partial:
        partial.write_text("new")
        assert not path.exists()
        assert partial.parents[2] == tmp_path
        assert partial.name == "table.csv"
    assert path.read_text() == "new"
    assert names(tmp_path) == ["table.csv"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError, SystemExit])
def test_an_interrupted_block_keeps_the_earlier_file_and_leaves_nothing_else(tmp_path, stop):
    path = tmp_path / "table.csv"
    path.write_text("earlier")
    with pytest.raises(stop), staged_path(path) as partial:
        write_half(partial, stop)
    assert path.read_text() == "earlier"
    assert names(tmp_path) == ["table.csv"]


def test_a_folder_replaces_the_earlier_one_as_a_whole(tmp_path):
    path = tmp_path / "tables"
    for number in (1, 2):
        with staged_path(path) as partial:
            partial.mkdir()
            (partial / f"{number}.csv").write_text(str(number))
            assert names(tmp_path)[1:] == ["tables"][: number - 1]
    assert names(path) == ["2.csv"]
    assert names(tmp_path) == ["tables"]


@pytest.mark.parametrize("failing_call", [1, 2])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError])
def test_a_folder_that_cannot_be_moved_leaves_the_earlier_one(tmp_path, monkeypatch, stop, failing_call):
    path = tmp_path / "tables"
    path.mkdir()
    (path / "earlier.csv").write_text("earlier")
    replace, calls = os.replace, []

    def replace_until(source, target):
        calls.append(target)
        if len(calls) == failing_call:
            raise stop("stopped")
        replace(source, target)

    monkeypatch.setattr(os, "replace", replace_until)
    with pytest.raises(OutputError if stop is OSError else stop), staged_path(path) as partial:
        partial.mkdir()
    assert names(path) == ["earlier.csv"]
    assert names(tmp_path) == ["tables"]


def test_a_file_never_takes_the_place_of_a_folder(tmp_path):
    path = tmp_path / "results"
    path.mkdir()
    (path / "precious.csv").write_text("precious")
    with refused(OutputError, "results"), staged_path(path) as partial:
        partial.write_text("file")
    assert (path / "precious.csv").read_text() == "precious"
    assert names(tmp_path) == ["results"]


def test_files_are_moved_together_and_one_of_them_last(tmp_path, monkeypatch):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "kept.csv").write_text("kept")
    replace, moved = os.replace, []

    def noted(source, target):
        moved.append(str(target.relative_to(tmp_path)))
        replace(source, target)

    monkeypatch.setattr(os, "replace", noted)
    with staged_files(tmp_path, last="index.html") as partial:
        (partial / "index.html").write_text("page")
        for name in ("tables", "zeros"):
            (partial / name).mkdir()
            (partial / name / "new.csv").write_text(name)
        assert names(tmp_path)[1:] == ["tables"]
    assert moved[1:] == ["tables/new.csv", "zeros/new.csv", "index.html"]
    assert names(tmp_path) == ["index.html", "tables", "zeros"]
    assert names(tmp_path / "tables") == ["kept.csv", "new.csv"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError, OSError])
def test_an_interrupted_block_moves_none_of_its_files(tmp_path, stop):
    (tmp_path / "index.html").write_text("earlier")
    with (
        pytest.raises(OutputError if stop is OSError else stop),
        staged_files(tmp_path, last="index.html") as partial,
    ):
        write_half(partial / "index.html", stop)
    assert (tmp_path / "index.html").read_text() == "earlier"
    assert names(tmp_path) == ["index.html"]


def test_staged_files_never_take_the_place_of_a_folder(tmp_path):
    (tmp_path / "index.html").mkdir()
    with refused(OutputError, "index.html"), staged_files(tmp_path, last="index.html") as partial:
        (partial / "index.html").write_text("page")
    assert names(tmp_path) == ["index.html"]


@pytest.mark.parametrize("place", ["file.txt/table.csv", "missing/table.csv"])
def test_staged_says_where_nothing_can_be_written(tmp_path, place):
    (tmp_path / "file.txt").write_text("kept")
    with refused(OutputError, "table.csv"), staged_path(tmp_path / place) as partial:
        partial.write_text("x")
    assert (tmp_path / "file.txt").read_text() == "kept"
    assert names(tmp_path) == ["file.txt"]


def test_writable_folder_is_made_with_its_parents_and_left_as_it_was(tmp_path):
    path = tmp_path / "a" / "b"
    assert writable_folder(path) == path
    (path / "kept.csv").write_text("kept")
    assert writable_folder(str(path)) == path
    assert names(path) == ["kept.csv"]


@pytest.mark.parametrize("place", ["file.txt", "file.txt/below"])
def test_writable_folder_refuses_a_place_taken_by_a_file(tmp_path, place):
    (tmp_path / "file.txt").write_text("kept")
    with refused(OutputError, "file.txt"):
        writable_folder(tmp_path / place)
    assert names(tmp_path) == ["file.txt"]
