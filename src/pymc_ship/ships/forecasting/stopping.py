"""The stopping test: full astern from the approach, until the ship is dead in the water (IMO MSC.137(76), 5.3.4).

Revolutions change linearly in time from ahead to astern; the rudder is amidships.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymc_ship.machine.arguments import number_or_nan, short_repr
from pymc_ship.machine.errors import SimulationError
from pymc_ship.pages.drawing import BLUE, NOISE, house_style, subplots
from pymc_ship.pages.tables import fixed_point, heads, rounded_percent
from pymc_ship.physics.manoeuvre.criteria import fraction_of_draws, probability_text
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.motion.inputs import takes_revolutions
from pymc_ship.physics.motion.replay import replay
from pymc_ship.physics.vessel.parts import ship_dimensions
from pymc_ship.physics.vessel.term_sets import valid_at_any_speed
from pymc_ship.physics.vessel.vessel import Vessel
from pymc_ship.records.steering.stopping_tests import INDICES, LARGE, LIMIT
from pymc_ship.ships.ensemble.ship import ShipLike, as_ship

COLUMNS = heads(str, index="index", units="") | heads(fixed_point(1), median="median", lower="lower", upper="upper")
LONGEST = 150.0  # longest simulated time [L/U]
MOST_ASTERN = 1.5  # largest ratio of revolutions astern to the nominal ones
REVERSAL = 1.5  # default time from the order to the revolutions astern [L/U]
_FASTEST = 5.0  # largest approach speed, over the nominal one
_LEAST_DRAWS = 40  # draws of an interval of 95 % and of a probability
_STEPS = 20  # in L/U
_SHOWN = 40  # tracks of a figure
_MORE_DRAWS = 'Identify the ship with --terms "modular at any speed" and [propeller] in the vessel file.'
_NOT_ASTERN = (
    "A stopping test needs forces at any speed and the table [propeller], found no such model; "
    f"{_MORE_DRAWS[0].lower()}{_MORE_DRAWS[1:]}"
)


@dataclass(frozen=True)
class StoppingTest:
    """A run with the propeller reversed and the rudder amidships."""

    astern: float  # magnitude of the revolutions astern [1/s]
    reversal: float | None = None  # time from the order to these revolutions [s]; None for 1.5 L/U
    approach_speed: float | None = None  # [m/s]; None for the vessel's nominal speed

    @property
    def label(self) -> str:
        """Short name: ``stopping test 1 1/s astern``."""
        return f"stopping test {self.astern:g} 1/s astern"

    def on(self, vessel: Vessel) -> "StoppingTest":
        """The test with the times and speed of a vessel; SimulationError where they are not feasible."""
        return StoppingTest(self.astern, *self._times(vessel))

    def _times(self, vessel: Vessel) -> tuple[float, float]:
        if not _models_astern(vessel):
            raise SimulationError(_NOT_ASTERN)
        s, nominal = vessel.particulars, ship_dimensions(vessel).n
        reversal = REVERSAL * s.ship_time if self.reversal is None else self.reversal
        rates = number_or_nan(self.astern), number_or_nan(reversal)
        if not 0.0 < rates[0] <= MOST_ASTERN * nominal or not 0.0 <= rates[1] < np.inf:
            found = f"{short_repr(self.astern)} and {short_repr(reversal)}"
            raise SimulationError(
                f"A stopping test has revolutions astern up to {MOST_ASTERN:g} times the nominal {nominal:.3g} 1/s "
                f"and a time from 0 s to reach them, found {found}; correct them (1/min over 60 are 1/s)."
            )
        speed = s.nominal_speed if self.approach_speed is None else self.approach_speed
        if not 0.0 < number_or_nan(speed) < _FASTEST * s.nominal_speed:
            raise SimulationError(
                f"A stopping test begins with way ahead, up to {_FASTEST:g} times the nominal {s.nominal_speed:.3g} "
                f"m/s, found {short_repr(speed)} m/s; correct approach_speed."
            )
        return reversal, speed

    def simulate(self, vessel: Vessel, coefficients: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Revolutions [1/s], (n_time,), and states, (8, n_draws, n_time), at evenly spaced times [s]."""
        s, nominal, (reversal, speed) = vessel.particulars, ship_dimensions(vessel).n, self._times(vessel)
        ends = [speed / s.nominal_speed, -self.astern / nominal]
        inputs = np.zeros((4, time.size))
        inputs[1] = np.interp(time, [0.0, max(reversal, 1e-9)], ends)
        initial = np.zeros((len(coefficients), len(STATE)))
        initial[:, 0] = speed
        return nominal * inputs[1], replay(vessel, inputs, initial, coefficients, interval=float(time[1] - time[0]))


