"""Examples in the docstrings of public names run as they stand and print what they show."""

from __future__ import annotations

import doctest

import pytest

import pymc_ship as ps

SLOW = ("hierarchical_posterior", "identify_ship", "pymc_model")


def example(name, value):
    """Example in the docstring of a function or class, with no name given to it from outside."""
    (found,) = doctest.DocTestFinder(recurse=False).find(value, name, globs={})
    return found


def differences(found):
    """What an example prints other than its docstring says."""
    lines = []
    doctest.DocTestRunner(verbose=False).run(found, out=lines.append)
    return "".join(lines)


PUBLIC = [example(name, getattr(ps, name)) for name in ps.__all__ if name != "__version__"]
EXAMPLES = {found.name: found for found in PUBLIC if found.examples}
MARKS = {name: [pytest.mark.slow] for name in SLOW}


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, [])) for name in EXAMPLES])
def test_an_example_prints_what_it_shows(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert differences(EXAMPLES[name]) == ""


def test_forty_public_names_have_an_example():
    assert len(EXAMPLES) >= 40
    assert set(SLOW) <= set(EXAMPLES)


def test_the_check_of_examples_can_fail():
    def wrong():
        """Add.

        >>> 1 + 1
        3
        >>> rng
        """

    shown = differences(example("wrong", wrong))
    assert "Expected:\n    3\nGot:\n    2\n" in shown
    assert "NameError: name 'rng' is not defined" in shown
