"""An identified ship as files: one vessel (TOML) and one posterior (NetCDF) for each term set, and what joins them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.tree import CITATIONS, provenance, read_posterior, write_posterior
from pymc_ship.inference.trajectory.prior import Statement
from pymc_ship.inference.trajectory.statements import Earlier
from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.checksums import folder_checksum
from pymc_ship.machine.errors import FitError, TrialError, VesselError
from pymc_ship.machine.files import settle, staged
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, one_manoeuvre
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.reading import load_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names
from pymc_ship.records.steering.recognition import Steering, with_steering
from pymc_ship.ships.forecasting.draws import knowing_models
from pymc_ship.ships.forecasting.forecast import pooled_forecast
from pymc_ship.ships.forecasting.index_error import steady_error
from pymc_ship.ships.forecasting.motion_error import ERRING
from pymc_ship.ships.identification.candidates import Candidate
from pymc_ship.ships.identification.model import IdentifiedShip, ShipModel
from pymc_ship.ships.identification.soundness import sound

FOLDER = "model"
"""Folder of an identified ship inside that of its report."""

_INDEX, _SUM = "ship.json", "sha256"
_KEYS = ("terms", "facilities", "model_error", "motion_error", "remarks", "prior", "index_rows", "held_tests")
_TOLD = ("motion", "statement", "stated", "prior_mean", "prior_scale")
_CHAINS = 4


def forecast_ship(
    ship: ShipModel | IdentifiedShip,
    manoeuvre: Manoeuvre,
    *,
    rng: Seed,
    draws: int = 1000,
    duration: float | None = None,
    ci_prob: float = 0.95,
    n: float | None = None,
    wind: tuple[float, float] | None = None,
    current: tuple[float, float] | None = None,
    facility: str | None = None,
) -> xr.DataTree:
    """Forecast a manoeuvre of an identified ship, with intervals that hold parameter and model error.

    Parameters
    ----------
    ship : ShipModel or IdentifiedShip
        From :func:`pymc_ship.identify_ship` or :func:`pymc_ship.load_ship`.
    manoeuvre : Manoeuvre
    rng : int, SeedSequence or Generator
    draws : int, optional
        At most; term sets keep their share of them.
    duration : float, optional
        [s]; as far as the kind of manoeuvre reaches by default, 40 L/U for the standard ones.
    ci_prob : float, optional
        Probability inside the equal-tailed bands.
    n, wind, current
        Revolutions, wind and current as in :func:`pymc_ship.simulate`; revolutions and wind leave the term sets out
        whose forces do not know them.
    facility : str, optional
        One of the facilities of her trials, whose steering gear moves the rudder and whose revolutions hold the speed
        of the approach, unless the manoeuvre has a speed or ``n`` is given; by default the gear is that of most trials
        and the speed the nominal one.

    Returns
    -------
    DataTree
        As :func:`pymc_ship.forecast`; ``indices`` and their bands hold the model error of held-out manoeuvres. Draws
        that run away in this manoeuvre are left out, ``share_refused`` in attrs, where ``steering`` says how the rudder
        moves and, with a facility, how fast she approaches.

    Raises
    ------
    FitError
        When every draw runs away.
    TrialError
        For a facility that none of her trials is of.
    SimulationError
        For revolutions or wind that no term set of the ship knows.
    ValueError
        For fewer than two draws or ``ci_prob`` not in (0, 1).
    """
    rng, manoeuvre = random_generator(rng), one_manoeuvre(manoeuvre)
    around = {"n": n, "wind": wind, "current": current}
    known = knowing_models(_steered_at(ship, facility), n=n, wind=wind)
    if facility is not None and manoeuvre.approach_speed is None and n is None:
        speed = ship.facilities[facility].approach_speed
        manoeuvre = replace(manoeuvre, approach_speed=speed if np.isfinite(speed) else None)
    total = sum(len(rows) for _, rows in known)
    if draws < 2 or not 0.0 < ci_prob < 1.0:
        raise ValueError(f"A forecast needs two draws and 0 < ci_prob < 1, found {draws} and {ci_prob}; change them.")
    counts = [max(round(len(rows) * min(draws / total, 1.0)), 1) for _, rows in known]
    unit = ship.models[0][0].particulars.ship_time
    duration = manoeuvre.traits.reach * unit if duration is None else duration
    models = []
    for (vessel, rows), count in zip(known, counts, strict=True):
        kept = rows[:count][sound(vessel, rows[:count], [manoeuvre], duration / unit, **around)]
        models += [(vessel, kept)] if len(kept) else []
    if sum(len(rows) for _, rows in models) < 2:
        raise FitError(f"Every draw runs away in the {manoeuvre.label}; give more trials or a prior.")
    tree = pooled_forecast(
        models,
        manoeuvre,
        duration=duration,
        ci_prob=ci_prob,
        rng=rng,
        motion=ship.motion,
        errors=ship.model_error | steady_error(ship.motion_error),
        **simulation_settings(models[0][0]),
        **around,
    )
    tree.attrs["steering"] = _steering(models[0][0], ship.facilities, facility)
    if facility is not None:
        tree.attrs["steering"] += f" She approaches at {tree.attrs['approach_speed']:.4g} m/s."
    tree.attrs["share_refused"] = 1.0 - tree.attrs["draws"] / sum(counts)
    return tree


def _steering(vessel: Vessel, facilities: Mapping[str, Steering], facility: str | None) -> str:
    """Sentence on how the rudder of a forecast moves; it names a facility whose runs have shown that."""
    gear, where = vessel.particulars, facility or next(iter(facilities), "")
    named = f" as at {where}" if where and facilities[where].n_reversals else ""
    unseen = f" (no run at {where} reverses its rudder)" if where and not named else ""
    return f"The rudder moves{named} at {gear.rudder_rate_deg:.3g} deg/s after {gear.rudder_delay:.3g} s{unseen}."


def _steered_at(ship: ShipModel | IdentifiedShip, facility: str | None) -> list[tuple[Vessel, np.ndarray]]:
    """Models of a ship with the steering gear of a facility; as they are without one.

    Raises
    ------
    TrialError
        For a facility that none of her trials is of.
    """
    if facility is None:
        return ship.models
    named = tuple(filter(None, ship.facilities))
    if not named:
        raise TrialError(
            f"The trials of this ship name no facility, found {facility!r} asked for; leave it out, or state facility "
            "in their format files and identify her anew."
        )
    check_choice("A facility", facility, named, TrialError)
    return [(with_steering(vessel, ship.facilities[facility]), rows) for vessel, rows in ship.models]


def save_ship(model: ShipModel, out: str | Path, *, made_by: str = "") -> Path:
    """Write an identified ship to the folder ``model`` of a report, moved into place when complete.

    Parameters
    ----------
    model : ShipModel
    out : str or Path
        Folder of the report, which must exist.
    made_by : str, optional
        What made it.

    Returns
    -------
    Path
        ``out/model``: ``<terms>.toml``, the vessel with the posterior means, ``<terms>.nc``, its draws, and
        ``ship.json``.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    """
    counted = [candidate for candidate in model.candidates if len(candidate.draws)]
    with staged(Path(out) / FOLDER) as folder:
        folder.mkdir()
        for candidate in counted:
            path = folder / _stem(candidate.name)
            path.with_suffix(".toml").write_text(_vessel_text(candidate), encoding="utf-8")
            write_posterior(_tree(candidate, model, made_by), path.with_suffix(".nc"))
        index = {
            "terms": [_entry(c, model) for c in counted],
            "prior": model.prior,
            "model_error": {kind: sizes.tolist() for kind, sizes in model.model_error.items()},
            "motion_error": {name: sizes.tolist() for name, sizes in model.motion_error.items()},
            "facilities": {name: asdict(gear) for name, gear in model.facilities.items()},
            "runs": list(model.names),
            "index_rows": model.known_rows,
            "held_tests": model.held_tests,
            "remarks": list(model.remarks),
            **model.judgement,
            "made_by": made_by,
        }
        index[_SUM] = _checksum(folder, index)
        (folder / _INDEX).write_text(json.dumps(index, indent=2) + "\n", encoding="utf-8")
    return Path(out) / FOLDER


def load_ship(out: str | Path) -> IdentifiedShip:
    """Read an identified ship from the folder of its report.

    Raises
    ------
    VesselError
        When the folder holds none, or one that was damaged or changed since it was written.
    """
    settle(out)
    folder = Path(out) / FOLDER
    try:
        index = json.loads((folder / _INDEX).read_text(encoding="utf-8"))
        given = index.pop(_SUM, None)
        whole = given is None or given == _checksum(folder, index)
    except OSError as error:
        reason = error.strerror or error
        raise VesselError(f"{folder} holds no identified ship: {reason}; run `pymc-ship identify` first.") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise VesselError(f"{folder / _INDEX} cannot be read: {error!r}; run `pymc-ship identify` again.") from None
    if not whole:
        raise VesselError(
            f"The identified ship in {folder} was damaged or changed, its checksum does not fit; copy it again or run "
            "`pymc-ship identify` again."
        )
    gear = {one.name for one in fields(Steering)}
    read = set(_KEYS) <= set(index) and all(set(one) == gear for one in index["facilities"].values())
    read = read and all("measured_sd" in row for row in index["index_rows"])
    if not read or set(index["motion_error"]) != set(ERRING):
        raise _of_another_version(folder, _INDEX, _KEYS)
    models, said, motion = [], {}, None
    for entry in index["terms"]:
        path = folder / entry["file"]
        vessel, tree = load_vessel(path.with_suffix(".toml")), read_posterior(path.with_suffix(".nc"))
        draws = tree["posterior"]["coefficients"].stack(sample=("draw", "chain"))
        rows = draws.sel(coefficient=coefficient_names(vessel)).transpose("sample", "coefficient").values
        models.append((vessel, rows))
        told = tree["constant_data"].to_dataset()
        if not set(_TOLD) <= set(told):
            raise _of_another_version(folder, path.with_suffix(".nc").name, _TOLD)
        motion = told["motion"]
        statement = Statement(told["statement"].values, told["stated"].values)
        names = tuple(map(str, told["coefficient"].values))
        prior = (told["prior_mean"].values, told["prior_scale"].values)
        said[entry["name"]] = Earlier(names, statement, np.array(entry["log_density"], dtype=float), *prior)
    facilities = {name: Steering(**gear) for name, gear in index["facilities"].items()}
    known = {"prior": index["prior"], "said": said, "known_rows": index["index_rows"]}
    known["held_tests"] = index["held_tests"]
    sizes, moved = (
        {name: np.atleast_1d(values) for name, values in index[error].items()}
        for error in ("model_error", "motion_error")
    )
    return IdentifiedShip(models, motion, sizes, moved, tuple(index["remarks"]), facilities, **known)


def _of_another_version(folder: Path, file: str, lacking: Sequence[str]) -> VesselError:
    return VesselError(
        f"The identified ship in {folder} was written by another version of pymc_ship: its {file} does not have "
        f"{', '.join(lacking)} as this one reads them; run `pymc-ship identify` again."
    )


def _checksum(folder: Path, index: Mapping) -> str:
    """Checksum of an index and of the files that it names."""
    names = [str(Path(entry["file"]).with_suffix(ending)) for entry in index["terms"] for ending in (".toml", ".nc")]
    return folder_checksum(folder, names, index)


def _entry(candidate: Candidate, model: ShipModel) -> dict:
    """What ship.json says of a term set."""
    density = model.said[candidate.name].log_density.tolist()
    return {
        "name": candidate.name,
        "file": _stem(candidate.name),
        "weight": candidate.weight,
        "log_density": density,
    }


def _stem(name: str) -> str:
    return name.replace(",", "").replace(" ", "-")


def _tree(candidate: Candidate, model: ShipModel, made_by: str) -> xr.DataTree:
    """Draws of a term set with the motion they were fitted to.

    Four chains of equal length hold the draws; if their number is no multiple of four, one chain holds all of them.
    """
    chains = _CHAINS if len(candidate.draws) % _CHAINS == 0 else 1
    values = candidate.draws.reshape(-1, chains, candidate.draws.shape[1]).swapaxes(0, 1)
    names, said = coefficient_names(candidate.vessel), model.said[candidate.name]
    coords = {"chain": np.arange(chains), "draw": np.arange(values.shape[1]), "coefficient": names}
    posterior = xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), values)}, coords)
    attrs = {
        "method": "windows",
        "vessel": candidate.vessel.name,
        "dof": " ".join(candidate.vessel.dofs),
        "terms": candidate.name,
        "weight": candidate.weight,
        "inflation": candidate.inflation,
        "dispersion": candidate.fit.dispersion,
        "prior": model.prior,
        "made_by": made_by,
        **provenance(CITATIONS["windows"]),
    }
    return xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs=attrs),
            "posterior": posterior,
            "constant_data": xr.Dataset(
                {
                    "motion": model.motion,
                    "statement": (("statement_row", "coefficient"), said.statement.rows),
                    "stated": ("statement_row", said.statement.values),
                    "prior_mean": ("coefficient", said.mean),
                    "prior_scale": ("coefficient", said.scale),
                },
                {"coefficient": names},
            ),
        }
    )


def _vessel_text(candidate: Candidate) -> str:
    """TOML of a candidate's vessel, its coefficients at the estimates; what was known beforehand is in them."""
    vessel = candidate.vessel
    lines = [f"name = {json.dumps(vessel.name)}", f"title = {json.dumps(f'{vessel.title}; {candidate.name} terms')}"]
    lines += [f"parts = {json.dumps(list(vessel.parts))}"] if vessel.parts else []
    tables: list[tuple[str, Mapping[str, float]]] = [("particulars", asdict(vessel.particulars))]
    inertia = {"m": vessel.m, "I_zz": vessel.I_zz} | ({"I_xx": vessel.I_xx} if "roll" in vessel.dofs else {})
    tables += [("inertia", inertia), ("added_mass", vessel.added_mass)]
    if vessel.propeller is not None:
        tables.append(("propeller", asdict(vessel.propeller)))
    tables += [("rudder", asdict(vessel.rudder))] if vessel.rudder else []
    tables += [("windage", asdict(vessel.windage))] if vessel.windage else []
    begin = 0
    for dof in vessel.dofs if not vessel.modular else ():
        names = [str(name) for name in vessel.coefficients(dof)["coefficient"].values]
        values = candidate.fit.coefficients[begin : begin + len(names)]
        begin += len(names)
        tables.append((f"coefficients.{dof}", dict(zip(names, values.tolist(), strict=True))))
    for head, table in tables:
        lines += ["", f"[{head}]", *_entries(table)]
    lines += ["", "[parameters]"] if vessel.parameters else []
    for parameter, value in zip(vessel.parameters, candidate.fit.coefficients[begin:].tolist(), strict=True):
        lines.append(f"{json.dumps(parameter.name)} = {{ value = {value!r}, sd = {float(parameter.sd)!r} }}")
    return "\n".join(lines) + "\n"


def _entries(table: Mapping[str, float]) -> Sequence[str]:
    return [f"{json.dumps(key)} = {float(value)!r}" for key, value in table.items()]
