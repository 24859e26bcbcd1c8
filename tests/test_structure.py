"""The shape of the package: districts, wings and what each may import, sizes, and where things may stand."""

from __future__ import annotations

import ast
import re
from functools import lru_cache
from pathlib import Path

import pytest

import pymc_ship as ps

PACKAGE = Path(ps.__file__).parent
TESTS = Path(__file__).parent
ROOMS = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py" and path.parent != PACKAGE)
FACES = sorted(path for path in PACKAGE.rglob("__init__.py") if path.parent != PACKAGE)

DISTRICTS = {
    "machine": (),
    "pages": (),
    "trial": (),
    "physics": ("forces", "vessel", "manoeuvre", "motion"),
    "records": ("files", "denoising", "steering", "checks"),
    "inference": ("rows", "regression", "trajectory", "captive", "sampling", "identifiability"),
    "ships": ("ensemble", "forecasting", "design", "identification", "sea_trials"),
    "diagnostics": (),
    "replication": (),
    "experiments": (),
    "cli": (),
}
"""The districts from the ground up, and the wings of each: a row imports only rows before it, a wing only wings before
it. A district without wings is one wing itself."""

WINGS = [f"{name}.{wing}" if wing else name for name, wings in DISTRICTS.items() for wing in wings or ("",)]
"""The folders with rooms, from the ground up."""

SAMPLERS = ("pymc", "pytensor", "nutpie")
HOSTS = (
    "pypi.org",
    "pythonhosted.org",
    "anaconda.org",
    "anaconda.com",
    "conda-forge.org",
    "npmjs.",
    "proxy.golang.org",
)


TESTED_BY = {
    "cli.check_page": "cli/test_check.py: the page of a check",
    "cli.commands": "journeys/test_cli.py: every command as a user calls it",
    "cli.examples": "cli/test_parser.py: every example is parsed",
    "cli.files": "journeys/test_cli_errors.py: files that a command cannot read",
    "cli.texts": "journeys/test_cli.py: what the commands print",
    "cli.argument_types": "journeys/test_cli_errors.py: words that are no values",
    "diagnostics.figures": "diagnostics/test_regression.py: drawn with the subsection that shows them",
    "diagnostics.group_subsections": "inference/sampling/test_hierarchical_model.py: the page of two ships",
    "diagnostics.posterior_statistics": "diagnostics/test_regression.py: the numbers of every subsection",
    "diagnostics.regression_subsections": "diagnostics/test_subsections.py: the subsections of both kinds of posterior",
    "experiments.figures": "experiments/test_page.py: drawn with the page",
    "experiments.study": "experiments/test_run.py: the protocol that a run follows",
    "inference.regression.calibration": "consistency/test_calibration.py: every way to a posterior is calibrated",
    "inference.regression.families": "inference/regression/test_new_prior.py: a family that is registered",
    "inference.regression.priors": "inference/regression/test_new_prior.py: a prior of one's own",
    "inference.rows.from_trials": "inference/rows/test_data.py: the rows of a trial",
    "inference.sampling.linear_coordinates": "inference/sampling/test_regression_model.py: chains start at the fit",
    "inference.sampling.prior_laws": "inference/sampling/test_from_pymc.py: priors that are stated in PyMC",
    "inference.trajectory.mode": "inference/trajectory/test_posterior.py: the fit before the draws",
    "machine.workers": "experiments/test_run.py: workers of a grid",
    "pages.drawing": "pages/test_page.py: the look of every figure",
    "physics.forces.hull": "physics/forces/test_parts.py: a part against its formula",
    "physics.forces.hull_database": "physics/vessel/test_hull_database.py: the prior it gives a vessel",
    "physics.forces.modular": "physics/forces/test_parts.py: the parts together",
    "physics.forces.part": "physics/forces/test_parts.py: what every part has",
    "physics.forces.programs": "physics/forces/test_expressions.py: programs of expressions",
    "physics.forces.rudder": "physics/forces/test_parts.py: a part against its formula",
    "physics.forces.screw": "physics/forces/test_parts.py: a part against its formula",
    "physics.forces.surroundings": "physics/forces/test_parts.py: a part against its formula",
    "physics.manoeuvre.registry": "physics/manoeuvre/test_new_manoeuvre.py: a kind that is registered",
    "physics.manoeuvre.turning_circles": "physics/manoeuvre/test_indices.py: indices of every kind",
    "physics.manoeuvre.zigzags": "physics/manoeuvre/test_indices.py: indices of every kind",
    "physics.motion.inputs": "physics/motion/test_parts.py: wind, current and revolutions of a simulation",
    "physics.motion.linearisation": "physics/motion/test_sensitivities.py: against differences of the motion",
    "physics.motion.replay": "physics/motion/test_simulation.py: against the simulation",
    "records.checks.verdicts": "records/checks/test_trial_checks.py: verdicts of all checks",
    "records.denoising.wavelet_posterior": "records/denoising/test_draws.py: draws of the coefficients",
    "records.denoising.spike_and_slab": "records/denoising/test_ebayes.py: against published values",
    "records.files.text_rows": "records/files/test_reading.py: text of every layout",
    "replication.tables": "replication/test_study.py: tables of the study",
    "ships.design.outlook": "ships/design/test_next_run.py: expected widths",
    "ships.ensemble.index_table": "ships/identification/test_score_page.py: the table on its page",
    "ships.ensemble.scores": "ships/forecasting/test_forecast.py: scores of a forecast",
    "ships.identification.open_loop": "ships/identification/test_replay.py: runs along their records",
    "ships.sea_trials.figures": "ships/sea_trials/test_page.py: drawn with the page",
    "ships.sea_trials.form": "ships/sea_trials/test_page.py: the form of the page",
    "ships.sea_trials.sea_trial": "ships/sea_trials/test_corrections.py: runs measured and corrected",
    "trial.units": "records/files/test_columns.py: units of columns",
}
"""Rooms without a test of their name, and the test through which they are tested instead."""


