import argparse
import inspect
import re
import shlex
import subprocess
import sys
import time
from statistics import median

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli import argument_types, check, commands, ship_commands
from pymc_ship.cli import parser as command_parser
from pymc_ship.cli.examples import EXAMPLES
from pymc_ship.cli.main import main
from pymc_ship.cli.parser import LONGEST, error_line, parser
from pymc_ship.inference.regression import cross_validation
from pymc_ship.inference.regression import identify as identification
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.rows.from_trials import WEAK
from pymc_ship.inference.trajectory.prior import KINDS
from pymc_ship.physics.manoeuvre.kinds import SIDES
from pymc_ship.physics.motion import simulation
from pymc_ship.physics.motion.stepping import METHODS
from pymc_ship.physics.vessel.vessel import DOFS
from pymc_ship.records.denoising import denoise
from pymc_ship.records.denoising.derivative import DERIVATIVES
from pymc_ship.records.denoising.ebayes import PRIORS
from pymc_ship.records.files import instruments
from pymc_ship.ships.identification import candidates as ship_candidates
from tests.journeys.cases import program
from tests.sentences import refused

COMMANDS = ("study", "simulate", "denoise", "regress", "tune", "forecast", "design", "report")
HEAVY = ("numpy", "xarray", "numba", "scipy", "pymc", "pytensor", "arviz", "skopt", "sklearn", "matplotlib", "rich")


def test_help_is_quick_and_imports_nothing_heavy():
    """Median of three whole processes under half a second; the module list is that of the last."""
    script = (
        "import sys\nfrom pymc_ship.cli.main import main\n"
        "for words in (['--help'], *([name, '--help'] for name in sys.argv[1:])):\n"
        "    try:\n        main(words)\n    except SystemExit as stop:\n        assert stop.code == 0\n"
        "print(*sorted(sys.modules), file=sys.stderr)"
    )
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        done = subprocess.run(program("--help"), capture_output=True, text=True, check=True)
        seconds.append(time.perf_counter() - start)
    assert median(seconds) < 0.5
    assert all(name in done.stdout for name in COMMANDS)
    done = subprocess.run([sys.executable, "-c", script, *COMMANDS], capture_output=True, text=True, check=True)
    imported = {name.split(".")[0] for name in done.stderr.split()}
    assert imported.isdisjoint(HEAVY)
    assert "argparse" in imported


def test_simulate_and_check_import_what_they_use(tmp_path):
    """Of SciPy no signal processing and no statistics, which take longer to import than the rest of it; no page."""
    script = (
        "import sys\nfrom pymc_ship.cli.main import main\n"
        "assert main(sys.argv[1:]) == 0 == main(['check', sys.argv[-1], '--vessel', 'kvlcc2'])\n"
        "print(*sorted(sys.modules), file=sys.stderr)"
    )
    words = ["simulate", "kvlcc2", "--zigzag", "20/20", "--duration", "50", "--quiet", "--out", tmp_path / "trial.csv"]
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=True)
    imported = set(done.stderr.split())
    assert imported.isdisjoint(("scipy.signal", "scipy.stats", "matplotlib", "pymc", "arviz", "skopt"))
    assert not [name for name in imported if name.startswith("pymc_ship.ships.design.")]
    assert "scipy.special" in imported


@pytest.mark.parametrize("name", EXAMPLES)
def test_help_names_the_public_function(name):
    assert re.search(r"^Python: `ps\.(\w+)", EXAMPLES[name], re.MULTILINE)[1] in ps.__all__


def test_commands_have_quiet_out_and_examples_that_parse(capsys):
    for name in COMMANDS:
        with refused(SystemExit, 0):
            main([name, "--help"])
        text = capsys.readouterr().out
        assert all(option in text for option in ("--quiet", "--out"))
        examples = [line.strip() for line in text.splitlines() if line.startswith("  pymc-ship ")]
        assert 1 <= len(examples) <= 4
        for example in examples:
            args = parser().parse_args(shlex.split(example)[1:])
            assert args.command == name
            assert getattr(args, "seed", 2020) == 2020


