"""A population of ships as a study, read from TOML: what is drawn, what each ship sails and what is forecast."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pyarrow as pa

from pymc_ship import __version__
from pymc_ship.experiments.grid import manoeuvres_of, record_difference, seed_parts
from pymc_ship.experiments.methods import check_picklable, digest, import_function, import_path
from pymc_ship.experiments.store import Store
from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.toml import Entry
from pymc_ship.physics.manoeuvre.standard import Manoeuvre
from pymc_ship.ships.forecasting.stopping import MOST_ASTERN
from studies.population.judged_ship import HELD_INDEX, INDEX, INSTANT, STAGES, STOP, Draw, ShipTask, judge, unjudged
from studies.population.page import write_population

_KEYS = ("study", "title", "population", "trials", "forecasts", "astern", "ships", "root_seed")
_OPTIONAL = ("title", "astern")
_NUMBERS = {"float": pa.float64(), "str": pa.string()}


@dataclass(frozen=True)
class Trials:
    """Trials of a class of ships: all of ``manoeuvres``, or up to ``most`` of them by chance."""

    manoeuvres: tuple[Manoeuvre, ...]
    most: int = 0

    def __str__(self) -> str:
        labels = ", ".join(manoeuvre.label for manoeuvre in self.manoeuvres)
        return f"up to {self.most} of {labels}" if self.most else labels


@dataclass(frozen=True)
class TrialsCell:
    """Ships that sail the same class of trials."""

    trials: str


def _structs(columns: Mapping[str, str]) -> pa.DataType:
    """List of rows with such columns."""
    return pa.list_(pa.struct([pa.field(name, _NUMBERS[kind]) for name, kind in columns.items()]))


@dataclass(frozen=True)
class Population:
    """All ships of a study.

    Attributes
    ----------
    title : str
    draw : callable
        Of the user's own: takes a generator of random numbers and returns a
        :class:`studies.population.judged_ship.DrawnShip`.
    drawn_by : str
        Its import path.
    trials : dict of str to Trials
        By name; each is a cell.
    forecasts : dict of str to Manoeuvre
        By label.
    astern : float
        Share of the nominal revolutions by which ships are stopped; 0 for no stopping test.
    seeds : int
        Ships of each class of trials.
    root_seed : int
        Root of every random number.
    """

    title: str
    draw: Draw
    drawn_by: str
    trials: dict[str, Trials]
    forecasts: dict[str, Manoeuvre]
    astern: float
    seeds: int
    root_seed: int

    scores: ClassVar[dict[str, pa.DataType]] = {
        "hull": pa.string(),
        "runs": pa.float64(),
        "indices": _structs(INDEX),
        "instants": _structs(INSTANT),
        "held": _structs(HELD_INDEX),
        "stops": _structs(STOP),
    }
    timed: ClassVar[tuple[str, ...]] = STAGES
    work, empty = staticmethod(judge), staticmethod(unjudged)

    @classmethod
    def read(cls, file: Entry, folder: Path) -> Population:
        """Population of the table of a study.

        Raises
        ------
        StudyError
            For unknown or missing keys and values that cannot be used; the sentence names the key.
        """
        file.check_keys(_KEYS, [key for key in _KEYS if key not in _OPTIONAL])
        draw, name = _drawing(file.at("population"))
        return cls(
            title=file.at("title", "Population of ships").text(),
            draw=draw,
            drawn_by=name,
            trials=_trials(file.at("trials")),
            forecasts=_with_indices(file.at("forecasts")),
            astern=_astern(file.at("astern", 0.0)),
            seeds=file.at("ships").whole(least=1),
            root_seed=file.at("root_seed").whole(least=0),
        )

    @property
    def n_tasks(self) -> int:
        """Number of ships."""
        return len(self.trials) * self.seeds

    def remarks(self) -> list[str]:
        """Nothing to remark: its ships are drawn later."""
        return []

    def parts(self) -> Iterator[tuple[TrialsCell, range, str]]:
        """Ships of every class of trials in parts."""
        return seed_parts(map(TrialsCell, self.trials), self.seeds)

    def task(self, cell: TrialsCell, seed: int, block: str = "") -> ShipTask:
        """Task of one ship."""
        trials, forecasts = self.trials[cell.trials], tuple(self.forecasts.values())
        ship = {"trials": cell.trials, "seed": seed, "root": self.root_seed, "block": block}
        return ShipTask(self.draw, trials.manoeuvres, trials.most, forecasts, self.astern, **ship)

    def record(self) -> dict:
        """What the results depend on, as it is kept beside them."""
        return {
            "version": __version__,
            "root_seed": self.root_seed,
            "ships": self.seeds,
            "population": f"{self.drawn_by} ({digest(self.draw)})",
            "trials": {name: str(trials) for name, trials in self.trials.items()},
            "forecasts": list(self.forecasts),
            "astern": self.astern,
        }

    def difference(self, old: Mapping) -> str:
        """First thing in which the study does more than extend that of another record; empty where none does."""
        new = self.record()
        same = ("version", "root_seed", "population", "forecasts", "astern")
        lists = {"trials": (list(old["trials"]), list(new["trials"]))}
        return record_difference(old, new, same=same, grown="ships", named=("trials",), lists=lists)

    def report(self, store: Store) -> tuple[list[dict], Path]:
        """Coverage of all ships and by class of trials, and the page."""
        return write_population(store)

    def columns(self, rows: Sequence[Mapping]) -> dict[str, str]:
        """Heads of the columns that a terminal shows."""
        found = {"group": "trials", "ships": "ships", "indices": "indices"}
        found |= {"hold_95": "95 % hold", "hold_95_se": "± se", "hold_50": "50 % hold", "hold_50_se": "± se"}
        return found | {"median_error": "median error", "half_width": "half width"}


def _drawing(entry: Entry) -> tuple[Draw, str]:
    """Function that draws a ship, and its import path."""
    if isinstance(entry.value, str) and import_path(entry.value):
        draw, name = import_function(entry.value, f"{entry.file}: {entry.key}"), entry.value
    else:
        draw, name = entry.value, getattr(entry.value, "__qualname__", "")
    if not callable(draw):
        entry.fail(
            f"must be the import path module:function of what draws a ship, found {short_repr(draw)}; correct it."
        )
    check_picklable(draw, f"{entry.file}: {entry.key}")
    return draw, name


def _astern(entry: Entry) -> float:
    """Share of the nominal revolutions that a ship can have astern."""
    share = entry.number(least=0.0)
    if share > MOST_ASTERN:
        entry.fail(f"is a share of the nominal revolutions up to {MOST_ASTERN:g}, found {share:g}; lower it.")
    return share


def _trials(table: Entry) -> dict[str, Trials]:
    table.check_table()
    if not table.value:
        table.fail(
            'must name the trials of a ship, such as two = ["zigzag 10/10", "zigzag 20/20"], found none; add one.'
        )
    return {name: _one_class(table.at(name)) for name in table}


def _one_class(entry: Entry) -> Trials:
    if not isinstance(entry.value, Mapping):
        return Trials(tuple(manoeuvres_of(entry).values()))
    entry.check_keys(("most", "of"), ("most", "of"))
    found, most = tuple(manoeuvres_of(entry.at("of")).values()), entry.at("most").whole(least=1)
    if most > len(found):
        entry.fail(f"has {len(found)} trials, found most = {most}; lower it.")
    return Trials(found, most)


def _with_indices(entry: Entry) -> dict[str, Manoeuvre]:
    found = manoeuvres_of(entry)
    for label, manoeuvre in found.items():
        if not manoeuvre.traits.indices:
            entry.fail(f"must be manoeuvres that have indices, found {label!r}; leave it out.")
    return found