@lru_cache(maxsize=1)
def parsed(text):
    """Nodes of a file, the file itself first; kept for the tests of one file, which run one after the other."""
    return list(ast.walk(ast.parse(text)))


def nodes(path):
    return parsed(path.read_text(encoding="utf-8"))


def imported(path):
    """Dotted names of everything a file imports, at any depth; a relative import counts from the package."""
    names = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = ".".join(filter(None, ["pymc_ship" if node.level else "", node.module]))
            names.update(f"{module}.{alias.name}" for alias in node.names)
    return names


def inside(path):
    """What a file imports from the package, without the name of the package; the package itself is an empty text."""
    names = {name.removeprefix("pymc_ship").strip(".") for name in imported(path) if name.split(".")[0] == "pymc_ship"}
    return names - {"__version__"}


def wing(path):
    """Dotted name of the folder of a room, or of a face."""
    return ".".join(path.parent.relative_to(PACKAGE).parts)


def wing_of(module):
    """The wing in which a dotted module stands, by the longest name that fits; a district for its own face."""
    return max((name for name in [*WINGS, *DISTRICTS] if f"{module}.".startswith(f"{name}.")), key=len, default=module)


def violations(name, path):
    """Names that a file of a wing imports although they stand above it or are no wing; only the commands use ``ps``."""
    below = {*WINGS[: WINGS.index(name) + 1], *({""} if name == "cli" else set())}
    return sorted(other for other in inside(path) if wing_of(other) not in below)


def circle(imports):
    """Files of a circle of imports, given the files that each file imports; empty where there is none."""
    done, open_ = set(), []

    def visit(room):
        if room in open_:
            return open_[open_.index(room) :]
        if room in done:
            return []
        open_.append(room)
        found = next(filter(None, map(visit, sorted(imports.get(room, ())))), [])
        open_.pop()
        done.add(room)
        return found

    return next(filter(None, map(visit, sorted(imports))), [])


def too_many_or_few(rooms):
    """Wings without 2 to 12 rooms, with their number."""
    counts = {name: sum(wing(path) == name for path in rooms) for name in WINGS}
    return {name: count for name, count in counts.items() if not 2 <= count <= 12}


def faults_of_a_face(path):
    """What a face has that it should not have."""
    text = path.read_text(encoding="utf-8")
    faults = ["long"] if text.count("\n") >= 40 else []
    faults += ["imports"] if imported(path) else []
    return faults + ([] if ast.get_docstring(nodes(path)[0]) else ["silent"])


def faults_of_a_file(path):
    """A file has at most 600 lines, of one subject; one of the package has a docstring."""
    faults = ["long"] if path.read_text(encoding="utf-8").count("\n") > 600 else []
    return faults + ([] if ast.get_docstring(nodes(path)[0]) or path.name.startswith("test_") else ["silent"])


