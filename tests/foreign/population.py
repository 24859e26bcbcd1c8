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
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_ship as ps
from pymc_ship.forecasting.extrapolation import extrapolation
from pymc_ship.forecasting.index_error import index_scale, robust_sd
from pymc_ship.forecasting.motion_error import GROWTH
from pymc_ship.machine.files import staged, writable_folder
from pymc_ship.machine.seeds import generator
from pymc_ship.machine.threads import one_thread
from pymc_ship.pages.drawing import BESIDE_DPI, png
from tests.foreign import mariner, mmg, s175, sailing
from tests.foreign.population_page import CHOSEN_ON, LEADS, SUMMED, Bands, Moved, Row, page, reliability_figure
from tests.foreign.run import ROOT
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

MOVED_LEADS = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0)
"""Times from a restart [L/U] at which errors of the motion are taken."""

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
class Judged:
    """What became of a ship: her indices, bands and motion, or the sentence of her refusal."""

    rows: Sequence[Row] = ()
    bands: Sequence[Bands] = ()
    moved: Sequence[Moved] = ()
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
    rows = [row for trial in sailing.JUDGED for row in _rows(one, ship, trial, seed)]
    return Judged(rows, _bands(one, ship, seed), _moved(one, ship))


def _moved(one: Drawn, ship: ps.ShipModel) -> list[Moved]:
    """Errors of the motion in exact runs that she has not seen, restarted every four L/U."""
    papers, found = one.ship.papers, []
    units = {"u": papers.speed, "v": papers.speed, "r": papers.speed / papers.L, "x": papers.L, "y": papers.L}
    for trial in sailing.JUDGED[::2]:
        run = sailing.sail(one.ship, trial)
        longest = LEADS[-1] * papers.unit
        for begin in np.arange(0.0, run["time"].values[-1] - longest, 4.0 * papers.unit):
            tree = ps.replay(ship, run, start=float(begin), duration=longest, draws=100)
            since = (tree["measured"]["time"].values - begin) / papers.unit
            median = tree["trajectories"].dataset.median("draw")
            ships = median.assign(delta=run["delta"].sel(time=tree["measured"]["time"]))
            beyond = extrapolation(ship.vessel, ships, ship.motion)["distance"].values
            stayed = np.append(0.0, np.cumsum(0.5 * (beyond[1:] + beyond[:-1]) * np.diff(since)))
            for lead in MOVED_LEADS:
                k = min(int(np.searchsorted(since, lead - 1e-9)), since.size - 1)
                for name in GROWTH:
                    unit, far = units.get(name, 1.0), stayed if name in SUMMED else beyond
                    drawn = tree["predictive"][name].values[:, k]
                    error = (np.nanmedian(drawn) - tree["measured"][name].values[k]) / unit
                    numbers = map(float, (error, np.nanstd(drawn) / unit, far[k], beyond[k]))
                    found.append(Moved(one.number, name, *numbers))
    return found


def _bands(one: Drawn, ship: ps.ShipModel, seed: int) -> list[Bands]:
    """Bands in a 15/15 zigzag and a circle, calm: of her motion, and of what her sensors read."""
    unit, noise = one.ship.papers.unit, 1000 * seed + 10 * one.number + 9
    read = [
        [sailing.sail(one.ship, trial, sensors=sensors, seed=noise) for trial in sailing.JUDGED[::2]]
        for sensors in (None, SENSORS)
    ]
    found = []
    for lead in LEADS:
        settings = {"length": lead * unit, "every": 2.0 * unit}
        held = [float(ps.score(ship, runs, **settings)["coverage"].mean()) for runs in read]
        found.append(Bands(one.number, lead, *held))
    return found


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
    moved = [Moved(**row) for one in found.values() for row in one["moved"]]
    refusals = {number: one["refusal"] for number, one in found.items() if one["refusal"]}
    with staged(writable_folder(arguments.out) / "population.md") as path:
        command = (
            f"python -m tests.foreign.population --first {arguments.first} --ships {arguments.ships} --seed {seed}"
        )
        path.write_text(
            page(rows, bands, moved, refusals, command, (__doc__ or "").split("``make population``.")[1]),
            encoding="utf-8",
        )
    shown = [row for row in rows if row.number >= CHOSEN_ON]
    with staged(arguments.out / "reliability.png") as path:
        path.write_bytes(png(reliability_figure(shown or rows), BESIDE_DPI))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
