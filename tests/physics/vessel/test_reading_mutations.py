"""Whatever stands in a vessel file, it ends in a ship or in one sentence."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.plausibility import findings
from pymc_ship.physics.vessel.vessel import reference_coefficients
from tests.physics.vessel.mutations import ROOT, mutated

LONGEST = 320
"""Characters of the longest sentence, without the path."""


def outcome(path, content):
    """``"ship"`` or the sentence that refuses the file, after a check of either."""
    path.write_bytes(content)
    try:
        vessel = ps.load_vessel(path)
    except ps.VesselError as error:
        sentence = str(error).replace(str(path), "FILE")
        assert "FILE" in sentence
        assert sentence.endswith(".")
        assert sentence.isprintable()
        assert len(sentence) < LONGEST, sentence
        return sentence
    assert not any(finding.impossible for finding in findings(vessel))
    J = vessel.inertia_matrix
    assert np.linalg.eigvalsh(J + J.T)[0] > 0.0
    return "ship"


@pytest.mark.filterwarnings("error")
def test_every_mutated_file_ends_in_a_ship_or_in_one_sentence(tmp_path):
    rng = np.random.default_rng(12)
    outcomes = [outcome(tmp_path / "mine.toml", mutated(rng)) for _ in range(400)]
    assert 40 < outcomes.count("ship") < 360
    assert len(set(outcomes)) > 80


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('name = "é"'.encode("utf-16"), "it is UTF-16 text; save it as UTF-8"),
        ('name = "é"'.encode("utf-16-le"), "it is UTF-16 text or no text, line 1"),
        ('name = "é"'.encode("latin-1"), "it is not UTF-8 text, line 1; save it as UTF-8"),
        (b"'' = 1", "unknown key ''"),
        (b"x = " + b"[" * 20000 + b"]" * 20000, "nested too deep"),
        (b"x = 0x" + b"f" * 9000, "unknown key x"),
        (b"particulars = {}\nname = 0x" + b"f" * 9000, "name must be a text, found a number of thousands of digits"),
        (
            b"particulars = {}\nname = [" + b'"y", ' * 5000 + b"]",
            "name must be a text, found ['y', 'y', 'y', 'y', 'y', 'y', ...]",
        ),
        (b'"a\\nb" = 1', "unknown key 'a\\nb'"),
        (b'name = ""', "particulars is missing"),
        (b'name = ""\n[particulars]', "name must be one line of 1 to 60 characters, found ''"),
    ],
)
def test_files_that_are_odd_as_a_whole_are_named_as_such(tmp_path, content, words):
    assert words in outcome(tmp_path / "mine.toml", content)


def test_a_byte_order_mark_and_line_ends_of_windows_are_read(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + (ROOT / "models" / "kvlcc2.toml").read_bytes().replace(b"\n", b"\r\n"))
    vessel, shipped = ps.load_vessel(path), ps.load_vessel("kvlcc2")
    np.testing.assert_array_equal(reference_coefficients(vessel), reference_coefficients(shipped))
    assert (vessel.particulars, vessel.sources) == (shipped.particulars, shipped.sources)