def test_a_command_takes_a_seed_if_and_only_if_it_draws():
    """What it draws, it draws from ``args.seed``; of a Monte-Carlo study the file gives the seeds."""
    takes = subparsers()
    drawn = {name for name in takes if "args.seed" in source_of(name)}
    assert {name for name, options in takes.items() if "--seed" in options} == drawn
    assert set(takes) - drawn == {"check", "denoise", "montecarlo"}


def subparsers():
    """Options of each command."""
    (action,) = [action for action in parser()._actions if isinstance(action, argparse._SubParsersAction)]
    return {name: command._option_string_actions for name, command in action.choices.items()}


def source_of(name):
    """Source of a command."""
    function = name.replace("-", "_")
    return inspect.getsource(
        next(getattr(room, function) for room in (check, ship_commands, commands) if hasattr(room, function))
    )


def test_choices_are_those_of_the_api():
    assert tuple(FAMILIES) == command_parser.FAMILIES
    assert identification.SELECTIONS == command_parser.SELECTIONS
    assert set(SIDES) == set(command_parser.SIDES)
    assert METHODS == command_parser.METHODS
    assert simulation.INTEGRATORS == command_parser.INTEGRATORS
    assert denoise.METHODS == command_parser.DENOISE_METHODS
    assert tuple(instruments.INSTRUMENTS) == argument_types.INSTRUMENTS
    assert (*DERIVATIVES, *WEAK) == command_parser.DERIVATIVES
    assert PRIORS == command_parser.DENOISE_PRIORS
    assert ship_candidates.PRIORS == command_parser.SHIP_PRIORS
    assert set(KINDS) == set(command_parser.TRAJECTORY_PRIORS)
    assert DOFS == command_parser.DOFS
    for split in command_parser.SPLITS:
        assert len(cross_validation.fold_rows(10, split=split, rng=np.random.default_rng(1))) == 5


def test_a_pattern_is_replaced_by_the_files_it_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.csv", "a.csv", "c.txt"):
        (tmp_path / name).touch()
    (tmp_path / "odd*").touch()
    line = ["identify", "*.csv", "odd*", "--out", "d", "--*", "?.txt"]
    assert argument_types.expand_patterns(line) == ["identify", "a.csv", "b.csv", "odd*", "--out", "d", "--*", "c.txt"]


def test_a_pattern_that_names_no_file_is_refused_in_one_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["check", "trials/*.csv"]) == 2
    message = "pymc-ship: A pattern must match at least one file, found none for trials/*.csv; correct it.\n"
    assert capsys.readouterr().err == message


@pytest.mark.parametrize(
    ("words", "interval"),
    [((), 0.9), (("--derivative", "weak"), None), (("--interval", "all"), None), (("--interval", "0.6"), 0.6)],
)
def test_the_default_interval_of_rows_is_a_multiple_of_the_sampling_interval(container, words, interval):
    args = parser().parse_args(["regress", "trial.csv", "--vessel", "container", "--out", "out", *words])
    trial = ps.simulate(container, ps.zigzag(20.0, 20.0), duration=60.0, step=0.1, record_interval=0.3)
    assert commands._row_interval(trial, args) == (interval and pytest.approx(interval))


def test_a_short_sentence_is_one_line():
    assert error_line("Two lines\n  of a\tlibrary") == "pymc-ship: Two lines of a library."
    assert error_line("It ends.") == "pymc-ship: It ends."
    assert error_line("odd \x1b[31m\x00") == "pymc-ship: odd ?[31m?."


def test_a_long_sentence_keeps_its_begin_and_its_end():
    said = error_line(f"begin {'x' * 5000} end")
    assert len(said) == LONGEST
    assert said.startswith("pymc-ship: begin xxx")
    assert " ... xxx" in said
    assert said.endswith("xxx end.")
    whole = error_line("y" * (LONGEST - 12))
    assert len(whole) == LONGEST
    assert " ... " not in whole


def test_every_refusal_has_a_readable_length(capsys):
    assert main(["simulate", "x" * 3000, "--turn", "35", "--out", "o"]) == 2
    with pytest.raises(SystemExit):
        main(["simulate", "container", "--turn", "7" * 3000 + "x"])
    refusals = [line for line in capsys.readouterr().err.splitlines() if line.startswith("pymc-ship: ")]
    assert len(refusals) == 2
    assert max(map(len, refusals)) == LONGEST
