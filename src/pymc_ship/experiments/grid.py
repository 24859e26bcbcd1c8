"""Grid of a Monte-Carlo study: ships x manoeuvres x noise x methods x seeds, from a TOML file."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import quote

import pyarrow as pa

from pymc_ship import __version__
from pymc_ship.experiments.methods import import_path, method_record, own_methods
from pymc_ship.experiments.page import write_report
from pymc_ship.experiments.store import Store
from pymc_ship.experiments.task import METHODS, SCORES, STAGES, Cell, Method, Task, empty_result, measure_task
from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import SimulationError, StudyError, VesselError
from pymc_ship.machine.toml import Entry
from pymc_ship.physics.manoeuvre.registry import KINDS
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, written_manoeuvre
from pymc_ship.physics.vessel.plausibility import remarks
from pymc_ship.physics.vessel.reading import load_vessel
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.files.noise import NOISES, RECORD_STEP

PART_SEEDS = 1000  # seeds of a cell whose results share a file

_KEYS = ("title", "ships", "manoeuvres", "methods", "seeds", "root_seed", "duration", "noise")
_OPTIONAL = ("title", "duration")
_LISTS = ("ships", "manoeuvres", "methods")


def seed_parts(cells: Iterable, seeds: int) -> Iterator[tuple]:
    """Cells with their seeds in parts of :data:`PART_SEEDS`, and file names ``key=value/.../seeds-FIRST``."""
    for cell in cells:
        folder = "/".join(f"{key}={quote(str(value), safe='')}" for key, value in asdict(cell).items())
        for first in range(0, seeds, PART_SEEDS):
            yield cell, range(first, min(first + PART_SEEDS, seeds)), f"{folder}/seeds-{first:06d}"


@dataclass(frozen=True)
class Grid:
    """All experiments of a study."""

    title: str
    ships: dict[str, Vessel]  # by name
    manoeuvres: dict[str, Manoeuvre]  # by label
    noise: dict[str, tuple[float, ...]]  # levels of each kind of NOISES
    methods: tuple[str, ...]  # keys of METHODS or of ``own``
    seeds: int  # data sets of each cell
    root_seed: int  # of every random number
    duration: float  # of each record [s]
    own: dict[str, Method] = field(default_factory=dict)  # user-defined methods

    scores: ClassVar[dict[str, pa.DataType]] = dict.fromkeys(SCORES, pa.float64())
    timed: ClassVar[tuple[str, ...]] = STAGES
    work, empty = staticmethod(measure_task), staticmethod(empty_result)

    @property
    def n_tasks(self) -> int:
        """Number of tasks."""
        return len(self.cells) * self.seeds

    @property
    def cells(self) -> list[Cell]:
        """All cells in the order of the results."""
        return [
            Cell(ship, manoeuvre, noise, level, method)
            for ship in self.ships
            for manoeuvre in self.manoeuvres
            for noise, levels in self.noise.items()
            for level in levels
            for method in self.methods
        ]

    def remarks(self) -> list[str]:
        """Derived values and doubtful values of the ships."""
        return [f"{name}: {sentence}" for name, ship in self.ships.items() for sentence in remarks(ship)]

    def parts(self) -> Iterator[tuple[Cell, range, str]]:
        """Every cell's seeds in parts, see :func:`seed_parts`."""
        return seed_parts(self.cells, self.seeds)

    def task(self, cell: Cell, seed: int, block: str = "") -> Task:
        """Task of one seed of a cell."""
        ship, manoeuvre = self.ships[cell.ship], self.manoeuvres[cell.manoeuvre]
        kind: dict[str, Any] = {"noise": cell.noise, "level": cell.level, "method": cell.method}
        kind |= {"own": self.own.get(cell.method), "duration": self.duration, "block": block}
        return Task(ship, manoeuvre, **kind, seed=seed, root=self.root_seed)

    def record(self) -> dict:
        """The settings that the results depend on, saved with them."""
        digests = {name: hashlib.sha256(_in_full(ship).encode()).hexdigest() for name, ship in self.ships.items()}
        return {
            "version": __version__,
            "root_seed": self.root_seed,
            "duration": self.duration,
            "seeds": self.seeds,
            "ships": digests,
            "manoeuvres": {label: _in_full(manoeuvre) for label, manoeuvre in self.manoeuvres.items()},
            "noise": {kind: list(levels) for kind, levels in self.noise.items()},
            "methods": [method_record(name, self.own.get(name)) for name in self.methods],
        }

    def difference(self, old: Mapping) -> str:
        """First setting that does not merely extend the grid of another record; empty where none."""
        new = self.record()
        lists = {key: (list(old[key]), list(new[key])) for key in (*_LISTS, "noise")}
        lists |= {f"noise.{kind}": (levels, new["noise"].get(kind, [])) for kind, levels in old["noise"].items()}
        named = ("ships", "manoeuvres")
        return record_difference(
            old, new, same=("version", "root_seed", "duration"), grown="seeds", named=named, lists=lists
        )

    def report(self, store: Store) -> tuple[list[dict], Path]:
        """Scores by cell, and the page, see :func:`pymc_ship.experiments.page.write_report`."""
        return write_report(store)

    def columns(self, rows: Sequence[Mapping]) -> dict[str, str]:
        """Heads of the columns that a terminal shows: cell, scores, number of failed tasks."""
        keys = ("ship", "manoeuvre", "noise", "level", "method")
        result = {key: key for key in keys if key == "method" or len({row[key] for row in rows}) > 1}
        heads = ("error %", "90 % intervals cover %", "50 % intervals cover %", "tactical diameter error %")
        for name, head in zip(SCORES, heads, strict=True):
            result |= {name: head, f"{name}_se": "± se"}
        return result | {"diverged": "diverged", "failed": "failed"}


