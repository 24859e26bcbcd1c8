"""Errors as tests see them: the class, its numbers and names anywhere, the sentence in the table of each wing."""

from __future__ import annotations

import inspect
import re
from contextlib import contextmanager

import pytest

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")


@contextmanager
def refused(error, *carried):
    """An error of a class whose sentence carries some numbers and names; a name is one word of a file or of the code.

    The words of the sentence are checked in the table of the wing.
    """
    with pytest.raises(error) as raised:
        yield raised
    text = str(raised.value)
    assert not [part for part in carried if " " in str(part)], "prose belongs to the table of the wing"
    for part in carried:
        if isinstance(part, str):
            assert re.search(rf"(?<!\w){re.escape(part)}(?!\w)", text), (part, text)
        else:
            assert part in map(float, NUMBER.findall(text)), (part, text)


def asked(one):
    """Whether a parameter of a call is a fixture: it has no value yet."""
    return one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD


def wording(error, *cases):
    """A test of sentences of one class of errors: a case is a pattern and a call, which names its fixtures."""

    @pytest.mark.parametrize(("sentence", "call"), cases, ids=[f"{sentence:.60}" for sentence, _ in cases])
    def test(request, sentence, call):
        needed = inspect.signature(call).parameters.values()
        fixtures = {one.name: request.getfixturevalue(one.name) for one in needed if asked(one)}
        with pytest.raises(error, match=sentence) as raised:
            call(**fixtures)
        assert str(raised.value).endswith(".")
        assert "\n" not in str(raised.value)

    return test
