"""The known name that a misspelt one is nearest to; imports nothing, as the command line reads it."""

from collections.abc import Iterable

_LONGEST, _NEAR = 60, 0.75  # characters of a misspelt name, and its similarity to the known one as of difflib


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Question after the known name nearest to a word, in brackets after a space; empty if none or two are near."""
    from difflib import SequenceMatcher, get_close_matches

    if not isinstance(word, str) or len(word) > _LONGEST:
        return ""
    names = {name.lower(): name for name in known}
    near = get_close_matches(word.lower(), names, 2, _NEAR)
    nearest = [SequenceMatcher(None, name, word.lower()).ratio() for name in near]
    is_one = len(near) == 1 or (len(near) == 2 and nearest[0] > nearest[1])
    return f" (did you mean {names[near[0]]}?)" if is_one else ""
