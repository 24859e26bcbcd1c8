import pytest

from pymc_ship.cli.main import main
from pymc_ship.cli.sentences import LONGEST, sentence


def test_a_short_sentence_is_one_line():
    assert sentence("Two lines\n  of a\tlibrary") == "pymc-ship: Two lines of a library."
    assert sentence("It ends.") == "pymc-ship: It ends."
    assert sentence("odd \x1b[31m\x00") == "pymc-ship: odd ?[31m?."


def test_a_long_sentence_keeps_its_begin_and_its_end():
    said = sentence(f"begin {'x' * 5000} end")
    assert len(said) == LONGEST
    assert said.startswith("pymc-ship: begin xxx")
    assert " ... xxx" in said
    assert said.endswith("xxx end.")
    whole = sentence("y" * (LONGEST - 12))
    assert len(whole) == LONGEST
    assert " ... " not in whole


def test_every_refusal_has_a_readable_length(capsys):
    assert main(["simulate", "x" * 3000, "--turn", "35", "--out", "o"]) == 2
    with pytest.raises(SystemExit):
        main(["simulate", "container", "--turn", "7" * 3000 + "x"])
    refusals = [line for line in capsys.readouterr().err.splitlines() if line.startswith("pymc-ship: ")]
    assert len(refusals) == 2
    assert max(map(len, refusals)) == LONGEST