def printed(path):
    """Lines of a file that call ``print``."""
    calls = [node for node in nodes(path) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    return [node.lineno for node in calls if node.func.id == "print"]


def samplers(path):
    """Libraries of Markov chains that a file imports."""
    return sorted({name.split(".")[0] for name in imported(path)} & set(SAMPLERS))


def private(path):
    """Private names that a file imports from another."""
    return sorted(name for name in inside(path) if name.split(".")[-1].startswith("_"))


def crowded(path):
    """Lines of a file with a call of more than six positional arguments, or five or more names unpacked by position."""
    lines = [node.lineno for node in nodes(path) if isinstance(node, ast.Call) and len(node.args) > 6]
    targets = [target for node in nodes(path) if isinstance(node, ast.Assign) for target in node.targets]
    targets += [node.target for node in nodes(path) if isinstance(node, ast.For | ast.comprehension)]
    parts = [part for target in targets for part in ast.walk(target) if isinstance(part, ast.Tuple)]
    return sorted(lines + [part.lineno for part in parts if len(part.elts) > 4])


def wordings(path):
    """Lines of a test file that check the words of an error, or 0 for a table of them under another name."""
    calls = [node for node in nodes(path) if isinstance(node, ast.Call)]
    calls = [node for node in calls if any(keyword.arg == "match" for keyword in node.keywords)]
    names = ("pytest.raises", "pytest.warns", "raises")
    found = sorted(node.lineno for node in calls if ast.unparse(node.func) in names)
    return found + ([0] if "tests.sentences.wording" in imported(path) and path.name != "test_wording.py" else [])


def written(folder, text, name="room.py"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def label(path):
    return str(path.relative_to(PACKAGE if PACKAGE in path.parents else TESTS))


# wings ----------------------------------------------------------------------------------------------------------------


def test_the_folders_are_the_districts_and_their_wings():
    assert sorted(map(wing, FACES)) == sorted({*WINGS, *DISTRICTS})
    assert {wing(path) for path in ROOMS} == set(WINGS)
    assert {path.name for path in PACKAGE.glob("*.py")} == {"__init__.py", "__main__.py"}


@pytest.mark.parametrize("path", ROOMS, ids=label, scope="module")
def test_a_room_imports_only_wings_before_its_own(path):
    assert violations(wing(path), path) == []
    assert private(path) == []


def test_the_check_of_wings_can_fail(tmp_path):
    """Imports at the top, in a function, of a module, of a private name and from the package are all seen."""
    path = written(
        tmp_path,
        "import pymc_ship.cli.main\nfrom pymc_ship import simulate\nfrom . import ships\nimport pymc_ship as ps\n"
        "from pymc_ship.records.checks.lag import common_lag\n"
        "def f():\n    from pymc_ship.cli.argument_types import seed\n    from .machine.files import _staged\n",
    )
    names = ["", "cli.argument_types.seed", "cli.main", "records.checks.lag.common_lag", "ships", "simulate"]
    assert violations("trial", path) == names
    assert violations("records.denoising", path) == names
    assert violations("records.checks", path) == [name for name in names if "lag" not in name]
    assert private(path) == ["machine.files._staged"]


def test_no_files_import_each_other_in_a_circle():
    rooms = {f"{wing(path)}.{path.stem}" for path in ROOMS}
    imports = {
        f"{wing(path)}.{path.stem}": {
            room for name in inside(path) for room in rooms if f"{name}.".startswith(f"{room}.")
        }
        for path in ROOMS
    }
    assert sum(map(len, imports.values())) > 100
    assert circle(imports) == []


def test_the_check_of_circles_can_fail():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c"]


def test_a_wing_has_2_to_12_rooms():
    assert too_many_or_few(ROOMS) == {}


def test_the_check_of_rooms_can_fail():
    rooms = [path for path in ROOMS if wing(path) != "pages"]
    rooms += [PACKAGE / "physics" / "forces" / f"{k}.py" for k in range(12)]
    assert set(too_many_or_few(rooms)) == {"pages", "physics.forces"}


@pytest.mark.parametrize("path", FACES, ids=wing)
def test_a_face_says_what_its_wing_is_for_and_imports_nothing(path):
    assert faults_of_a_face(path) == []
    named = re.findall(r"^- `(\w+)`: ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    held = [name.split(".")[1] for name in WINGS if name.startswith(f"{wing(path)}.")]
    assert sorted(named) == sorted(held or [room.stem for room in ROOMS if wing(room) == wing(path)])


def test_the_check_of_faces_can_fail(tmp_path):
    assert faults_of_a_face(written(tmp_path, '"""A face."""\nfrom . import room\n')) == ["imports"]
    assert faults_of_a_face(written(tmp_path, "\n" * 40)) == ["long", "silent"]


# files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", [*ROOMS, *sorted(TESTS.rglob("*.py"))], ids=label, scope="module")
def test_a_file_has_at_most_600_lines_and_a_docstring(path):
    assert faults_of_a_file(path) == []


def test_the_check_of_files_can_fail(tmp_path):
    assert faults_of_a_file(written(tmp_path, '"""A room."""\n' + "x = 1\n" * 599)) == []
    assert faults_of_a_file(written(tmp_path, "x = 1\n" * 601)) == ["long", "silent"]


@pytest.mark.parametrize("path", ROOMS, ids=label, scope="module")
def test_no_line_of_a_file_counts_many_things_by_position(path):
    assert crowded(path) == []


def test_the_check_of_positions_can_fail(tmp_path):
    path = written(
        tmp_path,
        "f(1, 2, 3, 4, 5, 6, g=7)\nf(1, 2, 3, 4, 5, 6, 7)\na, b, c, d = x\na, b, c, d, e = x\n"
        "for k, (a, b, c, d, e) in x:\n    pass\nx = [a for a, b, c, d, e in x]\n",
    )
    assert crowded(path) == [2, 4, 5, 7]


@pytest.mark.parametrize("path", ROOMS, ids=label, scope="module")
def test_only_the_command_line_prints(path):
    assert printed(path) == [] or wing(path) == "cli"


@pytest.mark.parametrize("path", ROOMS, ids=label, scope="module")
def test_only_the_samplers_import_pymc(path):
    assert samplers(path) == [] or wing(path) == "inference.sampling"


def test_the_checks_of_prints_and_samplers_can_fail(tmp_path):
    path = written(
        tmp_path, "def f():\n    import pymc as pm\n    from pytensor import tensor\n    print(pm, tensor)\n"
    )
    assert printed(path) == [4]
    assert samplers(path) == ["pymc", "pytensor"]


@pytest.mark.parametrize("path", sorted(TESTS.rglob("test_*.py")), ids=label, scope="module")
def test_the_words_of_an_error_are_checked_in_the_table_of_its_wing_alone(path):
    """Else no word can be mended: elsewhere a test checks the class and, with ``refused``, numbers and names."""
    assert wordings(path) == []


def without_a_test(rooms, tested_by):
    """Rooms that have neither a test of their name nor a row, and rows that are not needed or name no test."""
    own = {f"{wing(room)}.{room.stem}": TESTS.joinpath(*wing(room).split("."), f"test_{room.name}") for room in rooms}
    bare = {name for name, path in own.items() if not path.is_file()}
    tests = {name: TESTS / row.split(": ")[0] for name, row in tested_by.items()}
    return sorted(bare ^ set(tests) | {name for name, path in tests.items() if not path.is_file()})


def test_a_room_has_a_test_of_its_name_or_a_row():
    assert without_a_test(ROOMS, TESTED_BY) == []


def test_the_check_of_rooms_and_tests_can_fail():
    first = next(iter(TESTED_BY))
    rows = {name: row for name, row in TESTED_BY.items() if name != first}
    changed = {"cli.nowhere": "cli/test_main.py: no room", "trial.units": "trial/test_units.py: no test"}
    assert without_a_test(ROOMS, rows | changed) == sorted([first, *changed])


def test_the_check_of_words_can_fail(tmp_path):
    text = "with raises(ValueError, match='a'):\n    f(match=1)\nwith pytest.raises(E, match=b):\n    1\n"
    assert wordings(written(tmp_path, text)) == [1, 3]
    text = "from tests.sentences import wording\n"
    assert wordings(written(tmp_path, text)) == [0]
    assert wordings(written(tmp_path, text, "test_wording.py")) == []


def test_folders_hold_only_what_is_needed():
    """No drawer of odds and ends: a folder and a file is one noun of the field."""
    drawers = {"utils", "helpers", "common", "misc", "core", "base", "manager", "types", "new"}
    assert drawers.isdisjoint({*(path.stem for path in ROOMS), *(path.parent.name for path in FACES)})


def test_no_district_has_the_name_of_a_public_function():
    """Else the folder would hide the function, or the function the folder."""
    assert set(DISTRICTS).isdisjoint(ps.__all__)


def test_pools_of_threads_are_made_in_one_place():
    """Else a worker of a study could not keep to one thread."""
    assert [path.stem for path in ROOMS if "ThreadPoolExecutor" in path.read_text(encoding="utf-8")] == ["threads"]


def test_no_host_name_of_a_registry_stands_in_the_sources():
    files = [path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    found = [(path.name, host) for path in files for host in HOSTS if host.encode() in path.read_bytes()]
    assert len(files) > 10
    assert found == []
