from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.physics.forces.terms import (
    ROW_SYMBOL,
    SYMBOLS,
    UnknownTerm,
    evaluate,
    factors,
    fill_product_tangents,
    fill_products,
    needs_propeller,
    order,
    plan,
)
from tests.physics.motion.plain_hull import expression, printed_rows

TERMS = sorted({row["term"] for row in printed_rows() if not row["term"].endswith("dot")})


@pytest.fixture
def motion():
    rng = np.random.default_rng(1)
    return {symbol: rng.uniform(-1.0, 1.0, 50) for symbol in SYMBOLS}


def name_of(rows: tuple[int, ...]) -> str:
    """A term's factors, sorted and spelt out one by one: the absolute value of each symbol in its own bars."""
    symbols = ["1", *SYMBOLS, *(f"|{symbol}|" for symbol in SYMBOLS)]
    return "".join(symbols[row] for row in sorted(rows)) or "0"


@pytest.mark.parametrize(
    ("term", "spelt"),
    [
        ("0", "0"),
        ("0u", "u"),
        ("u", "u"),
        ("uuu", "uuu"),
        ("v|v|", "v|v|"),
        ("r|v|", "r|v|"),
        ("pu|pu|", "up|u||p|"),
        ("phivv", "vvphi"),
        ("ppu", "upp"),
        ("pphi", "pphi"),
        ("deltadeltadeltau", "udeltadeltadelta"),
        ("vdeltadelta", "vdeltadelta"),
    ],
)
def test_a_name_is_split_into_its_factors(term, spelt):
    assert name_of(factors(term)) == spelt
    assert order(term) == len(factors(term))


@pytest.mark.parametrize(
    ("term", "motions", "propelled"),
    [
        ("0", 0, False),
        ("delta", 1, False),
        ("gdelta", 1, True),
        ("gsincos", 1, True),
        ("sinsin", 2, False),
        ("T", 1, True),
        ("gvv", 2, True),
        ("Tv", 1, True),
    ],
)
def test_the_order_counts_motions_and_a_propeller_is_needed_for_its_loading(term, motions, propelled):
    assert (order(term), needs_propeller(term)) == (motions, propelled)


@pytest.mark.parametrize("term", TERMS)
def test_the_factors_of_every_container_term_spell_the_same_product(term, motion):
    spelt = name_of(factors(term))
    np.testing.assert_allclose(evaluate((term,), motion), evaluate((spelt,), motion), rtol=1e-15)


def test_terms_are_the_products_their_names_say(motion):
    names = {"phi": "f", "delta": "d"}
    plain = {names.get(symbol, symbol): values for symbol, values in motion.items()}
    expected = np.column_stack([np.broadcast_to(eval(expression(term), dict(plain)), 50) for term in TERMS])
    values = evaluate(tuple(TERMS), motion)
    assert values.shape == (50, len(TERMS))
    np.testing.assert_allclose(values, expected, rtol=1e-14)
    np.testing.assert_allclose(values[:, TERMS.index("pu|pu|")], plain["p"] * plain["u"] * abs(plain["p"] * plain["u"]))
    assert (values[:, TERMS.index("0")] == 1.0).all()


def test_products_shared_by_terms_are_formed_once():
    shared = plan(("deltadelta", "deltadeltadelta", "deltadeltau", "deltadeltau"))
    assert len(shared.left) == 4  # delta^2, delta^3, u delta, u delta^2
    assert shared.rows[2] == shared.rows[3]


def test_the_slope_of_an_absolute_value_at_zero_is_that_of_central_differences():
    scheme = plan(("r|v|",))
    work, tangent = np.zeros((scheme.n_rows, 3)), np.zeros((scheme.n_rows, 3))
    v, r = (ROW_SYMBOL + SYMBOLS.index(symbol) for symbol in ("v", "r"))
    work[v], work[r], tangent[v] = [-0.2, 0.0, 0.2], 0.5, 1.0
    fill_products(work, scheme.left, scheme.right)
    fill_product_tangents(work, scheme.left, scheme.right, tangent)
    h = 1e-3
    expected = 0.5 * (np.abs(work[v] + h) - np.abs(work[v] - h)) / (2.0 * h)
    np.testing.assert_allclose(tangent[scheme.rows[0]], expected, atol=1e-12)


def test_the_rudder_s_sine_and_cosine_are_functions_of_its_angle(motion):
    values, delta = evaluate(("gsincos", "gsincos|delta|", "sinsin"), motion | {"g": np.full(50, 2.0)}), motion["delta"]
    expected = 2.0 * np.sin(delta) * np.cos(delta)
    np.testing.assert_allclose(values.T, [expected, expected * abs(delta), np.sin(delta) ** 2], rtol=1e-14)


def test_the_slope_of_a_rudder_force_by_its_angle_is_that_of_central_differences():
    scheme = plan(("sincos", "sincos|delta|"))
    row, angles, h = ROW_SYMBOL + SYMBOLS.index("delta"), np.array([-0.6, 0.1, 0.5]), 1e-6

    def filled(delta):
        work = np.zeros((scheme.n_rows, 3))
        work[row] = delta
        fill_products(work, scheme.left, scheme.right)
        return work

    tangent = np.zeros((scheme.n_rows, 3))
    tangent[row] = 1.0
    fill_product_tangents(filled(angles), scheme.left, scheme.right, tangent)
    difference = (filled(angles + h) - filled(angles - h)) / (2.0 * h)
    np.testing.assert_allclose(tangent[scheme.rows], difference[scheme.rows], rtol=1e-8)


def test_terms_of_any_order_are_evaluated(motion):
    np.testing.assert_allclose(evaluate(("vvvvrrr",), motion)[:, 0], motion["v"] ** 4 * motion["r"] ** 3, rtol=1e-14)


@pytest.mark.parametrize("term", ["", "w", "vw", "v|r", "v||", "00", "v^2", "V", "v v", "beta", "|", "v0"])
def test_an_unknown_term_is_an_error_of_one_sentence_that_names_it(term):
    with pytest.raises(UnknownTerm) as error:
        factors(term)
    message = str(error.value)
    assert repr(term) in message or not term
    assert message.endswith(".")
    assert "\n" not in message
