"""The shape of the package: layers, what is loaded when, sizes, and where things may stand."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path
from statistics import median

import pytest

import pymc_ship as ps

PACKAGE = Path(ps.__file__).parent
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")

LAYERS = (
    "toml_file",
    "threads",
    "terms",
    "prime_system",
    "propeller",
    "vessel",
    "term_sets",
    "hull_database",
    "manoeuvres",
    "candidates",
    "equations_of_motion",
    "output",
    "trial",
    "recognised",
    "trial_columns",
    "trial_format",
    "trial_time",
    "trial_file",
    "simulate",
    "sensitivities",
    "closed_loop",
    "noise",
    "spike_and_slab",
    "ebayes",
    "denoise",
    "indices",
    "imo_verdict",
    "weak_form",
    "regression_data",
    "streamed_regression",
    "priors",
    "prior_table",
    "posterior",
    "trajectory_data",
    "check_verdicts",
    "kinematic_closure",
    "rudder_checks",
    "record_quality",
    "excitation_checks",
    "trial_checks",
    "trajectory_prior",
    "trajectory_fit",
    "identifiability",
    "trajectory_noise",
    "trajectory_mode",
    "trajectory_posterior",
    "soundness",
    "window_fit",
    "measured_manoeuvre",
    "held_out",
    "model_error",
    "ship_model",
    "ship_paths",
    "error_laws",
    "predictive",
    "rotation",
    "quadrature",
    "conjugate",
    "semiconjugate",
    "gibbs",
    "cross_validation",
    "tune",
    "identification",
    "error_models",
    "pymc_model",
    "trajectory_op",
    "trajectory_model",
    "diagnostics",
    "trajectory_diagnostics",
    "agreement",
    "calibration",
    "extrapolation",
    "forecast",
    "ship_files",
    "trial_design",
    "tables",
    "estimates",
    "replication",
    "study",
    "figures",
    "page_tables",
    "diagnostic_figures",
    "diagnostic_parts",
    "trajectory_figures",
    "trajectory_parts",
    "diagnostic_report",
    "study_tables",
    "bound_chapter",
    "findings",
    "report",
    "manoeuvre_track",
    "manoeuvre_figures",
    "forecast_report",
    "ship_figures",
    "ship_report",
    "frontier_data",
    "frontier",
    "frontier_tables",
    "frontier_figures",
    "frontier_report",
    "montecarlo_task",
    "montecarlo_grid",
    "montecarlo_store",
    "montecarlo_workers",
    "montecarlo_tables",
    "montecarlo_figures",
    "montecarlo_report",
    "montecarlo",
    "command_texts",
    "command_files",
    "ship_commands",
    "commands",
    "command_words",
    "command_parser",
    "cli",
)
"""A module imports only from modules above it."""

HEAVY = ("pymc", "pytensor", "numba", "arviz", "skopt", "matplotlib", "scipy", "pandas", "xarray", "nutpie")
HOSTS = (
    "pypi.org",
    "pythonhosted.org",
    "anaconda.org",
    "anaconda.com",
    "conda-forge.org",
    "npmjs.",
    "proxy.golang.org",
)


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imported(path):
    """Dotted names of everything a file imports, at any depth; a relative import counts from the package."""
    names = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = ".".join(filter(None, ["pymc_ship" if node.level else "", node.module]))
            names.update(f"{module}.{alias.name}" for alias in node.names)
    return names


def neighbours(path):
    """Modules of the package that a file imports."""
    return {name.split(".")[1] for name in imported(path) if name.startswith("pymc_ship.")} - {"__version__"}


def violations(module, others):
    """Those of the other modules that do not stand above a module."""
    above = LAYERS[: LAYERS.index(module)]
    return sorted(set(others) - set(above))


def fresh(code, *options):
    """Run code in a new interpreter; return what it prints."""
    command = [sys.executable, *options, "-c", code]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_a_module_stands_in_the_list_and_imports_only_from_above(path):
    assert path.stem in LAYERS
    assert violations(path.stem, neighbours(path)) == []


def test_the_check_of_layers_can_fail(tmp_path):
    """Imports at the top, in a function, of a module and from the package are all seen."""
    path = tmp_path / "trial.py"
    path.write_text(
        "import pymc_ship.noise\nfrom pymc_ship import simulate\nfrom . import cli\n"
        "def f():\n    from pymc_ship.study import study\n    from .output import staged\n"
    )
    assert violations("trial", neighbours(path)) == ["cli", "noise", "simulate", "study"]


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


@pytest.mark.parametrize("library", ["pymc", "pytensor", "nutpie"])
def test_only_the_models_of_pymc_import_it(library):
    importers = {path.stem for path in MODULES if any(name.split(".")[0] == library for name in imported(path))}
    assert importers <= {"pymc_model", "error_models", "trajectory_model", "trajectory_op"}


PUBLIC = [name for name in ps.__all__ if name != "__version__" and (PACKAGE / f"{ps._MODULE_OF[name]}.py").is_file()]


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_resolves_and_has_a_docstring(name):
    value = getattr(ps, name)
    assert callable(value)
    assert value.__name__ == name
    assert value.__module__ == f"pymc_ship.{ps._MODULE_OF[name]}"
    assert inspect.getdoc(value)


def test_public_names_are_listed_once_and_unknown_ones_are_attribute_errors():
    assert len(set(ps.__all__)) == len(ps.__all__)
    assert set(ps.__all__) <= set(dir(ps))
    assert ps.__version__
    with pytest.raises(AttributeError, match="'pymc_ship' has no attribute 'anchor'"):
        ps.anchor  # noqa: B018


def test_a_public_function_wins_over_the_module_of_its_name():
    code = "import pymc_ship.simulate, pymc_ship.noise, pymc_ship as ps; from pymc_ship import simulate, noise"
    found = fresh(f"{code}; print(type(ps.simulate).__name__, type(simulate).__name__, type(noise).__name__)")
    assert found.split() == ["function", "function", "module"]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_a_file_has_at_most_400_lines_and_a_docstring(path):
    lines = path.read_text(encoding="utf-8").count("\n")
    assert lines <= 400
    assert ast.get_docstring(tree(path))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_only_the_command_line_prints(path):
    calls = [node for node in ast.walk(tree(path)) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    printed = [node.lineno for node in calls if node.func.id == "print"]
    assert printed == [] or path.name == "cli.py"


def test_no_host_name_of_a_registry_stands_in_the_sources():
    files = [path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    found = [(path.name, host) for path in files for host in HOSTS if host.encode() in path.read_bytes()]
    assert len(files) > 10
    assert found == []


def test_folders_hold_only_what_is_needed():
    """No drawer of odds and ends: a file is one noun of the field."""
    drawers = {"utils", "helpers", "common", "misc", "core", "base", "manager", "types", "new"}
    assert drawers.isdisjoint(path.stem for path in MODULES)


def test_pools_of_threads_are_made_in_one_place():
    """Else a worker of a study could not keep to one thread."""
    assert [path.stem for path in MODULES if "ThreadPoolExecutor" in path.read_text(encoding="utf-8")] == ["threads"]
