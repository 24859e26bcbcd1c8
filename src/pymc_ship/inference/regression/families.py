"""Prior families by name: the two of Xue et al. (2020), and those that are registered."""

from inspect import isabstract

from pymc_ship.inference.regression.conjugate import ConjugatePrior
from pymc_ship.inference.regression.priors import Prior
from pymc_ship.inference.regression.semiconjugate import SemiConjugatePrior
from pymc_ship.machine.arguments import check_choice, check_kind
from pymc_ship.machine.errors import InferenceError

FAMILIES: dict[str, type[Prior]] = {prior.family: prior for prior in (ConjugatePrior, SemiConjugatePrior)}
"""Prior families by name; :func:`register_family` adds to them."""


def register_family(prior_class: type[Prior]) -> type[Prior]:
    """Register a prior family under its name; a decorator of its class.

    InferenceError for a class without a name of its own, ``noise_power``, ``box`` and ``exact``.
    """
    check_kind("A prior family", prior_class, type, "give the class", InferenceError)
    lacking = [name for name in ("noise_power", "box") if not hasattr(prior_class, name)]
    lacking += ["exact"] if isabstract(prior_class) else []
    if lacking:
        raise InferenceError(
            f"A prior family states its noise_power, box and exact posterior, found no {' and no '.join(lacking)} in "
            f"{prior_class.__name__}; add it to the class."
        )
    if not prior_class.family or FAMILIES.get(prior_class.family, prior_class) is not prior_class:
        raise InferenceError(
            f"A prior family has a name of its own, found {prior_class.family!r} beside {', '.join(FAMILIES)}; set the "
            f"attribute family of {prior_class.__name__} to another."
        )
    FAMILIES[prior_class.family] = prior_class
    return prior_class


def prior_family(family: str) -> type[Prior]:
    """Class of a prior family; InferenceError for an unknown name."""
    check_choice("A prior family", family, FAMILIES, InferenceError)
    return FAMILIES[family]
