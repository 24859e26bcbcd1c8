"""Posterior draws -> manoeuvres with bands for every channel and intervals for every index."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.manoeuvre.indices import indices, of_roll
from pymc_ship.physics.manoeuvre.standard import Manoeuvre, one_manoeuvre
from pymc_ship.physics.motion.simulation import simulate
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, fullest
from pymc_ship.ships.forecasting.draws import coefficient_draws, fitted_motion, sensor_noise
from pymc_ship.ships.forecasting.extrapolation import UNKNOWN, extrapolation, sentence, share_outside
from pymc_ship.ships.forecasting.index_error import reliability, with_model_error
from pymc_ship.trial.channels import CHANNELS, SIMULATED

BANDS = ("lower", "median", "upper")
"""Coordinate ``band`` of what a forecast summarises."""

NO_ROLL = "There is no forecast of roll angles: none or too few of the simulated ships roll."
"""What a forecast without roll says."""


def forecast(
    vessel: VesselLike,
    posteriors: Mapping[str, xr.DataTree] | xr.DataTree,
    manoeuvre: Manoeuvre,
    *,
    draws: int = 300,
    rng: Seed,
    duration: float = 400.0,
    ci_prob: float = 0.9,
    noise_sd: Mapping[str, float] | None = None,
    **settings: Any,
) -> xr.DataTree:
    """Forecast a manoeuvre with one simulated ship for each posterior draw.

    Parameters
    ----------
    vessel : Vessel, str or Path
    posteriors : DataTree or mapping of str to DataTree
        Joint posterior of all coefficients, or the posterior of each DOF, of any method; a DOF that a mapping leaves
        out keeps the vessel's reference values.
    manoeuvre : Manoeuvre
    draws : int, optional
        Simulated ships.
    rng : int, SeedSequence or Generator
    duration : float, optional
        [s].
    ci_prob : float, optional
        Probability inside the equal-tailed bands.
    noise_sd : mapping of str to float, optional
        Standard deviation of the noise of the sensors by channel [SI]; by default what a joint posterior holds.
    **settings
        ``step``, ``method`` and ``record_interval`` of :func:`pymc_ship.simulate`; by default Euler at 0.02 s,
        recorded every 0.5 s.

    Returns
    -------
    DataTree
        ``trajectories`` (dims draw, time: the simulated ships with ``diverged`` and ``diverged_at``), ``bands`` (dims
        band, time) and, for a manoeuvre that has indices, ``indices`` (dims draw) and ``index_bands`` (dims band).
        Bands are quantiles of the ships still running at that instant; attrs tell the ``share_diverged``. ``bands``
        hold the uncertainty of the coefficients alone; ``measured_bands``, there where a noise is known, that of what
        the sensors would read on top of it. ``extrapolation``, there where the posterior holds the motion it was fitted
        to: how the ships leave it, ``share_outside`` and median ``distance`` over time, and over symbol what is in
        :func:`pymc_ship.extrapolation`, medians over draws. Attrs tell ``share_extrapolated``, the share of outside
        instants of running ships (NaN where unknown), and ``extrapolation``, a sentence.

    Raises
    ------
    VesselError, SimulationError, ValueError
        For posteriors that do not fit the vessel, settings that cannot run, fewer than two draws, ``ci_prob`` not in
        (0, 1), noise of an unknown channel or one that is negative or not finite.
    TrialError
        For a fitted motion that cannot be read.

    Examples
    --------
    A turning circle, forecast from a noisy zigzag; the band of 90 % holds the diameter of the ship herself:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
    >>> trial = ps.pollute(ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5), level=0.01, rng=rng)
    >>> found = ps.identify(trial, vessel, families=["conjugate"], interval=None, derivative="weak")
    >>> posteriors = found.posteriors("conjugate", draws=40, rng=rng)
    >>> turn = ps.forecast(vessel, posteriors, ps.turning_circle(35), draws=40, duration=900, step=0.5, rng=rng)
    >>> lower, median, upper = turn["index_bands"]["tactical_diameter"].values
    >>> truth = ps.indices(ps.simulate(vessel, ps.turning_circle(35), duration=900, step=0.5))["tactical_diameter"]
    >>> turn.attrs["share_diverged"], bool(lower < truth < upper)
    (0.0, True)
    """
    rng, vessel, manoeuvre = random_generator(rng), as_vessel(vessel), one_manoeuvre(manoeuvre)
    if draws < 2 or not 0.0 < ci_prob < 1.0:
        raise ValueError(f"A forecast needs two draws and 0 < ci_prob < 1, found {draws} and {ci_prob}; change them.")
    noise = sensor_noise(posteriors) if noise_sd is None else dict(noise_sd)
    _check_noise(noise)
    models = [(vessel, coefficient_draws(vessel, posteriors, draws, rng))]
    motion = fitted_motion(posteriors)
    return pooled_forecast(
        models, manoeuvre, duration=duration, ci_prob=ci_prob, noise=noise, motion=motion, rng=rng, **settings
    )


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
    manoeuvre, duration, ci_prob, rng, **settings
        As :func:`forecast`.
    noise : mapping of str to float, optional
        Standard deviation of the sensors by channel [SI].
    motion : DataArray, dims (row, symbol), optional
        Prime motion the models were fitted to.
    errors : mapping of str to ndarray or float, optional
        Model error of the indices by kind, see :func:`pymc_ship.ships.forecasting.index_error.model_error`: ``indices``
        are then those that a trial would show, and hold the error of a model that leaves the motion of its runs.

    Returns
    -------
    DataTree
        As :func:`forecast`.
    """
    settings = {"step": 0.02, "record_interval": 0.5} | settings
    runs = [simulate(ship, manoeuvre, duration=duration, coefficients=rows, **settings) for ship, rows in models]
    rolling = np.concatenate([np.full(len(rows), "roll" in ship.dofs) for ship, rows in models])
    if not rolling.all() and rolling.sum() < round(2.0 / (1.0 - ci_prob)):
        rolling[:] = False
    vessel = fullest(ship for ship, _ in models if rolling.any() or "roll" not in ship.dofs)
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
        angles = [str(name) for name in found if of_roll(manoeuvre.traits.indices[str(name)])]
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