def record_difference(
    old: Mapping,
    new: Mapping,
    *,
    same: Sequence[str],
    grown: str,
    named: Sequence[str],
    lists: Mapping[str, tuple[Sequence, Sequence]],
) -> str:
    """First setting in which a record does not merely extend another one, in words; empty where none.

    Values of the keys ``same`` must be equal, the number ``grown`` may grow. Tables ``named`` must agree in the entries
    of both; no value of ``lists`` (old and new, by label) may be removed.
    """
    for key in same:
        if old[key] != new[key]:
            return f"{key} was {old[key]}, found {new[key]}"
    if old[grown] > new[grown]:
        return f"{grown} was {old[grown]}, found {new[grown]}"
    for key in named:
        for name, digest in old[key].items():
            if new[key].get(name, digest) != digest:
                return f"{name!r} of {key} is not what it was"
    for key, (before, now) in lists.items():
        if lost := [value for value in before if value not in now]:
            return f"{key} had {lost[0]!r}, which is gone"
    return ""


def _in_full(value: Vessel | Manoeuvre) -> str:
    """Every attribute that the results depend on in one line; ``repr`` leaves most of them out."""
    attributes = ", ".join(f"{one.name}={getattr(value, one.name)!r}" for one in fields(value) if one.compare)
    return f"{type(value).__name__}({attributes})"


def grid_of(file: Entry, folder: Path, own: Mapping[str, Method]) -> Grid:
    """Grid of the table of a study; paths of ships are relative to ``folder``, ``own`` are user-defined methods.

    StudyError for unknown or missing keys and values that cannot be used; the sentence names the key.
    """
    file.check_keys(_KEYS, [key for key in _KEYS if key not in _OPTIONAL])
    ships, manoeuvres, methods = (file.at(key) for key in _LISTS)
    names = _methods(methods, own)
    return Grid(
        title=file.at("title", "Monte-Carlo study").text(),
        ships=_ships(ships, folder),
        manoeuvres=manoeuvres_of(manoeuvres),
        noise=_noise(file.at("noise")),
        methods=names,
        seeds=file.at("seeds").whole(least=1),
        root_seed=file.at("root_seed").whole(least=0),
        duration=file.at("duration", 400.0).number(least=RECORD_STEP),
        own=own_methods(names, own, file.file),
    )


def texts(entry: Entry) -> list[str]:
    """List of at least one text, none of them twice."""
    values = entry.value
    if not isinstance(values, list | tuple) or not values or not all(isinstance(value, str) for value in values):
        entry.fail(f"must be a list of at least one text, found {values!r}; correct it.")
    _check_once(entry, values)
    return list(values)


def _check_once(entry: Entry, values: Sequence) -> None:
    for value in values:
        if list(values).count(value) > 1:
            entry.fail(f"must name everything once, found {value!r} twice; leave one out.")


def _methods(entry: Entry, own: Mapping[str, Method]) -> tuple[str, ...]:
    """Names of the methods that a study lists, then of the user-defined ones outside the list."""
    names = texts(entry)
    for name in names:
        if not import_path(name):
            check_choice(f"{entry.file}: a method", name, (*METHODS, *own, "module:function"), StudyError)
    return tuple(dict.fromkeys([*names, *own]))


def _noise(table: Entry) -> dict[str, tuple[float, ...]]:
    if not isinstance(table.value, Mapping) or not table.value:
        table.fail(f"must be a table such as white = [0.01], found {table.value!r}; correct it.")
    result = {}
    for kind in table:
        levels = table.at(kind)
        check_choice(f"{table.file}: a kind of noise", kind, NOISES, StudyError)
        if not isinstance(levels.value, list | tuple) or not levels.value:
            levels.fail(f"must be a list of levels, found {levels.value!r}; write [0.01].")
        result[kind] = tuple(replace(levels, value=level).number(least=0.0) for level in levels.value)
        _check_once(levels, result[kind])
    return result


def _ships(entry: Entry, folder: Path) -> dict[str, Vessel]:
    ships = {}
    for source in texts(entry):
        try:
            ship = load_vessel(folder / source if source.endswith(".toml") else source)
            ship.check_model()
        except VesselError as error:
            raise StudyError(f"{entry.file}: ships cannot have {source!r}: {error}") from None
        if ship.name in ships:
            entry.fail(f"must have different names, found {ship.name!r} twice; rename one.")
        ships[ship.name] = ship
    return ships


def manoeuvres_of(entry: Entry) -> dict[str, Manoeuvre]:
    """Manoeuvres of a list of labels by label, each once."""
    result: dict[str, Manoeuvre] = {}
    for text in texts(entry):
        try:
            manoeuvre = written_manoeuvre(text)
        except SimulationError as error:
            raise StudyError(f"{entry.file}: {entry.key} cannot have {text!r}: {error}") from None
        if manoeuvre is None:
            examples = ", ".join(f"'{kind.words} {kind.example}'" for kind in KINDS.values() if kind.angles)
            raise StudyError(
                f"{entry.file}: a manoeuvre is {examples} or one of them with its side, found {text!r}; write it so."
            )
        _check_once(entry, [*result, manoeuvre.label])
        result[manoeuvre.label] = manoeuvre
    return result
