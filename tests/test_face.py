"""The one door of the package: its public names, what type checkers see of them, and what importing loads."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from statistics import median

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.captive.fit import CaptiveFit
from pymc_ship.inference.regression.identify import Identification
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.physics.forces.modular import PARTS
from pymc_ship.physics.manoeuvre.registry import KINDS
from pymc_ship.records.checks.lag import VelocityLag
from pymc_ship.ships.forecasting.stopping import StoppingTest
from pymc_ship.ships.identification.model import ShipIdentification
from pymc_ship.ships.sea_trials.sea_trial import SeaTrial
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.units import METRE
from tests.journeys.markdown import pages
from tests.sentences import refused
from tests.test_structure import SAMPLERS, WINGS

STUB = Path(ps.__file__).with_suffix(".pyi")
HEAVY = (*SAMPLERS, "numba", "arviz", "skopt", "matplotlib", "scipy", "pandas", "xarray")


def printed(*words, status=0):
    """Run a command line of the interpreter in a new process; return what it prints and its errors."""
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stdout, done.stderr


def fresh(code):
    """Run code in a new interpreter; return what it prints."""
    return printed("-c", code)[0]


def stubbed(text):
    """Statements of a stub: the room and name of each re-export, and the source of anything else."""
    found = []
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom) and [alias.asname for alias in node.names] == [node.names[0].name]:
            found.append((node.module, node.names[0].name))
        else:
            found.append(ast.unparse(node))
    return found


# public names ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in ps.__all__ if name != "__version__"])
def test_a_public_name_resolves_and_has_a_docstring(name):
    value = getattr(ps, name)
    assert callable(value)
    assert value.__name__ == name
    assert value.__module__ == f"pymc_ship.{ps._MODULE_OF[name]}"
    assert inspect.getdoc(value)


def test_the_table_of_public_names_has_the_order_of_the_house():
    rooms = [room.rpartition(".") for room in ps._PUBLIC]
    assert rooms == sorted(rooms, key=lambda room: (WINGS.index(room[0]), room[2]))
    assert all(names.split() == sorted(names.split()) for names in ps._PUBLIC.values())


def test_a_user_can_read_the_whole_list():
    assert len(ps.__all__) - 1 <= 101


def test_public_names_are_listed_once_and_unknown_ones_are_attribute_errors():
    assert len(set(ps.__all__)) == len(ps.__all__)
    assert ps.__version__
    with refused(AttributeError, "pymc_ship", "anchor"):
        ps.anchor  # noqa: B018


def test_only_public_names_are_listed_whatever_was_imported():
    code = "import pymc_ship as ps; ps.load_vessel; import pymc_ship.cli.main; print(*dir(ps))"
    assert fresh(code).split() == sorted(ps.__all__)


def test_a_public_name_is_loaded_once():
    code = "import pymc_ship as ps; print('Vessel' in vars(ps)); ps.Vessel; print(vars(ps)['Vessel'] is ps.Vessel)"
    assert fresh(code).split() == ["False", "True"]


def from_inside(blocks):
    """Rooms of the package that the Python of a page imports from, or imports."""
    nodes = [node for block in blocks for node in ast.walk(ast.parse(block))]
    named = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    named += [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    return [name for name in named if name.startswith("pymc_ship.")]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.path)
def test_no_page_of_the_docs_imports_from_an_inner_module(page):
    assert from_inside(page.blocks("python")) == []


def test_the_check_of_imports_can_fail():
    blocks = ["import pymc_ship as ps\nimport numpy", "def f():\n    from pymc_ship.trial import channels\n"]
    blocks += ["import pymc_ship.pages.page as page\nfrom pymc_ship import Vessel\n"]
    assert from_inside(blocks) == ["pymc_ship.trial", "pymc_ship.pages.page"]


# type checkers --------------------------------------------------------------------------------------------------------


def test_the_stub_holds_the_public_names_and_nothing_else():
    table = [(f"pymc_ship.{room}", name) for room, names in ps._PUBLIC.items() for name in names.split()]
    *imports, version = stubbed(STUB.read_text(encoding="utf-8"))
    assert sorted(imports) == sorted(table)
    assert version == "__version__: str"


def test_the_check_of_the_stub_can_fail():
    text = "from a.b import c as c\nfrom a.b import d\nfrom a.b import e as f\ng: int\n"
    assert stubbed(text) == [("a.b", "c"), "from a.b import d", "from a.b import e as f", "g: int"]


def test_the_package_says_that_it_is_typed():
    assert STUB.with_name("py.typed").read_bytes() == b""


def functions_of(value):
    """A public function itself; of a public class every function, method and property that it defines."""
    if inspect.isfunction(value):
        return [value]
    own = [entry for name, entry in vars(value).items() if not name.startswith("_") or name == "__init__"]
    found = [getattr(entry, "fget", None) or getattr(entry, "func", None) or inspect.unwrap(entry) for entry in own]
    found = [getattr(entry, "__func__", entry) for entry in found]
    return [entry for entry in found if inspect.isfunction(entry) and entry.__module__ == value.__module__]


def without_types(function):
    """Arguments of a function without a type; "return" where what it returns has none."""
    entries = [entry for name, entry in inspect.signature(function).parameters.items() if name not in ("self", "cls")]
    lacking = [entry.name for entry in entries if entry.annotation is entry.empty]
    returned = "return" in function.__annotations__ or function.__name__ == "__init__"
    return lacking if returned else [*lacking, "return"]


@pytest.mark.parametrize("name", [name for name in ps.__all__ if name != "__version__"])
def test_a_public_function_and_the_methods_of_a_public_class_have_types(name):
    functions = functions_of(getattr(ps, name))
    lacking = {function.__qualname__: without_types(function) for function in functions}
    assert {name: found for name, found in lacking.items() if found} == {}


def test_the_check_of_types_can_fail():
    class Ship:
        length: float = 1.0

        def __init__(self, a: int, b=2): ...

        def sail(self, *speeds: float, **options) -> None: ...

        def _hidden(self, a): ...

        @property
        def draught(self): ...

        @cached_property
        def beam(self): ...

        @classmethod
        def read(cls, path) -> None: ...

        @staticmethod
        def write(path: str): ...

    found = [without_types(function) for function in functions_of(Ship)]
    assert found == [["b"], ["options"], ["return"], ["return"], ["path"], ["return"]]


# what is loaded when --------------------------------------------------------------------------------------------------


def test_importing_the_package_loads_nothing_heavy():
    loaded = fresh(f"import sys, pymc_ship; print([name for name in {HEAVY!r} if name in sys.modules])")
    assert loaded.strip() == "[]"


def test_importing_the_package_takes_less_than_half_a_second():
    clock = "from time import perf_counter as now; begin = now(); import pymc_ship; print(now() - begin)"
    assert median(float(fresh(clock)) for _ in range(3)) < 0.5


def test_loading_a_vessel_and_simulating_load_no_statistics():
    work = "import sys, pymc_ship as ps; ps.simulate(ps.load_vessel('container'), ps.zigzag(20, 20), duration=1.0)"
    names = ("pymc", "pytensor", "arviz", "skopt", "matplotlib")
    assert fresh(f"{work}; print([name for name in {names!r} if name in sys.modules])").strip() == "[]"


# the package as a program ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "status"), [(["--help"], 0), (["check", "--help"], 0), (["check"], 2)])
def test_python_m_pymc_ship_is_the_command(words, status):
    command = printed(str(Path(sys.executable).with_name("pymc-ship")), *words, status=status)
    module = printed("-m", "pymc_ship", *words, status=status)
    assert module == command
    assert "pymc-ship" in "".join(module)
    assert "__main__" not in "".join(module)


# what a prompt shows of an object -------------------------------------------------------------------------------------


def empty(one, **given):
    """An object of a dataclass whose fields are tuples of many numbers, but for those given."""
    return one(**dict.fromkeys([field.name for field in fields(one)], (0.123456789,) * 1000) | given)


def shown():
    """An object of every class that is public or that a public function returns, as large as they come."""
    vessel, many = ps.load_vessel("container"), np.full(60, 1.0 / 3.0)
    data = ps.RegressionData.from_arrays(
        np.random.default_rng(1).normal(size=(300, 60)), many.repeat(5), scaling="none"
    )
    prior = ps.ConjugatePrior(mean=many, kappa=many)
    trial, exact = xr.Dataset(dict.fromkeys(("u", "v", "r", "p"), ("time", many))), prior.exact(data)
    exacts, ship = dict.fromkeys(vessel.dofs, exact), ps.Ship.from_vessel(vessel)
    return [
        ps.FitError("It failed."),
        ps.InferenceError("It failed."),
        ps.OutputError("It failed."),
        ps.ShipError("It failed."),
        ps.SimulationError("It failed."),
        ps.StudyError("It failed."),
        ps.TrialError("It failed."),
        ps.VesselError("It failed."),
        *(METRE, *CHANNELS.values()),
        *(ps.Force(), *PARTS.values(), ps.Parameter("m_x", 1.0 / 3.0, 1.0 / 7.0, "catalogue of the maker")),
        *(*KINDS.values(), *KINDS["zigzag"].indices.values()),
        vessel,
        ps.zigzag(20, 20),
        ps.Instrument(sd=dict.fromkeys(("u", "v", "r", "p", "phi", "psi"), 1 / 3), resolution={"u": 0.1, "psi": 0.01}),
        VelocityLag("late", 1.0 / 3.0, 1.0 / 7.0),
        data,
        prior,
        ps.SemiConjugatePrior(mean=many, kappa=many),
        exact,
        empty(Identification, data=dict.fromkeys(vessel.dofs, data), exact={"conjugate": exacts, "other": exacts}),
        empty(CoefficientPrior, mean=many, kind="order_damped"),
        empty(CaptiveFit, coefficients=many),
        StoppingTest(1.0 / 3.0),
        ship,
        empty(ShipIdentification, ship=ship),
        empty(SeaTrial, vessel=vessel, trials={"circle": trial}),
        ps.Estimate(many, many, many),
    ]


def test_every_public_class_is_shown_in_less_than_400_characters():
    objects = shown()
    classes = {getattr(ps, name) for name in ps.__all__ if inspect.isclass(getattr(ps, name))}
    assert {one for one in classes if not any(isinstance(value, one) for value in objects)} == set()
    assert {type(value).__name__: len(repr(value)) for value in objects if len(repr(value)) >= 400} == {}
