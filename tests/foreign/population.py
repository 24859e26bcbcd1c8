"""Ships nobody has seen: drawn around the foreign ones, sailed, identified and scored: ``make population``.

A ship is one of four by published equations with every force coefficient changed by chance, the two of the MMG method
at another scale, too; the four themselves are not among them. The trials she sails, the weather and what her papers
state are drawn, too. Thirty ships, numbers 0 to 29, have been used to choose how intervals grow beyond the motion of
the runs; the others show what that is worth.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar

import pymc_ship as ps
from pymc_ship.forecasting.index_error import BEYOND, index_scale, robust_sd
from pymc_ship.machine.files import staged, writable_folder
from pymc_ship.machine.seeds import generator
from pymc_ship.machine.threads import one_thread
from tests.foreign import mariner, mmg, s175, sailing
from tests.foreign.run import ROOT, table
from tests.foreign.sailing import CALM, SENSORS, Trial, Weather

HULLS = ("tanker", "bulk carrier", "mariner", "s175")
_SCATTER = {"hull": 0.2, "rudder": 0.12, "roll": 0.1}
_SCALES = (0.6, 1.2)


def _zigzag(angle: float, side: str = "starboard") -> Trial:
    return Trial("zigzag", angle, angle, side)


TRIALS = {
    "one 20/20": (_zigzag(20.0),),
    "10/10 to both sides": (_zigzag(10.0), _zigzag(10.0, "port")),
    "20/20 to both sides": (_zigzag(20.0), _zigzag(20.0, "port")),
    "20/20 and 10/10": (_zigzag(20.0), _zigzag(10.0, "port")),
    "20/20 and a circle": (_zigzag(20.0), Trial("circle", 35.0, side="port")),
    "10/10 and 20/20 to both sides": tuple(_zigzag(angle, side) for angle in (10.0, 20.0) for side in sailing.SIDES),
}
"""Trials by name."""

CHOSEN_ON = 30
"""Number of ships that :data:`pymc_ship.forecasting.index_error.BEYOND` was chosen on."""

LEADS = (1.0, 5.0, 15.0)
"""Lengths of restarted windows [L/U]."""

STATED = (0.75, 0.9, 0.95, 0.99)
"""Probabilities of statements "at most" and "at least" that are counted."""

SEED = 16
_TRIED = 40


@dataclass(frozen=True)
class Drawn:
    """A ship of the population and what is known of her."""

    number: int
    hull: str
    ship: object
    trials: str
    weather: Weather
    ground: bool
    propeller: bool
    truth: dict[str, dict[str, float]]

    def records(self, seed: int) -> list[xr.Dataset]:
        """Records of her runs, each on a course and with noise of its own."""
        unit = self.ship.papers.unit
        return [
            sailing.sail(
                self.ship,
                trial,
                self.weather,
                course_deg=90.0 * k,
                duration=(14.0 if trial.kind == "circle" else 20.0) * unit,
                ground=self.ground,
                sensors=SENSORS,
                seed=1000 * seed + 10 * self.number + k,
            )
            for k, trial in enumerate(TRIALS[self.trials])
        ]


def drawn(number: int, seed: int) -> Drawn:
    """Draw a ship that turns and checks her yaw as ships do, and her trials.

    Raises
    ------
    RuntimeError
        Where none of many draws does.
    """
    rng = generator(seed, "population of ships", number)
    hull = HULLS[(number // 2) % len(HULLS)]
    for _ in range(_TRIED):
        ship = _ship(hull, rng)
        try:
            truth = sailing.truth(ship)
        except (ValueError, OverflowError, ZeroDivisionError):
            continue
        if _usual(truth, ship.papers.L):
            break
    else:
        raise RuntimeError(f"None of {_TRIED} draws of ship {number} sails all judged manoeuvres.")
    trials = list(TRIALS)[int(rng.integers(len(TRIALS)))]
    sky = int(rng.integers(4))
    angle = float(rng.uniform(0.0, 360.0))
    weather = {0: Weather(wind=8.0, wind_from_deg=angle), 1: Weather(current=0.5, current_to_deg=angle)}.get(sky, CALM)
    return Drawn(number, hull, ship, trials, weather, sky == 1, bool(rng.random() < 0.75), truth)


def _usual(truth: dict[str, dict[str, float]], L: float) -> bool:
    diameters = [row["tactical_diameter"] / L for row in truth.values() if "tactical_diameter" in row]
    overshoots = [row["second_overshoot_angle"] for row in truth.values() if "second_overshoot_angle" in row]
    return min(diameters) > 2.0 and max(diameters) < 6.0 and max(overshoots) < 40.0


def _changed(terms, sd: float, rng: np.random.Generator):
    """Coefficients each times a factor of median 1."""
    pairs = terms.items() if isinstance(terms, dict) else terms
    found = [(name, value * math.exp(sd * rng.standard_normal())) for name, value in pairs]
    return dict(found) if isinstance(terms, dict) else tuple(found)


def _ship(hull: str, rng: np.random.Generator):
    if hull == "mariner":
        rows = [_changed(terms, _SCATTER["hull"], rng) for terms in (mariner.SURGE, mariner.SWAY, mariner.YAW)]
        return mariner.Mariner(rows=tuple(rows))
    if hull == "s175":
        sds = [_SCATTER["hull"], _SCATTER["hull"], _SCATTER["roll"], _SCATTER["hull"]]
        rows = [_changed(row, sd, rng) for row, sd in zip(s175.ROWS, sds, strict=True)]
        # the straight course stays in balance
        rows[0]["uu"] = s175.SURGE["uu"]
        return s175.S175(GM=float(rng.uniform(0.3, 1.0)), rows=tuple(rows))
    return _mmg_ship(mmg.kvlcc2() if hull == "tanker" else mmg.cargo(), rng)


def _mmg_ship(ship: mmg.MmgShip, rng: np.random.Generator) -> mmg.MmgShip:
    def factor(sd: float) -> float:
        return math.exp(sd * rng.standard_normal())

    hull = replace(ship.hull, **{row: _changed(getattr(ship.hull, row), _SCATTER["hull"], rng) for row in "XYN"})
    names = ("f_alpha", "epsilon", "gamma_port", "gamma_starboard", "l_R", "t_R", "a_H", "x_H")
    rudder = replace(ship.rudder, **{name: getattr(ship.rudder, name) * factor(_SCATTER["rudder"]) for name in names})
    wake = replace(ship.wake, port=ship.wake.port * factor(0.1), starboard=ship.wake.starboard * factor(0.1))
    ship = replace(ship, hull=hull, rudder=rudder, wake=wake, m_y=ship.m_y * factor(0.1), J_zz=ship.J_zz * factor(0.1))
    return scaled(ship, float(rng.uniform(*_SCALES)))


def scaled(ship: mmg.MmgShip, scale: float) -> mmg.MmgShip:
    """The ship at another scale and the same Froude number."""
    p, speed = ship.papers, math.sqrt(scale)
    lengths = {name: scale * getattr(p, name) for name in ("L", "B", "d", "x_G", "rudder_height")}
    areas = {name: scale**2 * getattr(p, name) for name in ("rudder_area", "frontal_area", "lateral_area")}
    propeller = p.propeller | {"D": scale * p.propeller["D"], "n": p.propeller["n"] / speed}
    papers = replace(p, **lengths, **areas, volume=scale**3 * p.volume, speed=speed * p.speed, propeller=propeller)
    return replace(ship, papers=papers, rudder=replace(ship.rudder, area=scale**2 * ship.rudder.area))


@dataclass(frozen=True)
class Row:
    """An index of a forecast beside the truth, in swings of heading or L; ``beyond`` in ranges of the runs' motion.

    ``sd`` is half the width of the central 68 % of the forecast, ``pit`` the share of its draws below the truth,
    ``crps`` its continuous ranked probability score.
    """

    number: int
    hull: str
    trials: str
    manoeuvre: str
    index: str
    error: float
    lower: float
    upper: float
    sd: float
    beyond: float
    pit: float
    crps: float

    @property
    def inside(self) -> bool:
        return self.lower <= 0.0 <= self.upper

    @property
    def half(self) -> bool:
        """Whether an interval of 50 % of the normal law of this sd holds the truth."""
        return abs(self.error) < 0.6745 * self.sd


@dataclass(frozen=True)
class Bands:
    """Share of the instants inside bands of 90 % of a ship that is restarted in a run she has not seen, by lead."""

    number: int
    lead: float
    held: float


@dataclass(frozen=True)
class Judged:
    """What became of a ship: her indices and bands, or the sentence of her refusal."""

    rows: Sequence[Row] = ()
    bands: Sequence[Bands] = ()
    refusal: str = ""


def judged(number: int, seed: int = SEED) -> Judged:
    """Identify a ship of the population and compare her forecasts with her own motion."""
    one = drawn(number, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "vessel.toml"
        path.write_text(sailing.vessel_file(one.ship, propeller=one.propeller), encoding="utf-8")
        try:
            trials = [ps.judged_trial(record, path) for record in one.records(seed)]
            ship = ps.identify_ship(trials, path, rng=seed)
        except ValueError as error:
            return Judged(refusal=str(error))
    return Judged([row for trial in sailing.JUDGED for row in _rows(one, ship, trial, seed)], _bands(one, ship, seed))


def _bands(one: Drawn, ship: ps.ShipModel, seed: int) -> list[Bands]:
    """Bands in a 15/15 zigzag and a circle that begins in it, calm and as the sensors read them."""
    unit, noise = one.ship.papers.unit, 1000 * seed + 10 * one.number + 9
    runs = [sailing.sail(one.ship, trial, sensors=SENSORS, seed=noise) for trial in sailing.JUDGED[::2]]
    scores = {lead: ps.score(ship, runs, length=lead * unit, every=2.0 * unit) for lead in LEADS}
    return [Bands(one.number, lead, float(score["coverage"].mean())) for lead, score in scores.items()]


def _rows(one: Drawn, ship: ps.ShipModel, trial: Trial, seed: int) -> list[Row]:
    if trial.kind == "circle":
        manoeuvre = ps.turning_circle(trial.rudder, side=trial.side)
    else:
        manoeuvre = ps.zigzag(trial.rudder, trial.heading, side=trial.side)
    tree = ps.forecast_ship(ship, manoeuvre, rng=seed)
    beyond = float(np.nanmax(tree["extrapolation"]["distance"]))
    found = []
    for name, truth in one.truth[trial.label].items():
        quantity = manoeuvre.traits.indices[name].quantity
        scale = index_scale(quantity, truth, trial.heading, ship.vessel)
        lower, median, upper = ((tree["index_bands"][name].values - truth) / scale).tolist()
        drawn = tree["indices"][name].values
        drawn = (drawn[np.isfinite(drawn)] - truth) / scale
        spread = float(np.abs(drawn[:, None] - drawn).mean())
        known = {"sd": robust_sd(drawn), "pit": float(np.mean(drawn < 0.0)), "beyond": beyond}
        known["crps"] = float(np.abs(drawn).mean()) - 0.5 * spread
        what = (one.number, one.hull, one.trials, trial.label, name)
        found.append(Row(*what, error=median, lower=lower, upper=upper, **known))
    return found


def fitted_beyond(rows: Sequence[Row]) -> float:
    """The value of BEYOND at which the errors are most probable."""
    error, sd, beyond = (np.array([getattr(row, name) for row in rows]) for name in ("error", "sd", "beyond"))
    known = np.maximum(sd**2 - (BEYOND * beyond) ** 2, 1e-8)

    def surprise(share: float) -> float:
        variance = known + (share * beyond) ** 2
        return float(np.sum(0.5 * np.log(variance) + 0.5 * error**2 / variance))

    return float(minimize_scalar(surprise, bounds=(0.0, 0.1), method="bounded").x)


def _work(task: tuple[int, int, Path]) -> None:
    number, seed, out = task
    path = out / f"{seed}-{number}.json"
    if path.exists():
        return
    begin = time.perf_counter()
    with one_thread():
        found = judged(number, seed)
    text = asdict(found) | {"seconds": time.perf_counter() - begin}
    with staged(path) as partial:
        partial.write_text(json.dumps(text), encoding="utf-8")
    inside = f"{sum(row.inside for row in found.rows)} of {len(found.rows)} inside"
    print(f"ship {number}: {found.refusal or inside}, {text['seconds']:.0f} s", flush=True)


_GROUPS: Mapping[str, Callable[[Row], str]] = {
    "all": lambda row: "all",
    "trials": lambda row: row.trials,
    "hull": lambda row: row.hull,
    "index": lambda row: f"{row.manoeuvre.split()[0]}, {row.index.replace('_', ' ')}",
    "beyond": lambda row: "within one range of the runs" if row.beyond < 1.0 else "one range beyond them or more",
}


def coverage_rows(rows: Sequence[Row]) -> list[list[str]]:
    """Coverage of 95 and 50 % with its standard error over ships, errors and widths, by group."""
    found = []
    for key in _GROUPS.values():
        for name in sorted({key(row) for row in rows}):
            mine = [row for row in rows if key(row) == name]
            ships = [[row for row in mine if row.number == number] for number in sorted({row.number for row in mine})]
            shares = [np.mean([row.inside for row in ship]) for ship in ships]
            error = np.std(shares, ddof=1) / math.sqrt(len(shares)) if len(shares) > 1 else math.nan
            inside, half = (np.mean([getattr(row, of) for row in mine]) for of in ("inside", "half"))
            z = math.sqrt(np.mean([(row.error / row.sd) ** 2 for row in mine]))
            size, width = np.median([(abs(row.error), 1.96 * row.sd) for row in mine], axis=0)
            crps = np.mean([row.crps for row in mine])
            line = [
                name,
                str(len(ships)),
                str(len(mine)),
                f"{100 * inside:.0f}{f' ± {100 * error:.0f}' if error > 0.0 else ''}",
            ]
            found.append([*line, f"{100 * half:.0f}", f"{z:.2f}", f"{size:.3f}", f"{width:.3f}", f"{crps:.4f}"])
    return found


def reliability_rows(rows: Sequence[Row]) -> list[list[str]]:
    """Statements "at most" and "at least" by the probability they were made with, and the share of them that held.

    A share has its standard error over ships.
    """
    found = []
    for head, key in (("within one range", False), ("one range beyond or more", True), ("all", None)):
        mine = [row for row in rows if key is None or (row.beyond >= 1.0) == key]
        line = [head, str(2 * len(mine))]
        for stated in STATED:
            held = {
                number: np.mean([[row.pit <= stated, row.pit >= 1.0 - stated] for row in mine if row.number == number])
                for number in {row.number for row in mine}
            }
            error = np.std(list(held.values()), ddof=1) / math.sqrt(len(held)) if len(held) > 1 else math.nan
            share = np.mean([[row.pit <= stated, row.pit >= 1.0 - stated] for row in mine]) if mine else math.nan
            line.append(f"{100 * share:.1f} ± {100 * error:.1f}")
        found.append(line)
    return found


def band_rows(bands: Sequence[Bands]) -> list[list[str]]:
    """Share of instants inside bands of 90 % by lead, with its standard error over ships."""
    found = []
    for lead in LEADS:
        held = [one.held for one in bands if one.lead == lead]
        if not held:
            continue
        error = np.std(held, ddof=1) / math.sqrt(len(held)) if len(held) > 1 else math.nan
        found.append(
            [f"{lead:g}", str(len(held)), f"{100 * np.mean(held):.0f} ± {100 * error:.0f}", f"{100 * min(held):.0f}"]
        )
    return found


def page(rows: Sequence[Row], bands: Sequence[Bands], refusals: Mapping[int, str], command: str) -> str:
    """Both halves of the population as a page in Markdown."""
    heads = (
        "",
        "ships",
        "indices",
        "95 % hold %",
        "50 % hold %",
        "rms of error / sd",
        "median error",
        "half width",
        "CRPS",
    )
    halves = {
        f"Ships that BEYOND was chosen on, numbers below {CHOSEN_ON}": range(CHOSEN_ON),
        f"Ships that show it, from number {CHOSEN_ON} on": range(CHOSEN_ON, 10**6),
    }
    stated = ("forecast", "statements", *(f"{100 * one:g} %" for one in STATED))
    lead = ("window [L/U]", "ships", "inside 90 % bands [%]", "the worst ship")
    parts = [
        "# A population of foreign ships",
        f"`{command}`. {' '.join((__doc__ or '').split('``make population``.')[1].split())}",
        "Errors and half widths are in L for distances and in swings of the heading for overshoots; ± is the standard "
        "error over ships.",
    ]
    for head, numbers in halves.items():
        mine, held = ([one for one in every if one.number in numbers] for every in (rows, bands))
        if mine:
            best = f"Of these ships alone BEYOND would be {fitted_beyond(mine):.4f}; it is {BEYOND:g}."
            parts += [f"## {head}", best, table(heads, coverage_rows(mine))]
            parts += ['Statements "at most" and "at least", with the probability they were made with, that held [%]:']
            parts += [table(stated, reliability_rows(mine))]
            parts += [
                "Ships restarted every two L/U in a circle of 35 deg and a 15/15 zigzag that they were not given:"
            ]
            parts += [table(lead, band_rows(held))]
    parts += [f"Ship {number} was refused: {text}" for number, text in refusals.items()]
    return "\n\n".join(parts) + "\n"


def main(words: Sequence[str] | None = None) -> int:
    """Judge the ships that have no result yet, then write the page of all."""
    parser = argparse.ArgumentParser(prog="python -m tests.foreign.population", description=__doc__)
    parser.add_argument("--ships", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first ship")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "foreign", help="folder of the page")
    parser.add_argument("--kept", type=Path, default=ROOT / "build" / "population", help="folder of a file a ship")
    arguments = parser.parse_args(words)
    kept, seed = writable_folder(arguments.kept), arguments.seed
    numbers = range(arguments.first, arguments.ships)
    with get_context("spawn").Pool(arguments.workers) as pool:
        for _ in pool.imap_unordered(_work, [(number, seed, kept) for number in numbers]):
            pass
    found = {number: json.loads((kept / f"{seed}-{number}.json").read_text(encoding="utf-8")) for number in numbers}
    rows = [Row(**row) for one in found.values() for row in one["rows"]]
    bands = [Bands(**row) for one in found.values() for row in one["bands"]]
    refusals = {number: one["refusal"] for number, one in found.items() if one["refusal"]}
    with staged(writable_folder(arguments.out) / "population.md") as path:
        command = (
            f"python -m tests.foreign.population --first {arguments.first} --ships {arguments.ships} --seed {seed}"
        )
        path.write_text(page(rows, bands, refusals, command), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
