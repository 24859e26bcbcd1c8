from pathlib import Path
from types import SimpleNamespace

import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.replication import page
from tests.journeys.cases import run
from tests.replication.cases import quick_report


def test_study_passes_its_options_on(tmp_path, monkeypatch, capsys):
    called = []

    def reported_study(out, **settings):
        called.append((out, settings))
        return SimpleNamespace(comparisons=[]), Path(out) / "index.html"

    monkeypatch.setattr(page, "reported_study", reported_study)
    monkeypatch.chdir(tmp_path)
    Path("my").mkdir()
    Path("my/other.toml").write_text((Path(ps.__file__).parents[2] / "models" / "container.toml").read_text())
    run("study", "--vessel", "my/other.toml", "--level", 0.05, "--seed", 3, "--quiet")
    ((out, settings),) = called
    assert out == Path("reports/other")
    settings.pop("progress")("unheard")
    assert settings == {"vessel": "my/other.toml", "level": 0.05, "seed": 3}
    run("study", "--out", tmp_path)
    assert called[1][0] == str(tmp_path)
    assert capsys.readouterr().err == f"Written to {tmp_path / 'index.html'}.\n"


@pytest.mark.parametrize("failed", [[], ["nuts: largest R-hat 1.02 (Yv), to be < 1.01"]])
def test_a_study_whose_check_fails_writes_its_pages_and_ends_with_status_3(tmp_path, monkeypatch, capsys, failed):
    good, poor = (
        SimpleNamespace(name=name, failed_diagnostics=said, disagreements=[])
        for name, said in zip("ab", ([], failed), strict=True)
    )
    result = SimpleNamespace(comparisons=[good, poor], vessel=None, seed=3, draws={})
    monkeypatch.setattr(page, "run_study", lambda *args, **settings: result)
    quick_report(monkeypatch, tmp_path / "page.html.j2")
    assert main(["study", "--quiet", "--out", str(tmp_path)]) == (3 if failed else 0)
    printed = capsys.readouterr()
    sentence = (
        "pymc-ship: A convergence diagnostic or the agreement with the exact posterior fails in 1 of 2 posteriors, "
        "first in b: nuts: largest R-hat 1.02 (Yv), to be < 1.01; the page is written and names them all.\n"
    )
    assert (printed.out, printed.err) == ("", sentence if failed else "")
    pages = [(tmp_path / name).read_text() for name in ("index.html", "diagnostics.html")]
    assert pages == ["new", "diagnosed"]
