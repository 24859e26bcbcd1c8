"""Generators of numbers: each purpose has its own, whatever the order."""

from __future__ import annotations

from pymc_ship.machine.seeds import generator

PURPOSES = [
    ("noise", 0.01),
    ("noise", 0.001),
    ("prior", 0.01),
    ("forecast", 0.01, "conjugate", "zigzag"),
    ("forecast", 0.01, "semiconjugate", "zigzag"),
    ("forecast", 0.01, "conjugate", "turning_circle"),
    ("exact", "conjugate"),
    ("nuts", "conjugate", "surge"),
    ("gibbs", "conjugate", "surge"),
    ("nuts", "conjugate", "sway"),
    ("sweep",),
    ("trajectory", 0.01),
]


def first_numbers(purposes, seed=3):
    return {purpose: generator(seed, *purpose).integers(2**62, size=4).tolist() for purpose in purposes}


def test_a_generator_depends_on_seed_and_purpose_and_not_on_the_order():
    forward = first_numbers(PURPOSES)
    assert first_numbers(reversed(PURPOSES)) == forward
    assert len({tuple(numbers) for numbers in forward.values()}) == len(PURPOSES)
    other = first_numbers(PURPOSES, seed=4)
    assert all(other[purpose] != forward[purpose] for purpose in PURPOSES)


def test_purposes_are_told_apart_by_every_word():
    assert len({tuple(n) for n in first_numbers([("a", "b"), ("ab",), ("b", "a"), ("a",), ("b",)]).values()}) == 5
