"""Polynomial terms of the forces: names, factors and :func:`fill_products`, the one evaluator of all districts.

A term is a product of prime quantities: ``v|v|``, ``deltadeltau`` = delta^2 u_a, ``0`` = 1, ``sincos`` = sin(delta)
cos(delta), ``gsincos`` that in the slipstream, ``T`` the excess thrust (:mod:`.propeller`).
"""

import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit

from pymc_ship.physics.forces.programs import PART, sin_cos

SYMBOLS = ("u", "v", "r", "p", "phi", "delta")
"""Quantities of a term; ``u`` is the relative surge speed u_a = (U - U_nom) / U."""

RUDDER = ("sin", "cos")  # functions of the rudder angle in a term
LOADING = ("g", "T")  # functions of u_a in a term of a vessel with a propeller; see propeller
ROW_ONE = 0
ROW_SYMBOL = 1
ROW_DELTA = ROW_SYMBOL + SYMBOLS.index("delta")
ROW_ABSOLUTE = ROW_SYMBOL + len(SYMBOLS)
ROW_RUDDER = ROW_ABSOLUTE + len(SYMBOLS)
ROW_LOADING = ROW_RUDDER + len(RUDDER)
N_BASE = ROW_LOADING + len(LOADING)

_SYMBOL = "|".join(sorted(SYMBOLS, key=len, reverse=True))
_FUNCTIONS = {name: ROW_RUDDER + k for k, name in enumerate(RUDDER + LOADING)}
_TOKEN = re.compile(rf"(?P<symbol>{_SYMBOL})|(?P<function>{'|'.join(_FUNCTIONS)})|\|(?P<absolute>(?:{_SYMBOL})+)\|")


class UnknownTerm(ValueError):
    """A term that is no product of the known symbols."""


def factors(term: str) -> tuple[int, ...]:
    """Workspace rows whose product is a term such as ``v|v|``, none for ``0``; UnknownTerm for another name."""
    rows: list[int] = []
    position = 1 if term.startswith("0") else 0
    if not term:
        raise UnknownTerm("A term needs a name, found an empty string; write the constant as '0'.")
    while position < len(term):
        token = _TOKEN.match(term, position)
        if token is None:
            raise UnknownTerm(
                f"A term is a product of {', '.join((*SYMBOLS, *_FUNCTIONS))} and absolute values such as |v| (the "
                f"constant is '0'), found {term!r}; correct {term[position:]!r}."
            )
        if token["symbol"]:
            rows.append(ROW_SYMBOL + SYMBOLS.index(token["symbol"]))
        elif token["function"]:
            rows.append(_FUNCTIONS[token["function"]])
        else:
            inner = re.findall(_SYMBOL, token["absolute"])
            rows.extend(ROW_ABSOLUTE + SYMBOLS.index(symbol) for symbol in inner)
        position = token.end()
    return tuple(rows)


def order(term: str) -> int:
    """Number of motion factors of a term: 0 for the constant, 3 for ``"v|v|r"``, 1 for ``"gsincos"`` and ``"T"``."""
    rows = factors(term)
    moving = sum(row <= ROW_RUDDER for row in rows)
    return max(moving, 1) if rows else 0


def is_mirrored(term: str) -> bool:
    """Whether a term is odd in v, r, p, phi and delta: it changes its sign with the exchange of port and starboard."""
    odd = [ROW_SYMBOL + k for k, symbol in enumerate(SYMBOLS) if symbol != "u"] + [ROW_RUDDER]
    return sum(row in odd for row in factors(term)) % 2 == 1


def needs_propeller(term: str) -> bool:
    """Whether a term contains propeller loading."""
    return any(row >= ROW_LOADING for row in factors(term))


@dataclass(frozen=True)
class TermPlan:
    """Plan of a set of terms: workspace row ``N_BASE + k`` is row ``left[k]`` times row ``right[k]``, (n_products,)."""

    terms: tuple[str, ...]
    left: np.ndarray
    right: np.ndarray
    rows: np.ndarray  # (n_terms,); workspace rows of the terms

    @property
    def n_rows(self) -> int:
        """Rows of the workspace."""
        return N_BASE + len(self.left)


