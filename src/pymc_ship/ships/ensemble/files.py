"""A ship as files: a vessel (TOML) and a posterior (NetCDF) per member, with an index (JSON)."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.tree import CITATIONS, provenance, read_posterior, write_posterior
from pymc_ship.inference.trajectory.prior import GaussianLikelihood
from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.machine.arguments import as_path, check_kind, name_list
from pymc_ship.machine.checksums import folder_checksum
from pymc_ship.machine.errors import OutputError, VesselError
from pymc_ship.machine.files import finish_killed_runs, staged_path
from pymc_ship.physics.manoeuvre.kinds import UNITS
from pymc_ship.physics.vessel.reading import load_vessel
from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names, reference_coefficients
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.index_error import extrapolation_growth
from pymc_ship.ships.ensemble.index_table import index_rows, index_table
from pymc_ship.ships.ensemble.motion_error import ERROR_STATES
from pymc_ship.ships.ensemble.ship import Member, Ship

FOLDER = "model"  # folder of a ship inside that of its report
FORMAT = 5  # number of the format written
MIGRATIONS = {  # names of older formats that differ in the next one, by format number; these are also read
    3: {"statement": "design", "stated": "response", "dispersion": "design_effect"},
    4: {},  # without the growth of the error beyond the runs: that of other ships
}
_INDEX, _SUM = "ship.json", "sha256"
_LAW, _ROW = [float], dict.fromkeys(("run", "manoeuvre", "index"), str) | {"kind": UNITS, "measured_sd": float}
_FORM: dict[str, Any] = {
    "format": (*MIGRATIONS, FORMAT),
    "terms": [{"name": str, "file": str, "weight": float, "log_density": [float]}],
    "facilities": {"*": {gear.name: float for gear in fields(Steering)}},
    "index_error": {"*": _LAW},
    "motion_error": dict.fromkeys(ERROR_STATES, _LAW),
    "remarks": [str],
    "prior": str,
    "held_out_indices": [_ROW],
    "uses_captive_tests": bool,
}
"""Form of an index by key: a type, a list of one form, a table by key or, under ``*``, of any keys, or choices."""
_LATER = {"extrapolation_growth": _LAW, "harder_indices": [_ROW]}  # keys that older formats do not have
_LIKELIHOOD = ("motion", "design", "response", "prior_mean", "prior_scale")
_FACTORS = ("inflation", "design_effect")
_CHAINS = 4
_WEIGHTS_LOST = 0.1  # of term sets without draws, whose weights older files do not have
_ANEW = "run `pymc-ship identify` again"


def save_ship(
    ship: Ship,
    out: str | Path,
    *,
    made_by: str = "",
    runs: Sequence[str] = (),
    quality_flags: Mapping[str, str] | None = None,
) -> Path:
    """Write a ship to the folder ``model`` of a report.

    Parameters
    ----------
    ship : Ship
    out : str or Path
        Folder of the report, which must exist.
    made_by : str, optional
        Program that wrote it.
    runs, quality_flags : sequence of str, mapping of str to str, optional
        Names of the identification runs, and :func:`.quality_flags` of their records.

    Returns
    -------
    Path
        ``out/model`` with ``<terms>.toml`` (vessel, posterior means), ``<terms>.nc`` (draws) and ``ship.json``.

    Raises
    ------
    OutputError
        When the folder cannot be written.
    VesselError
        For a ship without the likelihood of its runs, such as that of a vessel file, or runs of one name.
    """
    check_kind("The ship", ship, Ship, "give that of identify_ship", VesselError)
    out, run_list = as_path("out", out, OutputError), name_list("The names of runs", runs, VesselError)
    members = [one for one in ship.members if len(one.draws)]
    known = [(one, one.likelihood) for one in members if one.likelihood is not None]
    total = sum(one.weight for one in members)
    if ship.motion is None or len(known) < len(members):
        raise VesselError(
            f"A ship is saved with the likelihood of its runs, found none of {ship.vessel.name!r}; save that of "
            "identify_ship, or write the posterior and keep the vessel file."
        )
    with staged_path(out / FOLDER) as folder:
        folder.mkdir()
        terms = []
        for member, likelihood in known:
            path = folder / member.name.replace(",", "").replace(" ", "-")
            path.with_suffix(".toml").write_text(_vessel_text(member), encoding="utf-8")
            write_posterior(_tree(member, likelihood, ship, made_by), path.with_suffix(".nc"))
            density = likelihood.log_density.tolist()
            terms.append(
                {"name": member.name, "file": path.name, "weight": member.weight / total, "log_density": density}
            )
        index = {
            "format": FORMAT,
            "terms": terms,
            "prior": ship.prior,
            "index_error": {kind: sizes.tolist() for kind, sizes in (ship.index_error or {}).items()},
            "motion_error": {name: sizes.tolist() for name, sizes in ship.motion_error.items()},
            "extrapolation_growth": ship.extrapolation_growth.tolist(),
            "facilities": {name: asdict(gear) for name, gear in ship.facilities.items()},
            "runs": run_list,
            "held_out_indices": list(index_rows(ship.held_out_indices)),
            "harder_indices": list(index_rows(ship.harder_indices)),
            "uses_captive_tests": ship.uses_captive_tests,
            "remarks": list(ship.remarks),
            **(quality_flags or {}),
            "made_by": made_by,
        }
        index[_SUM] = _checksum(folder, index)
        (folder / _INDEX).write_text(json.dumps(index, indent=2) + "\n", encoding="utf-8")
    return out / FOLDER


def load_ship(out: str | Path) -> Ship:
    """Read a ship from the folder of its report.

    Parameters
    ----------
    out : str or Path
        Written in :data:`FORMAT` or in one of the two formats before it.

    Raises
    ------
    VesselError
        For a missing ship, another format, or a checksum that differs.
    """
    folder = as_path("out", out, VesselError) / FOLDER
    finish_killed_runs(folder.parent)
    index = _read_index(folder)
    members, motion = [], None
    for entry in index["terms"]:
        path = folder / entry["file"]
        vessel, tree = load_vessel(path.with_suffix(".toml")), read_posterior(path.with_suffix(".nc"))
        stored = tree["constant_data"]
        constant = _current_names({str(name): stored[str(name)] for name in stored.variables})
        if not set(_LIKELIHOOD) <= set(constant):
            raise _other_format(folder, path.with_suffix(".nc").name, _LIKELIHOOD)
        motion = constant["motion"]
        try:
            members.append(_member(entry, vessel, tree, constant))
        except KeyError:  # of a coefficient or an attr
            raise _other_format(folder, path.with_suffix(".nc").name, ("coefficients", *_FACTORS)) from None
    return Ship(
        members=tuple(members),
        motion=motion,
        index_error=_laws(index["index_error"]),
        motion_error=_laws(index["motion_error"]),
        extrapolation_growth=np.array(index.get("extrapolation_growth") or extrapolation_growth((), {})),
        facilities={
            name: Steering(**{one.name: gear[one.name] for one in fields(Steering)})
            for name, gear in index["facilities"].items()
        },
        remarks=tuple(index["remarks"]),
        prior=index["prior"],
        held_out_indices=index_table(index["held_out_indices"]),
        harder_indices=index_table(index.get("harder_indices", ())),
        uses_captive_tests=index["uses_captive_tests"],
    )


def _read_index(folder: Path) -> dict:
    """Index under the names of the present format; VesselError where it is unreadable or of another format."""
    try:
        index = json.loads((folder / _INDEX).read_text(encoding="utf-8"))
        whole = index.pop(_SUM, None) == _checksum(folder, index)
    except OSError as error:
        file, reason = Path(error.filename or _INDEX).name, error.strerror or error
        if file != _INDEX:
            raise VesselError(f"{folder} lacks {file} of its ship: {reason}; copy the whole folder again.") from None
        raise VesselError(f"{folder} holds no identified ship: {reason}; run `pymc-ship identify` first.") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = str(error) if isinstance(error, ValueError) else "it is no index of a ship"
        raise VesselError(f"{folder / _INDEX} cannot be read: {reason}; run `pymc-ship identify` again.") from None
    if not whole:
        raise VesselError(
            f"The identified ship in {folder} was damaged or changed, its checksum does not fit or is missing; copy it "
            "again or run `pymc-ship identify` again."
        )
    index = _current_names(index)
    form = _FORM | {key: of for key, of in _LATER.items() if key in index}
    other = [key for key, of in form.items() if key not in index or not _has_form(index[key], of)]
    if other or not index["terms"]:
        raise _other_format(folder, _INDEX, other or ["terms"])
    _check_numbers(folder / _INDEX, index)
    return index


def _check_numbers(path: Path, index: Mapping) -> None:
    """Raise VesselError for a number of an index that no identification writes, by its key."""
    weights = [entry["weight"] for entry in index["terms"]]
    if not min(weights) >= 0.0 or not abs(sum(weights) - 1.0) <= _WEIGHTS_LOST:
        found = ", ".join(f"{weight:.3g}" for weight in weights)
        raise VesselError(f"{path}: the weights of terms are from 0 up with the sum 1, found {found}; {_ANEW}.")
    sizes = {key: np.hstack([0.0, *index[key].values()]) for key in ("index_error", "motion_error")}
    sizes["extrapolation_growth"] = np.hstack([0.0, index.get("extrapolation_growth", 0.0)])
    rows = [*index["held_out_indices"], *index.get("harder_indices", ())]
    gears = index["facilities"].values()
    known_in_part = {"measured_sd": [row["measured_sd"] for row in rows]}
    known_in_part |= {one.name: [gear[one.name] for gear in gears] for one in fields(Steering)}
    sizes |= {key: np.array(values)[~np.isnan(values)] for key, values in known_in_part.items()}
    for key, values in sizes.items():
        if wrong := values[~(values >= 0.0) | np.isinf(values)].tolist():
            raise VesselError(f"{path}: the numbers of {key} are finite and from 0 up, found {wrong[0]:g}; {_ANEW}.")


def _has_form(value: Any, form: Any) -> bool:
    if form is _LAW and not isinstance(value, list):
        return _has_form(value, float)
    if isinstance(form, list):
        is_empty_law = form is _LAW and not value
        return isinstance(value, list) and not is_empty_law and all(_has_form(one, form[0]) for one in value)
    if isinstance(form, type):
        return isinstance(value, int | float if form is float else form) and (form is bool) == isinstance(value, bool)
    if form is UNITS or isinstance(form, tuple):
        return not isinstance(value, list | dict) and value in form
    by_key = dict.fromkeys(value, form["*"]) if "*" in form and isinstance(value, dict) else form
    return isinstance(value, dict) and all(key in value and _has_form(value[key], of) for key, of in by_key.items())


def _current_names(entries: Mapping) -> dict:
    names = {old: new for renamed in MIGRATIONS.values() for old, new in renamed.items()}
    return {names.get(key, key): value for key, value in entries.items()}


def _member(entry: Mapping, vessel: Vessel, tree: xr.DataTree, constant: Mapping) -> Member:
    draws = tree["posterior"]["coefficients"].stack(sample=("draw", "chain"))
    rows = draws.sel(coefficient=coefficient_names(vessel)).transpose("sample", "coefficient").values
    likelihood = EarlierLikelihood(
        names=tuple(map(str, constant["coefficient"].values)),
        gaussian=GaussianLikelihood(constant["design"].values, constant["response"].values),
        log_density=np.array(entry["log_density"], dtype=float),
        prior_mean=constant["prior_mean"].values,
        prior_scale=constant["prior_scale"].values,
    )
    attrs = _current_names(tree.attrs)
    factors = {name: attrs[name] for name in _FACTORS}
    return Member(entry["name"], vessel, rows, reference_coefficients(vessel), entry["weight"], likelihood, **factors)


def _laws(index: Mapping[str, Sequence[float]]) -> dict[str, np.ndarray]:
    return {name: np.atleast_1d(values) for name, values in index.items()}


def _other_format(folder: Path, file: str, lacking: Sequence[str]) -> VesselError:
    return VesselError(
        f"The identified ship in {folder} was written by another version of pymc_ship: its {file} does not have "
        f"{', '.join(lacking)} as this one reads them; run `pymc-ship identify` again."
    )


def _checksum(folder: Path, index: Mapping) -> str:
    names = [str(Path(entry["file"]).with_suffix(ending)) for entry in index["terms"] for ending in (".toml", ".nc")]
    return folder_checksum(folder, names, index)


def _tree(member: Member, likelihood: EarlierLikelihood, ship: Ship, made_by: str) -> xr.DataTree:
    """Draws of a member (in four chains if divisible) with their motion and likelihood."""
    chains = _CHAINS if len(member.draws) % _CHAINS == 0 else 1
    values = member.draws.reshape(-1, chains, member.draws.shape[1]).swapaxes(0, 1)
    names = coefficient_names(member.vessel)
    coords = {"chain": np.arange(chains), "draw": np.arange(values.shape[1]), "coefficient": names}
    posterior = xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), values)}, coords)
    attrs = {"method": "windows", "vessel": member.vessel.name, "dof": " ".join(member.vessel.dofs)}
    attrs |= {"terms": member.name}
    attrs |= {name: getattr(member, name) for name in ("weight", *_FACTORS)}
    attrs |= {"prior": ship.prior, "made_by": made_by, **provenance(CITATIONS["windows"])}
    constant_data = {
        "motion": ship.motion,
        "design": (("likelihood_row", "coefficient"), likelihood.gaussian.design),
        "response": ("likelihood_row", likelihood.gaussian.response),
        "prior_mean": ("coefficient", likelihood.prior_mean),
        "prior_scale": ("coefficient", likelihood.prior_scale),
    }
    groups = {"posterior": posterior, "constant_data": xr.Dataset(constant_data, {"coefficient": names})}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **groups})


def _vessel_text(member: Member) -> str:
    vessel = member.vessel
    lines = [f"name = {json.dumps(vessel.name)}", f"title = {json.dumps(f'{vessel.title}; {member.name} terms')}"]
    lines += [f"parts = {json.dumps(list(vessel.parts))}"] if vessel.parts else []
    inertia = {"m": vessel.m, "I_zz": vessel.I_zz} | ({"I_xx": vessel.I_xx} if "roll" in vessel.dofs else {})
    tables = {"particulars": asdict(vessel.particulars), "inertia": inertia, "added_mass": vessel.added_mass}
    parts = {"propeller": vessel.propeller, "rudder": vessel.rudder, "windage": vessel.windage}
    tables |= {head: asdict(part) for head, part in parts.items() if part is not None}
    begin = 0
    for dof in vessel.dofs if not vessel.modular else ():
        names = [str(name) for name in vessel.coefficients(dof)["coefficient"].values]
        values = member.estimate[begin : begin + len(names)]
        begin += len(names)
        tables[f"coefficients.{dof}"] = dict(zip(names, values.tolist(), strict=True))
    for head, table in tables.items():
        lines += ["", f"[{head}]", *(f"{json.dumps(key)} = {float(value)!r}" for key, value in table.items())]
    lines += ["", "[parameters]"] if vessel.parameters else []
    for parameter, value in zip(vessel.parameters, member.estimate[begin:].tolist(), strict=True):
        lines.append(f"{json.dumps(parameter.name)} = {{ value = {value!r}, sd = {float(parameter.sd)!r} }}")
    return "\n".join(lines) + "\n"
