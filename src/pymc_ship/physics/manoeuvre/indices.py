"""Manoeuvring indices of a record, as its kind of manoeuvre measures them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import short_repr
from pymc_ship.machine.errors import TrialError
from pymc_ship.physics.forces.surroundings import flow_components
from pymc_ship.physics.manoeuvre.events import Record
from pymc_ship.physics.manoeuvre.kinds import SIDES, Index, ManoeuvreKind
from pymc_ship.physics.manoeuvre.registry import KINDS, either
from pymc_ship.trial.channels import CHANNELS
from pymc_ship.trial.record import as_trial, check_trial


def indices(trial: xr.Dataset, *, manoeuvre: str | None = None) -> xr.Dataset:
    """Manoeuvring indices of IMO MSC.137(76), of a trial or of simulated ships.

    Parameters
    ----------
    trial : Dataset, dims (time,) or (draw, time)
        u, v [m/s], r [rad/s], phi, psi [rad] and x, y [m]. ``attrs`` hold ``manoeuvre``, ``heading_deg`` and
        ``side``, as :func:`pymc_ship.simulate` writes them. psi of a zigzag and a pull-out counts from the base
        course, or from north with ``attrs["base_course"]`` [rad]. Denoise a noisy record
        first (:func:`pymc_ship.denoise`): its peaks are too high by about the noise. The rudder moves first at the
        first sample; times and distances count from its order, ``attrs["rudder_delay"]`` [s] before.
    manoeuvre : str, optional
        Name of the kind, which overrides ``attrs["manoeuvre"]``: ``zigzag``, ``turning_circle``.

    Returns
    -------
    Dataset, dims () or (draw,)
        Indices of the kind [deg, s, m, m/s, deg/s]; NaN where the record does not reach the event or diverged.
        Overshoots count beyond the switching heading. Indices of roll are left out where ``attrs["dofs"]`` lacks it.

    Raises
    ------
    TrialError
        For another manoeuvre, missing channels or missing attrs, and a first heading beyond the switching heading.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(10, 10), duration=600, step=0.5)
    >>> overshoot = ps.indices(trial)["first_overshoot_angle"]
    >>> print(f"{overshoot:.1f} {overshoot.attrs['units']}")
    10.2 deg
    """
    name = as_trial(trial).attrs.get("manoeuvre", "") if manoeuvre is None else manoeuvre
    known = [kind.name for kind in KINDS.values() if kind.indices]
    if not isinstance(name, str) or name not in known:
        raise TrialError(f"Indices exist for {either(known)}, found {short_repr(name)}; name the manoeuvre.")
    kind = KINDS[name]
    required = {*kind.angles, "side"} - {"rudder_deg"}
    if required - trial.attrs.keys() or trial.attrs["side"] not in SIDES:
        keys = ", ".join(sorted(required))
        raise TrialError(f"The attrs of a {name} need {keys}, the side is 'starboard' or 'port'; mend them.")
    channels = ("u", "v", "r", "phi", "psi", "x", "y")
    run = trial.isel(draw=0, missing_dims="ignore")
    if "psi" in run:  # up to a divergence
        run = run.isel(time=slice(0, max(np.flatnonzero(np.isfinite(run["psi"].values)), default=-1) + 1))
    check_trial(run, channels, uniform=False)
    if "heading_deg" in kind.angles and run.sizes["time"]:
        _check_base_course(name, np.rad2deg(float(run["psi"][0]) - trial.attrs.get("base_course", 0.0)), trial.attrs)
    runs = trial if "draw" in trial.dims else trial.expand_dims("draw")
    records = zip(*(runs[name].transpose("draw", "time").values for name in channels), strict=True)
    time, delay = runs["time"].values, float(np.nan_to_num(trial.attrs.get("rudder_delay", 0.0)))
    drift = flow_components((trial.attrs.get("current_speed", 0.0), trial.attrs.get("current_direction", 0.0)))
    ships = [Record(time, dict(zip(channels, record, strict=True)), delay, drift) for record in records]
    rows = [indices_of_run(ship, kind, trial.attrs) for ship in ships]
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    table = xr.Dataset(
        {name: ("draw", values, {"units": kind.indices[name].units}) for name, values in columns.items()},
        attrs={**trial.attrs, "manoeuvre": kind.name},
    )
    return table.assign_coords(draw=runs["draw"]) if "draw" in trial.dims else table.isel(draw=0)


def _check_base_course(name: str, first_deg: float, attrs: Mapping[str, Any]) -> None:
    if abs(first_deg) >= attrs["heading_deg"]:
        raise TrialError(
            f"The heading of a {name} counts from its base course, found {first_deg:.4g} deg at the first sample; "
            "subtract the base course, or give it as attrs['base_course'] [rad]."
        )


def indices_of_run(ship: Record, kind: ManoeuvreKind, attrs: Mapping[str, Any]) -> dict[str, float]:
    """Indices of one run by name, NaN where it does not reach the event; without roll in ``dofs`` not those of roll."""
    rolls = "roll" in attrs.get("dofs", "roll").split()
    reached = kind.measure(ship, attrs) if ship.time.size > 1 else {}
    modelled = [name for name, index in kind.indices.items() if rolls or not needs_roll(index)]
    return {name: float(reached.get(name, np.nan)) for name in modelled}


def needs_roll(index: Index) -> bool:
    """Whether an index is of the roll."""
    return any(CHANNELS[name].rolling for name in index.needs)