def stopping(
    ship: ShipLike, *, astern: float, reversal: float | None = None, approach_speed: float | None = None
) -> xr.Dataset:
    """Simulate the stopping test with every draw.

    Parameters
    ----------
    ship : Ship, Vessel, str or Path
        Models without forces astern are left out.
    astern : float
        Revolutions astern [1/s], a magnitude.
    reversal : float, optional
        Time from the order to these revolutions [s]; 1.5 L/U by default.
    approach_speed : float, optional
        [m/s]; the nominal speed by default.

    Returns
    -------
    Dataset, dims (draw,), (draw, time)
        ``track_reach``, ``head_reach`` and ``lateral_deviation`` [m], positive to starboard, ``stopping_time`` [s] and
        ``heading_change`` [deg] from the order until u = 0, NaN where the ship does not stop within 150 L/U; ``x``,
        ``y`` [m] and ``u`` [m/s], NaN after the stop. Attrs: ``L`` and those of :class:`StoppingTest`.

    Raises
    ------
    SimulationError
        Without a model with forces astern, or for revolutions, times or an approach speed out of range.

    Examples
    --------
    A tanker with a modular model at any speed and typical propeller coefficients astern:

    >>> import pymc_ship as ps
    >>> vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular at any speed")
    >>> stop = ps.stopping(vessel, astern=1.0)
    >>> print(f"track reach {stop['track_reach'].item() / 320.0:.1f} L in {stop['stopping_time'].item():.0f} s")
    track reach 13.1 L in 1304 s
    """
    models = [(vessel, rows) for vessel, rows in as_ship(ship).models if _models_astern(vessel)]
    if not models:
        raise SimulationError(_NOT_ASTERN)
    first = models[0][0]
    test, step = StoppingTest(astern, reversal, approach_speed).on(first), first.particulars.ship_time / _STEPS
    time = step * np.arange(round(LONGEST * _STEPS) + 1)
    states = np.concatenate([test.simulate(vessel, rows, time)[1] for vessel, rows in models], axis=1)
    indices = stopping_indices(dict(zip(STATE, states, strict=True)), time)
    return indices.assign_attrs({"L": first.particulars.L} | asdict(test))


def stopping_indices(motion: Mapping[str, np.ndarray], time: np.ndarray) -> xr.Dataset:
    """Indices and motion, as :func:`stopping` returns them, of draws of u, psi, x and y (n_draws, n_time) [SI, rad]."""
    u, psi, x, y = (motion[name] for name in ("u", "psi", "x", "y"))
    values = {name: np.full(len(u), np.nan) for name in INDICES}
    motion_until_stop = {name: np.full(u.shape, np.nan) for name in ("u", "x", "y")}
    for k in np.flatnonzero((u <= 0.0).any(axis=1)):
        end = int(np.argmax(u[k] <= 0.0))
        weight = u[k, end - 1] / (u[k, end - 1] - u[k, end])
        last = [row[k, end - 1] + weight * (row[k, end] - row[k, end - 1]) for row in (x, y, psi)]
        path_x, path_y = np.append(x[k, :end], last[0]), np.append(y[k, :end], last[1])
        values["track_reach"][k] = np.sum(np.hypot(np.diff(path_x), np.diff(path_y)))
        values["head_reach"][k], values["lateral_deviation"][k] = last[:2]
        values["stopping_time"][k] = time[end - 1] + weight * (time[end] - time[end - 1])
        values["heading_change"][k] = np.rad2deg(last[2])
        for name, row in motion_until_stop.items():
            row[k, :end] = motion[name][k, :end]
    n_shown = int(np.flatnonzero(np.isfinite(motion_until_stop["u"]).any(axis=0)).max(initial=0)) + 1
    variables: dict[str, tuple] = {name: ("draw", value, {"units": INDICES[name]}) for name, value in values.items()}
    for name, units in (("u", "m/s"), ("x", "m"), ("y", "m")):
        variables[name] = (("draw", "time"), motion_until_stop[name][:, :n_shown], {"units": units})
    return xr.Dataset(variables, {"draw": np.arange(len(u)), "time": ("time", time[:n_shown], {"units": "s"})})


