"""The benchmark's table tells losses, disagreements and missing peers; nothing here is timed."""

from __future__ import annotations

import csv
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps
from benchmarks import kvlcc2, r_peers, run, table
from benchmarks.growth import Curve
from tests.sentences import refused

FASTER = table.Row("a fit", 0.5, "the peer", 2.0, "max |d| [sd]", 0.01, 0.05)
SLOWER = replace(FASTER, what="a denoiser", theirs=0.1, note="five times the error")
APART = replace(FASTER, what="a simulation", value=0.06)
RATE = table.Row("draws", 300.0, "the peer", 100.0, "d", 0.0, 0.0, "/s")
CURVE = Curve("rows", "rows", "a posterior", (10, 100, 1000, 10000), {"ours": [1.0, 1.0, 10.0, 100.0]})


def missing():
    yield FASTER
    table.imported("a_peer_that_nobody_has", "a forecast", "the other peer")


class TestRow:
    def test_ratio_says_how_many_times_as_fast_ours_is(self):
        assert FASTER.ratio == 4.0
        assert SLOWER.ratio == pytest.approx(0.2)
        assert RATE.ratio == 3.0

    def test_verdict(self):
        assert FASTER.verdict == RATE.verdict == ""
        assert SLOWER.verdict == "the peer wins"

    @pytest.mark.parametrize("value", [0.06, math.nan, math.inf])
    def test_results_that_disagree_are_marked_however_fast(self, value):
        row = replace(FASTER, value=value)
        assert row.verdict == "RESULTS DIFFER"
        assert row.cells[-1] == "RESULTS DIFFER"
        assert "(<= 0.05)" in row.cells[-2]

    def test_a_row_without_a_check_is_marked(self):
        assert table.Row("a fit", 1.0, "the peer", 2.0).verdict == "RESULTS DIFFER"


class TestMissingPeer:
    def test_is_skipped_with_a_note_and_the_rest_goes_on(self):
        rows = list(table.collected([missing, lambda: iter([RATE])]))
        assert [row.verdict for row in rows] == ["", "skipped", ""]
        assert rows[1].what == "a forecast"
        assert "No module named 'a_peer_that_nobody_has'" in rows[1].note
        assert rows[1].note in table.line(rows[1].cells)

    def test_r_that_is_not_installed(self, monkeypatch):
        monkeypatch.setenv("PATH", "")
        with refused(table.MissingPeer, "installed"):
            r_peers.seconds(r_peers.EBAYES_THRESH, np.ones((3, 1)), {}, "what", "peer")

    @pytest.mark.skipif(os.name == "nt", reason="the stand-in for R is a shell script")
    def test_r_without_the_package_and_r_with_it(self, monkeypatch, tmp_path):
        program = tmp_path / "Rscript"
        monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
        program.write_text("#!/bin/sh\necho 'Error: there is no package' >&2\nexit 1\n")
        program.chmod(0o755)
        with refused(table.MissingPeer, "package"):
            r_peers.seconds(r_peers.EBAYES_THRESH, np.ones((3, 1)), {}, "what", "peer")
        program.write_text(
            '#!/bin/sh\ngrep -q "^kappa <- 10.0$" run.R || exit 1\ncp rows.csv result.csv\nprintf 0.25\n'
        )
        found = r_peers.seconds(r_peers.MCMC_REGRESS, np.eye(3), {"kappa": 10.0}, "what", "peer")
        assert found[0] == 0.25
        np.testing.assert_array_equal(found[1], np.eye(3))


class TestPage:
    def test_tells_losses_disagreements_and_what_was_skipped(self):
        rows = [FASTER, SLOWER, APART, *table.collected([missing])][:3] + list(table.collected([missing]))[1:]
        text = run.page(rows, [CURVE], "1 core", "Python", 3.0)
        assert "- a denoiser: the peer, 5 times as fast" in text
        assert "## Rows whose results disagree\n\n- a simulation: the peer" in text
        assert "- a forecast: the other peer (not run: " in text
        assert "**RESULTS DIFFER**" in text
        assert "- a denoiser, the peer: five times the error." in text
        assert "a posterior against rows: ours 1.00" in text
        assert "](figures/rows.png)" in text

    def test_says_when_there_is_nothing_to_tell(self):
        assert run.page([FASTER], [], "", "", 1.0).count("None.") == 3

    @pytest.mark.parametrize(("rows", "status"), [([FASTER, SLOWER], 0), ([FASTER, APART], 3)])
    def test_is_written_with_tables_and_figures(self, monkeypatch, tmp_path, capsys, rows, status):
        monkeypatch.setattr(run, "measurements", lambda study: [lambda: iter(rows), missing])
        monkeypatch.setattr(run, "curves", lambda: [CURVE])
        assert run.main(["--out", str(tmp_path / "out")]) == status
        names = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.*")}
        assert names == {"benchmarks.md", "benchmarks.csv", "growth.csv", "figures/rows.png"}
        with (tmp_path / "out" / "benchmarks.csv").open() as file:
            written = list(csv.DictReader(file))
        assert [row["verdict"] for row in written] == [row.verdict for row in rows] + ["", "skipped"]
        assert (written[-1]["ours"], written[-1]["value"]) == ("", "")
        printed = capsys.readouterr()
        assert "a fit" in printed.out
        assert ("disagree beyond their limit: a simulation" in printed.err) == (status == 3)


def test_the_exponent_is_that_of_the_last_decade():
    assert CURVE.exponent("ours") == pytest.approx(1.0)


def test_the_benchmark_covers_every_named_peer():
    """The names that the project promises stand in the sources of the rows."""
    sources = "\n".join(path.read_text(encoding="utf-8") for path in Path(run.__file__).parent.glob("*.py"))
    for peer in ("plain PyMC", "BayesianRidge", "Cholesky Gibbs", "solve_ivp", "NumPy loop", "least_squares"):
        assert peer in sources
    for peer in ("shipmmg", "PyWavelets", "scikit-image", "EbayesThresh", "MCMCpack"):
        assert peer in sources


def test_the_vessel_shared_with_shipmmg_moves_alike():
    library = pytest.importorskip("shipmmg.mmg_3dof", reason="installed by make bench")
    time = 0.02 * np.arange(2001)
    delta = np.deg2rad(20.0) * np.sin(2.0 * np.pi * time / 20.0)
    programme = ps.rudder_programme(time, delta, rate_limited=False)
    ours = ps.simulate(kvlcc2.vessel(), programme, duration=40.02, method="rk4")
    settings = {"u0": kvlcc2.SPEED, "rtol": 1e-8, "atol": 1e-9}
    inputs = kvlcc2.shipmmg_inputs(library)
    solution = library.simulate_mmg_3dof(*inputs, time, delta, np.full(2001, kvlcc2.REVOLUTIONS), **settings)
    for name, expected in zip(("u", "v", "r", "x", "y", "psi"), solution.sol(time), strict=False):
        np.testing.assert_allclose(ours[name].values, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())