def rolls(tree: xr.DataTree) -> bool:
    """Whether a forecast holds the roll."""
    return "roll" in tree.attrs["dofs"].split()


def stated_shares(tree: xr.DataTree) -> str:
    """Words that stand beside the bands of a forecast.

    They state the number of ships, the share that diverged and, where it is known, the share extrapolated.
    """
    diverged, extrapolated = (tree.attrs[f"share_{name}"] for name in ("diverged", "extrapolated"))
    known = f", {share_outside(extrapolated)} of the instants extrapolated" if np.isfinite(extrapolated) else ""
    return f"{tree.attrs['draws']} ships, {100.0 * diverged:.3g} % diverged{known}"


def _check_noise(noise: Mapping[str, float]) -> None:
    for name, sd in noise.items():
        if name not in SIMULATED or not 0.0 <= sd < np.inf:
            raise ValueError(
                f"Sensor noise has a standard deviation from 0 up for any of {', '.join(SIMULATED)}; found {sd} for "
                f"{name!r}; correct it."
            )


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
        "distance": ("time", _quantiles(distance, [0.5])[0], found["distance"].attrs),
    }
    over_symbol = found.drop_dims("time").median("draw", keep_attrs=True)
    attrs = {
        "share_extrapolated": float(outside.sum() / running.sum()),
        "median_distance": float(np.median(distance[outside])) if outside.any() else 0.0,
    }
    return over_symbol.assign(over_time).assign_coords(time=found["time"]).assign_attrs(attrs)


def quantile_bands(values: xr.Dataset, ci_prob: float) -> xr.Dataset:
    """Equal-tailed band and median over the draws that are not NaN."""
    tail = 0.5 * (1.0 - ci_prob)
    variables = {
        name: (("band", *variable.dims[1:]), _quantiles(variable.values, [tail, 0.5, 1.0 - tail]), variable.attrs)
        for name, variable in values.data_vars.items()
    }
    coords = {"band": list(BANDS)} | {name: values.coords[name] for name in values.coords if name != "draw"}
    return xr.Dataset(variables, coords)


def _quantiles(values: np.ndarray, probabilities: list[float]) -> np.ndarray:
    """Quantiles over the first axis without NaN (which sorts last), linear between order statistics."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    rank = np.multiply.outer(probabilities, np.maximum(count - 1, 0))
    below = np.floor(rank).astype(int)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (np.take_along_axis(ordered, index, axis=0) for index in (below, above))
    return low + (rank - below) * (high - low)
