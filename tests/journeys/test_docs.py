"""What the README shows is so: its Python runs, its commands parse, its vessel loads, its links lead somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.parser import parser
from tests.test_structure import HOSTS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, flags=re.MULTILINE | re.DOTALL)


def shell_words():
    """Words of every line of a shell block, without its comment."""
    lines = [shlex.split(line, comments=True) for block in blocks("sh") for line in block.splitlines()]
    return [words for words in lines if words]


def command_lines():
    """Words after ``pymc-ship`` of every command, in a block or inline, that is not a request for help."""
    inline = [shlex.split(code) for code in re.findall(r"`(pymc-ship [^`\n]+)`", TEXT)]
    return [words[1:] for words in [*shell_words(), *inline] if words[0] == "pymc-ship" and "--help" not in words]


def test_every_block_has_a_language_that_is_tested():
    opened = re.findall(r"^```(\w*)$", TEXT, flags=re.MULTILINE)
    assert set(opened[::2]) <= {"python", "sh", "toml", "text"}
    assert len(blocks("python")) >= 2
    assert len(blocks("toml")) == 2


@pytest.mark.parametrize("words", command_lines(), ids=" ".join)
def test_a_command_parses(words):
    assert parser().parse_args(words).command == words[0]


def test_commands_of_the_readme_are_found():
    assert {words[0] for words in command_lines()} >= {"simulate", "identify", "regress", "forecast", "study"}


def test_a_command_that_does_not_parse_is_seen(capsys):
    with pytest.raises(SystemExit):
        parser().parse_args(["regress", "trial.csv", "--vesel", "container", "--out", "identified"])
    assert "pymc-ship regress --help" in capsys.readouterr().err


def test_targets_of_make_exist():
    targets = re.findall(r"^(\w[\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    shown = {words[1] for words in shell_words() if words[0] == "make"} | set(re.findall(r"`make ([\w-]+)`", TEXT))
    assert {"study", "test", "test-fast", "bench"} <= shown
    assert shown <= set(targets)


def test_shell_blocks_hold_nothing_else():
    assert {words[0] for words in shell_words()} == {"make", "pymc-ship"}


def test_commands_of_the_parser_are_named():
    named = re.search(r"worked examples of (.*?)\.", TEXT, flags=re.DOTALL).group(1)
    commands = next(action.choices for action in parser()._actions if action.dest == "command")
    assert set(re.findall(r"`(\w+)`", named)) == set(commands)


def test_the_vessel_of_the_readme_loads(tmp_path):
    path = tmp_path / "my_ship.toml"
    path.write_text(blocks("toml")[0], encoding="utf-8")
    vessel = ps.load_vessel(path)
    assert vessel.name == "my_ship"
    assert vessel.dofs == ("surge", "sway", "yaw")
    assert vessel.particulars.x_G == -0.46
    assert float(vessel.coefficients("sway").sel(coefficient="Ydelta")) == 248.1e-5


def test_the_vessel_of_the_readme_turns_the_way_its_rudder_says(tmp_path):
    path = tmp_path / "my_ship.toml"
    path.write_text(blocks("toml")[0], encoding="utf-8")
    run = ps.simulate(ps.load_vessel(path), ps.turning_circle(10.0), duration=60.0)
    assert not run["diverged"]
    assert run["delta"].values[-1] > 0.0
    assert run["psi"].values[-1] < 0.0


def test_a_wrong_key_in_the_vessel_is_named(tmp_path):
    path = tmp_path / "my_ship.toml"
    path.write_text(blocks("toml")[0].replace("rudder_rate_deg", "rudder_rate"), encoding="utf-8")
    with pytest.raises(ps.VesselError, match="rudder_rate"):
        ps.load_vessel(path)


def test_the_format_of_the_readme_reads_a_trial(tmp_path):
    path = tmp_path / "basin.toml"
    path.write_text(blocks("toml")[1], encoding="utf-8")
    header = "time [s];Speed [kn];v;r [deg/s];Gyro [deg];RUD\n"
    (tmp_path / "run.csv").write_text("Basin\n\n" + header + "0;14;0,5;1;359;-10\n1;14;0,5;1;0;-10\n2;14;0,5;1;1;-10\n")
    trial = ps.read_trial(tmp_path / "run.csv", format=path)
    assert float(trial["time"][1]) == pytest.approx(45.714**0.5)
    assert np.diff(np.rad2deg(trial["psi"])) == pytest.approx([1.0, 1.0])
    assert float(np.rad2deg(trial["delta"][0])) == pytest.approx(-10.4)
    assert float(trial["v"][0]) == pytest.approx((0.5 + 3.2 * np.deg2rad(1.0)) * 45.714**0.5)


def test_links_into_the_repository_lead_to_something():
    targets = re.findall(r"\]\(([^)\s]+)\)", TEXT)
    inside = [target for target in targets if not target.startswith("https://")]
    assert "models/container.toml" in inside
    assert [target for target in inside if not (ROOT / target.partition("#")[0]).exists()] == []


def test_links_out_of_the_repository_are_dois():
    assert all(url.startswith("doi.org/") for url in re.findall(r"https?://([^)\s]+)", TEXT))
    assert [host for host in HOSTS if host in TEXT] == []


@pytest.mark.slow
def test_python_of_the_readme_runs_in_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    matplotlib.use("agg")
    namespace = {}
    for number, block in enumerate(blocks("python"), start=1):
        exec(compile(block, f"README.md, Python block {number}", "exec"), namespace)
    printed = capsys.readouterr().out
    assert "tactical_diameter" in printed
    assert "noise_variance" in printed
    assert "nuts agrees" in printed
    again = ps.read_posterior(tmp_path / "sway.nc")
    assert again.identical(namespace["nuts"])
    assert list(namespace["nuts"]["posterior"].sizes.values())[:2] == [4, 1000]
    assert namespace["tree"]["posterior"]["noise_variance"].size == 4000
