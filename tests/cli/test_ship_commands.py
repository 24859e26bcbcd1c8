"""`identify`, and `forecast` of what it wrote: one run of both on the tutorial's files, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.cli.ship_commands import _names

FOLDER = Path(__file__).parents[2] / "docs" / "tutorials" / "your_ship"
COMMON = ("--format", str(FOLDER / "format.toml"))
VESSEL = ("--vessel", str(FOLDER / "my_ship.toml"))
RUNS = [str(FOLDER / f"{name}.csv") for name in ("zigzag_10_10_port", "zigzag_20_10_starboard", "zigzag_20_20_port")]
CIRCLE = str(FOLDER / "turning_circle_35_starboard.csv")


def refused(capsys, *words, status=2) -> str:
    assert main([str(word) for word in words]) == status
    out, err = capsys.readouterr()
    assert out == ""
    sentence = err.strip().splitlines()[-1]
    assert sentence.startswith("pymc-ship: ")
    assert sentence.endswith(".")
    return sentence


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """Folder of a ship identified from three zigzags with one term set."""
    out = tmp_path_factory.mktemp("ship")
    words = ["identify", *RUNS, *COMMON, *VESSEL, "--terms", "hull and loading, cubic", "--draws", "200"]
    assert main([*words, "--quiet", "--out", str(out)]) == 0
    return out


@pytest.mark.slow
class TestIdentify:
    def test_page_model_figures_and_tables_are_there(self, identified):
        assert (identified / "index.html").stat().st_size > 10_000
        index = json.loads((identified / "model" / "ship.json").read_text())
        assert [entry["name"] for entry in index["terms"]] == ["hull and loading, cubic"]
        assert index["runs"] == [Path(path).stem for path in RUNS]
        assert list((identified / "figures").glob("*.png"))
        assert "pymc-ship" in index["made_by"]
        assert not list(identified.glob(".*"))

    @pytest.mark.usefixtures("undrawn")
    def test_an_earlier_report_is_a_prior(self, identified, tmp_path, capsys):
        words = ["identify", CIRCLE, *COMMON, *VESSEL, "--prior", str(identified), "--draws", "40", "--quiet"]
        assert main([*words, "--out", str(tmp_path / "both")]) == 0
        text = capsys.readouterr().out
        assert "The likelihood of earlier runs is included" in text
        assert "Recommended next run: " in text
        assert "Tactical diameter of the turning circle of 35 deg: " in (tmp_path / "both" / "index.html").read_text()
        first, both = (ps.load_ship(folder) for folder in (identified, tmp_path / "both"))
        (one,), (other,) = first.likelihoods.values(), both.likelihoods.values()
        assert len(other.log_density) > len(one.log_density)
        assert both.motion.sizes["row"] > first.motion.sizes["row"]

    def test_a_prior_that_is_neither_a_kind_nor_a_report_is_refused(self, tmp_path, capsys):
        words = ["identify", *RUNS, *COMMON, *VESSEL, "--prior", tmp_path / "none", "--quiet", "--out", tmp_path]
        assert "holds no identified ship" in refused(capsys, *words)

    def test_the_saved_ship_is_a_vessel_and_a_posterior(self, identified):
        vessel = ps.load_vessel(identified / "model" / "hull-and-loading-cubic.toml")
        tree = ps.read_posterior(identified / "model" / "hull-and-loading-cubic.nc")
        assert vessel.particulars.rudder_rate_deg == pytest.approx(2.35, rel=0.05)
        assert dict(tree["posterior"].sizes) == {"chain": 4, "draw": 50, "coefficient": 29}
        mean = tree["posterior"]["coefficients"].mean(("chain", "draw"))
        sd = tree["posterior"]["coefficients"].std(("chain", "draw"))
        names = tree["posterior"]["coefficient"].values
        values = np.concatenate([vessel.coefficients(dof).values for dof in vessel.dofs])
        np.testing.assert_array_equal(
            np.concatenate([vessel.coefficients(d)["coefficient"] for d in vessel.dofs]), names
        )
        assert (np.abs(mean.values - values) < 5.0 * sd.values / np.sqrt(200.0)).mean() > 0.9

    @pytest.mark.usefixtures("undrawn")
    def test_forecast_writes_a_page_with_the_circle_that_was_measured(self, identified, tmp_path, capsys):
        words = ["forecast", str(identified), "--turn", "35", "--side", "starboard", "--draws", "100", *COMMON]
        assert main([*words, "--measured", CIRCLE, "--quiet", "--out", str(tmp_path)]) == 0
        text = capsys.readouterr().out
        assert text.count("turning circle 35 starboard:") == 1
        assert "measured" in text
        assert "IMO MSC.137(76): advance" in text
        assert "Turning circle 35 starboard" in (tmp_path / "forecast.html").read_text()
        assert (tmp_path / "tables").is_dir()

    @pytest.mark.usefixtures("undrawn")
    def test_both_sides_are_forecast_into_the_ships_own_folder(self, identified, capsys):
        assert main(["forecast", str(identified), "--zigzag", "10/10", "--draws", "20", "--quiet"]) == 0
        text = capsys.readouterr().out
        assert "zigzag 10/10 port:" in text
        assert "zigzag 10/10 starboard:" in text
        assert (identified / "forecast.html").is_file()

    @pytest.mark.usefixtures("undrawn")
    def test_the_same_seed_gives_the_same_forecast(self, identified, capsys, tmp_path):
        words = ["forecast", str(identified), "--zigzag", "20/20", "--draws", "20", "--quiet", "--out", str(tmp_path)]
        texts = []
        for _ in range(2):
            main(words)
            texts.append(capsys.readouterr().out)
        assert texts[0] == texts[1]

    def test_a_forecast_needs_a_manoeuvre(self, identified, capsys):
        assert "needs a manoeuvre" in refused(capsys, "forecast", identified)

    def test_design_says_which_run_tells_most_in_the_sea_room(self, identified, capsys, tmp_path):
        words = ["design", str(identified), "--n", "1", "--quiet", "--out", str(tmp_path)]
        assert main(words) == 0
        anywhere = capsys.readouterr().out
        assert main([*words, "--sea-room", "2500"]) == 2
        assert "--force" in capsys.readouterr().err
        assert main([*words, "--force", "--sea-room", "2500"]) == 0
        near = capsys.readouterr().out
        for text in (anywhere, near):
            assert text.startswith("Interval widths after each run")
            assert "Half width of the 95 % intervals" in text
        assert anywhere != near
        first, *rows = (tmp_path / "next_runs.csv").read_text().splitlines()[1:]
        assert first == "candidate,sea_room,width_ratio_1"
        table = {row.split(",")[0]: [float(word) for word in row.split(",")[1:]] for row in rows}
        assert all(np.isnan(ratio) == (room > 2500.0) for room, ratio in table.values())
        best = min((ratio, label) for label, (_, ratio) in table.items() if np.isfinite(ratio))[1]
        assert f"after {best}" in near
        header, *widths = (tmp_path / "half_widths.csv").read_text().splitlines()[1:]
        assert header == "manoeuvre,index,units,half_width,after_1"
        assert len(widths) == 18
        assert all(len(row.split(",")) == 5 for row in widths)

    def test_a_broken_index_is_named(self, identified, capsys, tmp_path):
        (tmp_path / "model").mkdir()
        (tmp_path / "model" / "ship.json").write_text('{"terms": []')
        sentence = refused(capsys, "forecast", tmp_path, "--turn", 35)
        assert "ship.json cannot be read" in sentence


def test_a_trial_with_a_bad_check_is_refused(capsys, tmp_path):
    """The rudder counted to the wrong side: nothing is fitted and nothing written."""
    text = (FOLDER / "format.toml").read_text().replace('rudder_positive = "starboard"', 'rudder_positive = "port"')
    (tmp_path / "format.toml").write_text(text)
    out = tmp_path / "out"
    sentence = refused(
        capsys, "identify", RUNS[0], "--format", tmp_path / "format.toml", *VESSEL, "--out", out, status=3
    )
    assert RUNS[0] in sentence
    assert "rudder sign" in sentence
    assert not out.exists()


def test_runs_are_called_by_their_files_or_where_two_are_alike_by_their_paths():
    assert _names(["a/zigzag.csv", "b/circle.csv.gz"]) == ["zigzag", "circle"]
    assert _names(["a/run.csv", "b/run.csv"]) == ["a/run.csv", "b/run.csv"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("identify", RUNS[0], *COMMON, *VESSEL, "--terms", "septic"), "A term set is one of"),
        (("identify", "missing.csv", *COMMON, *VESSEL), "missing.csv"),
        (("design", "nowhere"), "The posterior nowhere needs the particulars of its ship, found no --vessel; add --v"),
        (("design", "nowhere", "--vessel", "kvlcc2"), "found nothing at nowhere"),
        (("forecast", "nowhere", "--turn", "35"), "The posterior nowhere needs the particulars of its ship, found no"),
        (("forecast", "nowhere", "--turn", "35", "--vessel", "container"), "found nothing at nowhere"),
    ],
)
def test_what_cannot_run_is_told_in_one_sentence(capsys, tmp_path, words, told):
    assert told in refused(capsys, *words, "--out", tmp_path / "out")
