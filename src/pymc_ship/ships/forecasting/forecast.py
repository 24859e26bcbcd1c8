"""Posterior draws -> manoeuvres with bands for every channel and intervals for every index."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.arguments import check_choice
from pymc_ship.machine.errors import FitError, TrialError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.indices import indices, needs_roll
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, one_manoeuvre
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.physics.vessel.vessel import Vessel, most_dofs
from pymc_ship.records.steering.recognition import Steering, with_steering
from pymc_ship.ships.ensemble.draws import suitable_models, thinned_draws
from pymc_ship.ships.ensemble.feasibility import is_feasible
from pymc_ship.ships.ensemble.index_error import reliability, steady_error, with_model_error
from pymc_ship.ships.ensemble.scores import quantile_bands, quantiles
from pymc_ship.ships.ensemble.ship import Ship, ShipLike, as_ship
from pymc_ship.ships.forecasting.extrapolation import UNKNOWN, extrapolation, percentage_outside, sentence
from pymc_ship.trial.channels import CHANNELS, SIMULATED

AS_PUBLISHED: dict[str, Any] = {"ci_prob": 0.9, "step": 0.02, "record_interval": 0.5, "method": "euler"}
"""Settings of a forecast in the study of Xue et al. (2020), whose records are made by these steps."""

NO_ROLL = "There is no forecast of roll angles: none or too few of the simulated ships roll."
"""What a forecast without roll says."""


def forecast(
    ship: ShipLike,
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
    **settings: Any,
) -> xr.DataTree:
    """Forecast a manoeuvre with one simulated ship for each draw.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
        From :func:`pymc_ship.load_ship`, an identification, or :meth:`pymc_ship.Ship.from_posterior`; a vessel is a
        ship of one draw.
    manoeuvre : Manoeuvre
    rng : int, SeedSequence or Generator
    draws : int, optional
        At most; the models of an ensemble keep their shares of them.
    duration : float, optional
        [s]; as far as the kind of manoeuvre reaches by default, 40 L/U for the standard ones.
    ci_prob : float, optional
        Probability inside the equal-tailed bands.
    n, wind, current
        Revolutions, wind and current as in :func:`pymc_ship.simulate`; revolutions and wind leave the models out whose
        forces do not know them.
    facility : str, optional
        One of the facilities of the trials, whose steering gear moves the rudder and whose revolutions give the speed
        of the approach, unless the manoeuvre has a speed or ``n`` is given; by default the gear is that of most trials
        and the speed the nominal one.
    **settings
        ``step``, ``method`` and ``record_interval`` of :func:`pymc_ship.simulate`; by default Runge-Kutta steps that
        suit the size and speed of the ship.

    Returns
    -------
    DataTree
        ``trajectories`` (dims draw, time: the simulated ships with ``diverged`` and ``diverged_at``), ``bands`` (dims
        band, time) and, for a manoeuvre that has indices, ``indices`` (dims draw) and ``index_bands`` (dims band).
        Bands are quantiles of the ships still running at that instant; attrs tell the ``share_diverged``. ``bands``
        have the uncertainty of the coefficients alone; ``measured_bands``, there where a noise is known, that of what
        the sensors would read on top of it. Where the ship has laws of its errors, ``indices`` and their bands have the
        model error, and draws that are not feasible in this manoeuvre are left out, ``share_refused`` in attrs.
        ``extrapolation``, there where the motion of the runs is known: how the ships leave it, ``share_outside`` and
        median ``distance`` over time, and over symbol what is in :func:`.extrapolation`, medians over draws.
        Attrs tell ``share_extrapolated``, the share of outside instants of running ships (NaN where unknown),
        ``extrapolation``, a sentence, and ``steering``, how the rudder moves.

    Raises
    ------
    FitError
        When no draw of a ship with laws of its errors is feasible.
    TrialError
        For a facility that none of the trials is of, or a motion of the runs that cannot be read.
    SimulationError
        For settings that cannot run, or revolutions or wind that no model of the ship knows.
    ValueError
        For fewer than two draws or ``ci_prob`` not in (0, 1).

    Examples
    --------
    A turning circle, forecast from a noisy zigzag; the band of 90 % has the diameter of the ship itself:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.pollute(ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5), level=0.01, rng=rng)
    >>> found = ps.identify(trial, vessel, families=["conjugate"], interval=None, derivative="weak")
    >>> ship = ps.Ship.from_posterior(vessel, found.posteriors("conjugate", draws=40, rng=rng), draws=40, rng=rng)
    >>> turn = ps.forecast(ship, ps.turning_circle(35), duration=900, ci_prob=0.9, rng=rng)
    >>> lower, median, upper = turn["index_bands"]["tactical_diameter"].values
    >>> truth = ps.indices(ps.simulate(vessel, ps.turning_circle(35), duration=900, step=0.5))["tactical_diameter"]
    >>> turn.attrs["share_diverged"], bool(lower < truth < upper)
    (0.0, True)
    """
    rng, ship, manoeuvre = random_generator(rng), as_ship(ship), one_manoeuvre(manoeuvre)
    if draws < 2 or not 0.0 < ci_prob < 1.0:
        raise ValueError(f"A forecast needs two draws and 0 < ci_prob < 1, found {draws} and {ci_prob}; change them.")
    around = {"n": n, "wind": wind, "current": current}
    known = suitable_models(_steered_at(ship, facility), n=n, wind=wind)
    if facility is not None and manoeuvre.approach_speed is None and n is None:
        speed = ship.facilities[facility].approach_speed
        manoeuvre = replace(manoeuvre, approach_speed=speed if np.isfinite(speed) else None)
    unit = known[0][0].particulars.ship_time
    duration = manoeuvre.traits.reach * unit if duration is None else duration
    drawn = thinned_draws(known, draws)
    models = drawn if ship.index_error is None else _feasible(drawn, manoeuvre, duration / unit, around)
    tree = pooled_forecast(
        models,
        manoeuvre,
        duration=duration,
        ci_prob=ci_prob,
        rng=rng,
        noise=ship.noise_sd,
        motion=ship.motion,
        errors=None if ship.index_error is None else ship.index_error | steady_error(ship.motion_error),
        **(simulation_settings(models[0][0]) | settings),
        **around,
    )
    tree.attrs["steering"] = _steering(models[0][0], ship.facilities, facility)
    if facility is not None:
        tree.attrs["steering"] += f" The approach is at {tree.attrs['approach_speed']:.4g} m/s."
    tree.attrs["share_refused"] = 1.0 - tree.attrs["draws"] / sum(len(rows) for _, rows in drawn)
    return tree


def _feasible(
    models: Sequence[tuple[Vessel, np.ndarray]], manoeuvre: Manoeuvre, reach: float, around: Mapping[str, object]
) -> list[tuple[Vessel, np.ndarray]]:
    """Models with the draws that are feasible in a manoeuvre; FitError where fewer than two are."""
    found = [(vessel, rows[is_feasible(vessel, rows, [manoeuvre], reach, **around)]) for vessel, rows in models]
    if sum(len(rows) for _, rows in found) < 2:
        raise FitError(f"Every draw runs away in the {manoeuvre.label}; give more trials or a prior.")
    return [(vessel, rows) for vessel, rows in found if len(rows)]


def _steering(vessel: Vessel, facilities: Mapping[str, Steering], facility: str | None) -> str:
    """Sentence on how the rudder of a forecast moves; it names a facility whose runs have shown that."""
    gear, where = vessel.particulars, facility or next(iter(facilities), "")
    named = f" as at {where}" if where and facilities[where].n_reversals else ""
    unseen = f" (no run at {where} reverses its rudder)" if where and not named else ""
    return f"The rudder moves{named} at {gear.rudder_rate_deg:.3g} deg/s after {gear.rudder_delay:.3g} s{unseen}."


def _steered_at(ship: Ship, facility: str | None) -> list[tuple[Vessel, np.ndarray]]:
    """Models of a ship with the steering gear of a facility; TrialError for one that none of the trials is of."""
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


def pooled_forecast(
    models: Sequence[tuple[Vessel, np.ndarray]],
    manoeuvre: Manoeuvre,
    *,
    duration: float,
    ci_prob: float,
    rng: np.random.Generator,
    noise: Mapping[str, float] | None = None,
    motion: xr.DataArray | None = None,
    errors: Mapping[str, np.ndarray | float] | None = None,
    **settings: Any,
) -> xr.DataTree:
    """Forecast a manoeuvre with ships of several models at once: vessels that share all but their terms and parts.

    Where some models roll, p, phi and their indices are those of these models. Where their draws are too few to have
    one beyond either end of the band, the forecast has no roll, and says so in the ``dofs`` of its attrs.

    Parameters
    ----------
    models : sequence of (Vessel, ndarray of shape (n_draws, n_coefficients))
        Each model counts by its number of draws.
    manoeuvre, duration, ci_prob, rng
        As :func:`forecast`.
    **settings
        Of :func:`pymc_ship.simulate`.
    noise : mapping of str to float, optional
        Standard deviation of the sensors by channel [SI].
    motion : DataArray, dims (row, symbol), optional
        Prime motion the models were fitted to.
    errors : mapping of str to ndarray or float, optional
        Model error of the indices by kind, see :func:`pymc_ship.ships.ensemble.index_error.model_error`: ``indices``
        are then those that a trial would show, and hold the error of a model that leaves the motion of its runs.

    Returns
    -------
    DataTree
        As :func:`forecast`.
    """
    runs = [simulate(ship, manoeuvre, duration=duration, coefficients=rows, **settings) for ship, rows in models]
    rolling = np.concatenate([np.full(len(rows), "roll" in ship.dofs) for ship, rows in models])
    if not rolling.all() and rolling.sum() < round(2.0 / (1.0 - ci_prob)):
        rolling[:] = False
    vessel = most_dofs(ship for ship, _ in models if rolling.any() or "roll" not in ship.dofs)
    shown = [name for name in SIMULATED if "roll" in vessel.dofs or not CHANNELS[name].rolling]
    simulated = runs[0]
    if len(runs) > 1:
        simulated = xr.concat(runs, "draw", combine_attrs="override")
        simulated = simulated.assign_coords(draw=np.arange(simulated.sizes["draw"]))
        simulated = simulated.assign_attrs(dofs=" ".join(vessel.dofs))
    ships = _of_those_that_roll(simulated, [name for name in SIMULATED if CHANNELS[name].rolling], rolling)
    groups = {"trajectories": ships, "bands": quantile_bands(ships[shown], ci_prob)}
    if noise:
        groups["measured_bands"] = quantile_bands(_measured(ships[shown], noise, rng), ci_prob)
    left = None if motion is None else _over_draws(extrapolation(vessel, simulated, motion))
    beyond = float(np.nanmax(left["distance"])) if left is not None else 0.0
    if manoeuvre.traits.indices:
        found = indices(simulated)
        angles = [str(name) for name in found if needs_roll(manoeuvre.traits.indices[str(name)])]
        found = _of_those_that_roll(found, angles, rolling)
        groups["indices"] = found if errors is None else with_model_error(found, errors, vessel, rng, beyond=beyond)
        groups["index_bands"] = quantile_bands(groups["indices"], ci_prob)
    attrs = {
        **ships.attrs,
        "label": manoeuvre.label,
        "draws": ships.sizes["draw"],
        "ci_prob": ci_prob,
        "ci_kind": "eti",
        "share_diverged": float(ships["diverged"].mean()),
        "share_extrapolated": np.nan,
        "extrapolation": UNKNOWN,
        **(reliability(beyond) if errors is not None else {}),
    }
    if left is not None:
        groups["extrapolation"] = left
        attrs |= {"share_extrapolated": left.attrs["share_extrapolated"], "extrapolation": sentence(vessel, left)}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **groups})


def _of_those_that_roll(values: xr.Dataset, names: Sequence[str], rolling: np.ndarray) -> xr.Dataset:
    """Values by draw; those of these names are NaN for draws that do not roll where others do."""
    if rolling.all() or not rolling.any():
        return values
    return values.assign({name: values[name].where(xr.DataArray(rolling, dims="draw")) for name in names})


def has_roll(tree: xr.DataTree) -> bool:
    """Whether a forecast holds the roll."""
    return "roll" in tree.attrs["dofs"].split()


def draws_and_shares(tree: xr.DataTree) -> str:
    """Words that stand beside the bands of a forecast.

    They state the number of ships, the share that diverged and, where it is known, the share extrapolated.
    """
    diverged, extrapolated = (tree.attrs[f"share_{name}"] for name in ("diverged", "extrapolated"))
    known = f", {percentage_outside(extrapolated)} of the instants extrapolated" if np.isfinite(extrapolated) else ""
    return f"{tree.attrs['draws']} ships, {100.0 * diverged:.3g} % diverged{known}"


def _measured(ships: xr.Dataset, noise: Mapping[str, float], rng: np.random.Generator) -> xr.Dataset:
    """Readings of the ships' sensors: the motion plus independent normal noise at every instant."""
    read = ships[[name for name in ships if name in noise]]
    return read.map(lambda channel: channel + noise[channel.name] * rng.standard_normal(channel.shape), keep_attrs=True)


def _over_draws(found: xr.Dataset) -> xr.Dataset:
    """Share of the running ships outside and their median distance over time; medians over symbols, shares in attrs."""
    distance, outside = found["distance"].values, found["outside"].values
    running = np.isfinite(distance)
    count = running.sum(axis=0)
    share = np.where(count > 0, outside.sum(axis=0) / np.maximum(count, 1), np.nan)
    over_time = {
        "share_outside": ("time", share),
        "distance": ("time", quantiles(distance, [0.5])[0], found["distance"].attrs),
    }
    over_symbol = found.drop_dims("time").median("draw", keep_attrs=True)
    attrs = {
        "share_extrapolated": float(outside.sum() / running.sum()),
        "median_distance": float(np.median(distance[outside])) if outside.any() else 0.0,
    }
    return over_symbol.assign(over_time).assign_coords(time=found["time"]).assign_attrs(attrs)
