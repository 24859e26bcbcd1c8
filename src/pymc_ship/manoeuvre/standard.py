"""Standard manoeuvres as values (IMO MSC.137(76)): zigzag, turning circle and free rudder programmes.

A positive rudder angle turns the ship to port; the constructors take magnitudes and the side turned to first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SIDES = {"starboard": 1.0, "port": -1.0}
"""Sign of the heading change towards each side."""


class ManoeuvreError(ValueError):
    """A manoeuvre that no ship can run."""


@dataclass(frozen=True)
class Manoeuvre:
    """A manoeuvre to run, started on a straight course at time 0.

    Attributes
    ----------
    kind : {"zigzag", "turning_circle", "rudder_programme"}
    rudder_deg, heading_deg : float
        Rudder angle and switching heading [deg], magnitudes.
    side : {"starboard", "port"}
        Side turned to first.
    approach_speed : float or None
        Speed at time 0 [m/s]; None for the vessel's nominal speed.
    time, delta : tuple of float
        Breakpoints of a rudder programme [s, rad], linear in between; empty otherwise.
    rate_limited : bool
        Whether the rudder follows its commands at the vessel's rudder rate or exactly.
    """

    kind: str
    rudder_deg: float = 0.0
    heading_deg: float = 0.0
    side: str = "port"
    approach_speed: float | None = None
    time: tuple[float, ...] = ()
    delta: tuple[float, ...] = ()
    rate_limited: bool = True

    @property
    def label(self) -> str:
        """Short name: ``zigzag 20/20 starboard``, ``turning circle 35 port``."""
        name = self.kind.replace("_", " ")
        angles = {"zigzag": f" {self.rudder_deg:g}/{self.heading_deg:g} {self.side}"}
        return name + angles.get(self.kind, f" {self.rudder_deg:g} {self.side}" if self.rudder_deg else "")


def manoeuvre_attrs(manoeuvre: Manoeuvre) -> dict[str, object]:
    """What a record of a manoeuvre says of it: kind, angles [deg] and side, as indices need them."""
    return {
        "manoeuvre": manoeuvre.kind,
        "rudder_deg": manoeuvre.rudder_deg,
        "heading_deg": manoeuvre.heading_deg,
        "side": manoeuvre.side,
    }


def zigzag(
    rudder_deg: float, heading_deg: float, *, side: str = "port", approach_speed: float | None = None
) -> Manoeuvre:
    """Zigzag test rudder_deg/heading_deg: the rudder is reversed each time the heading has changed by heading_deg.

    Parameters
    ----------
    rudder_deg, heading_deg : float
        Magnitudes [deg].
    side : {"port", "starboard"}, optional
        Side turned to first; port is the side of the positive rudder angle.
    approach_speed : float, optional
        [m/s]; the vessel's nominal speed by default.

    Returns
    -------
    Manoeuvre

    Raises
    ------
    ManoeuvreError
        For angles that are not positive, an unknown side or a speed that is not positive.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> manoeuvre = ps.zigzag(10, 20, side="starboard")
    >>> manoeuvre.rudder_deg, manoeuvre.heading_deg, manoeuvre.side
    (10.0, 20.0, 'starboard')
    """
    _check(side, approach_speed, rudder_deg=rudder_deg, heading_deg=heading_deg)
    return Manoeuvre("zigzag", float(rudder_deg), float(heading_deg), side, approach_speed)


def turning_circle(rudder_deg: float = 35.0, *, side: str = "port", approach_speed: float | None = None) -> Manoeuvre:
    """Turning circle with constant rudder from time 0; parameters and errors as :func:`zigzag`.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> ps.turning_circle(35, side="starboard").side
    'starboard'
    """
    _check(side, approach_speed, rudder_deg=rudder_deg)
    return Manoeuvre("turning_circle", float(rudder_deg), side=side, approach_speed=approach_speed)


def rudder_programme(
    time: np.ndarray, delta: np.ndarray, *, rate_limited: bool = True, approach_speed: float | None = None
) -> Manoeuvre:
    """Rudder angle as a function of time, linear between breakpoints and held after the last.

    Parameters
    ----------
    time : array_like, shape (n,)
        [s], increasing, from 0.
    delta : array_like, shape (n,)
        [rad], positive turns to port.
    rate_limited : bool, optional
        True for commands that the rudder follows at the vessel's rate, False for a record of what the rudder did.
    approach_speed : float, optional
        [m/s]; the vessel's nominal speed by default.

    Returns
    -------
    Manoeuvre

    Raises
    ------
    ManoeuvreError
        For arrays of different length, values that are not finite or times that do not increase.

    Examples
    --------
    A step to 10 deg at 50 s; the ship's steering gear is slower than the programme:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> programme = ps.rudder_programme([0, 50, 51], np.deg2rad([0, 0, 10]))
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), programme, duration=100, step=0.5)
    >>> print(np.rad2deg(trial["delta"].sel(time=[50, 52, 90]).values).round(1))
    [ 0.   3.5 10. ]
    """
    time, delta = np.array(time, dtype=float), np.array(delta, dtype=float)
    _check("port", approach_speed)
    if time.ndim != 1 or time.shape != delta.shape or not time.size:
        raise ManoeuvreError(
            f"A rudder programme has one angle for each time, found shapes {time.shape} and {delta.shape}."
        )
    if not (np.isfinite(time).all() and np.isfinite(delta).all()) or (np.diff(time) <= 0).any():
        raise ManoeuvreError("A rudder programme needs finite angles at finite, increasing times; sort and clean it.")
    programme = {"time": tuple(time.tolist()), "delta": tuple(delta.tolist()), "rate_limited": rate_limited}
    return Manoeuvre("rudder_programme", approach_speed=approach_speed, **programme)


def rudder_command(manoeuvre: Manoeuvre, time: np.ndarray) -> np.ndarray:
    """Commanded rudder angle [rad] at the given times [s]; for a zigzag, the first command throughout."""
    if manoeuvre.kind == "rudder_programme":
        return np.interp(time, manoeuvre.time, manoeuvre.delta)
    return np.full(np.shape(time), -SIDES[manoeuvre.side] * np.deg2rad(manoeuvre.rudder_deg))


def _check(side: str, approach_speed: float | None, **angles: float) -> None:
    if side not in SIDES:
        raise ManoeuvreError(f"The side is 'starboard' or 'port', found {side!r}; choose one of them.")
    if approach_speed is not None and not 0.0 < approach_speed < np.inf:
        raise ManoeuvreError(f"The approach speed must be positive and finite, found {approach_speed} m/s; correct it.")
    for name, angle in angles.items():
        if not 0.0 < angle < 90.0:
            raise ManoeuvreError(f"{name} is a magnitude between 0 and 90 deg, found {angle}; use `side` for the sign.")
