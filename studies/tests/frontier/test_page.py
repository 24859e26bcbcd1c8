"""The command of the frontier: its options, and what it refuses before long work."""

from __future__ import annotations

from pymc_ship.cli.main import run_command
from studies.frontier import page as frontier_report
from studies.frontier.__main__ import frontier, parser


def test_the_command_passes_its_options_on_and_prints_the_table(tmp_path, monkeypatch, capsys):
    called = []

    def reported_frontier(out, **settings):
        called.append((out, settings))
        return "| a |", tmp_path / "index.html"

    monkeypatch.setattr(frontier_report, "reported_frontier", reported_frontier)
    assert run_command(parser(), frontier, ["--seeds", "3", "--seed", "7", "--quiet", "--out", str(tmp_path)]) == 0
    ((out, settings),) = called
    settings.pop("progress")("unheard")
    assert (out, settings) == (str(tmp_path), {"seeds": 3, "seed": 7})
    assert capsys.readouterr() == ("| a |\n", "")


def test_one_seed_is_refused_in_a_sentence(tmp_path, capsys):
    assert run_command(parser(), frontier, ["--seeds", "1", "--out", str(tmp_path)]) == 2
    assert "two seeds or more, found 1" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_refused_before_long_work(tmp_path, monkeypatch, capsys):
    def forbid(*args, **settings):
        raise AssertionError("long work has begun")

    monkeypatch.setattr(frontier_report, "frontier", forbid)
    (tmp_path / "file").write_text("kept")
    assert run_command(parser(), frontier, ["--out", str(tmp_path / "file" / "below")]) == 2
    assert "cannot be written" in capsys.readouterr().err
