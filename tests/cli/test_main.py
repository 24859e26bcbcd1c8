import sys
import warnings
from pathlib import Path

import pytest

import pymc_ship as ps
from pymc_ship.cli import main as cli
from pymc_ship.cli.main import main
from tests.sentences import refused


def test_version_is_the_packages(capsys):
    with refused(SystemExit, 0):
        main(["--version"])
    assert capsys.readouterr().out == f"pymc-ship {ps.__version__}\n"


def test_only_the_command_line_prints():
    source = Path(cli.__file__).parent
    printing = [path.name for path in source.glob("*.py") if "print(" in path.read_text().replace("fingerprint(", "")]
    assert printing == ["main.py"]


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (
            RuntimeError("cannot cache function 'f': no locator available for file 'f.py'"),
            "set NUMBA_CACHE_DIR to one.",
        ),
        (RuntimeError("can't start new thread"), "The system cannot start a thread, perhaps for lack of memory; "),
        (ImportError("libx.so: failed to map segment"), "A library cannot be loaded, for lack of memory or a broken"),
        (SystemError("error return without exception set"), "A library cannot be loaded, for lack of memory or"),
        (
            OSError("Could not find/load shared object file 'libx.so'"),
            "A library cannot be loaded, for lack of memory or",
        ),
        (OSError("odd"), "pymc-ship: odd."),
        (MemoryError(), "The memory is too small for this run: none is left; make the run shorter."),
    ],
)
def test_what_the_machine_lacks_is_a_sentence(monkeypatch, capsys, error, sentence):
    """Though no other library can be loaded then."""

    def load_vessel(*_):
        raise error

    monkeypatch.setattr(ps, "load_vessel", load_vessel)
    monkeypatch.setitem(sys.modules, "pymc_ship.records.checks.trial_checks", None)
    assert main(["simulate", "container", "--turn", "35", "--out", "unused"]) == 2
    assert sentence in capsys.readouterr().err


def test_other_errors_of_libraries_are_not_hidden(monkeypatch):
    def load_vessel(*_):
        raise RuntimeError("odd")

    monkeypatch.setattr(ps, "load_vessel", load_vessel)
    with refused(RuntimeError, "odd"):
        main(["simulate", "container", "--turn", "35", "--out", "unused"])


def test_a_warning_for_users_is_one_line_however_often_it_is_given(monkeypatch, capsys):
    def load_vessel(*_):
        for _ in range(3):
            warnings.warn("The noise may be too small; export more digits.", UserWarning, stacklevel=2)
        raise ValueError("no vessel here")

    monkeypatch.setattr(ps, "load_vessel", load_vessel)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["simulate", "container", "--turn", "35", "--out", "unused"]) == 2
    text = capsys.readouterr().err
    assert text.splitlines()[0] == "pymc-ship: The noise may be too small; export more digits."
    assert text.count("export more digits") == 1