def stopping_sentence(stop: xr.Dataset) -> str:
    """Sentence: track reach, with interval and probability of conformity (IMO MSC.137(76)) from 40 draws on."""
    reach = stop["track_reach"].values / stop.attrs["L"]
    stops, astern = np.isfinite(reach), f"{stop.attrs['astern']:g} 1/s astern"
    if not stops.any():
        return f"No draw stops with {astern}."
    lower, median, upper = np.quantile(reach[stops], [0.025, 0.5, 0.975])
    remainder = f" {rounded_percent(float(np.mean(~stops)))} of the draws do not stop." if not stops.all() else ""
    if reach.size < _LEAST_DRAWS:
        return (
            f"Stopping test with {astern}: track reach {median:.1f} L by {reach.size} draw{'s' * (reach.size != 1)} "
            f"with forces astern, too few for an interval and a probability.{remainder} {_MORE_DRAWS}"
        )
    probabilities = [probability_text(fraction_of_draws(stops & (reach <= limit))) for limit in (LIMIT, LARGE)]
    return (
        f"Stopping test with {astern}: track reach {median:.1f} L ({lower:.1f} to "
        f"{upper:.1f}), within the {LIMIT:g} L of IMO MSC.137(76) with probability {probabilities[0]}, within "
        f"the {LARGE:g} L of large ships with {probabilities[1]}.{remainder}"
    )


def stopping_advice(ship: ShipLike) -> str:
    """Sentence: the command that forecasts a stopping test of the ship, or what the ship lacks for one."""
    models = [(vessel, rows) for vessel, rows in as_ship(ship).models if _models_astern(vessel)]
    draws = sum(len(rows) for _, rows in models)
    if draws < _LEAST_DRAWS or models[0][0].propeller is None:
        return f"Stopping is not forecast: {draws} of {as_ship(ship).draws} draws have forces astern. {_MORE_DRAWS}"
    return (
        "Stopping depends on the revolutions astern and is not forecast here; "
        f"pymc-ship forecast FOLDER --stop {ship_dimensions(models[0][0]).n:.2g} takes the folder of this page and the "
        "revolutions [1/s]."
    )


def stopping_rows(stop: xr.Dataset) -> list[dict]:
    """Median and, from 40 draws on, 95 % interval of each index over the draws that stop; distances in L."""
    rows = []
    for name, units in INDICES.items():
        values = stop[name].values / (stop.attrs["L"] if units == "m" else 1.0)
        row = {"index": name.replace("_", " "), "units": "L" if units == "m" else units}
        finite = np.isfinite(values)
        ends = np.quantile(values[finite], [0.5, 0.025, 0.975]) if finite.any() else np.full(3, np.nan)
        ends[1:] = ends[1:] if values.size >= _LEAST_DRAWS else np.nan
        rows.append(row | dict(zip(("median", "lower", "upper"), ends.tolist(), strict=True)))
    return rows


@house_style
def stopping_tracks(stop: xr.Dataset) -> Figure:
    """Tracks of the draws until they stop [L], and u against time."""
    fig, axes = subplots(8.0, 3.6, 1, 2)
    track, speed = axes[0]
    reach, (x, y) = stop["track_reach"].values, (stop[name].values / stop.attrs["L"] for name in ("x", "y"))
    order = np.argsort(reach)[: np.isfinite(reach).sum()]
    for k in order[:: max(order.size // _SHOWN, 1)]:
        track.plot(y[k], x[k], color=NOISE, lw=0.6, label="draws" if k == order[0] else None)
        speed.plot(stop["time"].values, stop["u"].values[k], color=NOISE, lw=0.6)
    if order.size:
        k = order[order.size // 2]
        track.plot(y[k], x[k], color=BLUE, label="median of the track reach")
        speed.plot(stop["time"].values, stop["u"].values[k], color=BLUE)
        track.legend(loc="best")
    track.set_aspect("equal", adjustable="datalim")
    track.set(xlabel="transfer to starboard [L]", ylabel="advance [L]")
    speed.set(xlabel="time from the order [s]", ylabel="surge velocity u [m/s]")
    return fig


def _models_astern(vessel: Vessel) -> bool:
    return valid_at_any_speed(vessel) and takes_revolutions(vessel)