@lru_cache(maxsize=256)
def plan(terms: tuple[str, ...]) -> TermPlan:
    """Multiplication plan of terms; common products are formed once."""
    row_of: dict[tuple[int, ...], int] = {(): ROW_ONE} | {(row,): row for row in range(N_BASE)}
    products: list[tuple[int, int]] = []
    rows = []
    for term in terms:
        sequence = tuple(sorted(factors(term)))
        for length in range(2, len(sequence) + 1):
            head = sequence[:length]
            if head not in row_of:
                row_of[head] = N_BASE + len(products)
                products.append((row_of[head[:-1]], head[-1]))
        rows.append(row_of[sequence])
    left, right = np.array(products, dtype=np.int64).reshape(-1, 2).T.copy()
    return TermPlan(terms, left, right, np.array(rows, dtype=np.int64))


@njit(**PART, forceinline=True)
def fill_products(work: np.ndarray, left: np.ndarray, right: np.ndarray) -> None:
    """Fill absolute values, functions of the rudder angle and products, from symbol and loading rows."""
    n_lanes = work.shape[1]
    for lane in range(n_lanes):
        work[ROW_ONE, lane] = 1.0
    for symbol in range(ROW_SYMBOL, ROW_ABSOLUTE):
        for lane in range(n_lanes):
            work[symbol + ROW_ABSOLUTE - ROW_SYMBOL, lane] = abs(work[symbol, lane])
    for lane in range(n_lanes):
        work[ROW_RUDDER, lane], work[ROW_RUDDER + 1, lane] = sin_cos(work[ROW_DELTA, lane])
    for k in range(left.size):
        a, b, target = left[k], right[k], N_BASE + k
        for lane in range(n_lanes):
            work[target, lane] = work[a, lane] * work[b, lane]


@njit(**PART)
def fill_product_tangents(work: np.ndarray, left: np.ndarray, right: np.ndarray, tangent: np.ndarray) -> None:
    """Fill the tangents of the rows of :func:`fill_products`, from those of symbols and loading."""
    n_lanes = work.shape[1]
    for lane in range(n_lanes):
        tangent[ROW_ONE, lane] = 0.0
    for symbol in range(ROW_SYMBOL, ROW_ABSOLUTE):
        for lane in range(n_lanes):
            value, change, row = work[symbol, lane], tangent[symbol, lane], symbol + ROW_ABSOLUTE - ROW_SYMBOL
            tangent[row, lane] = change if value > 0.0 else (-change if value < 0.0 else 0.0)
    for lane in range(n_lanes):
        rudder_tangent = tangent[ROW_DELTA, lane]
        tangent[ROW_RUDDER, lane] = work[ROW_RUDDER + 1, lane] * rudder_tangent
        tangent[ROW_RUDDER + 1, lane] = -work[ROW_RUDDER, lane] * rudder_tangent
    for k in range(left.size):
        a, b, target = left[k], right[k], N_BASE + k
        for lane in range(n_lanes):
            tangent[target, lane] = work[a, lane] * tangent[b, lane] + work[b, lane] * tangent[a, lane]


def evaluate(terms: tuple[str, ...], motion: dict[str, np.ndarray]) -> np.ndarray:
    """Terms on prime quantities, shape (n_time, n_terms); UnknownTerm for a name that cannot be read.

    ``motion`` has ``u`` (the relative surge speed u_a), ``v``, ``r``, ``p``, ``phi``, ``delta``, each (n_time,), and
    ``g`` and ``T`` where a term has them.
    """
    scheme = plan(tuple(terms))
    work = np.empty((scheme.n_rows, np.size(motion["u"])))
    for row, symbol in enumerate(SYMBOLS, start=ROW_SYMBOL):
        work[row] = motion[symbol]
    for row, symbol in enumerate(LOADING, start=ROW_LOADING):
        work[row] = motion.get(symbol, 0.0)
    fill_products(work, scheme.left, scheme.right)
    return np.ascontiguousarray(work[scheme.rows].T)
