"""Standard manoeuvres as values (IMO MSC.137(76)): zigzag, turning circle, pull-out, spiral, rudder programme.

A positive rudder angle turns the ship to port; the constructors take magnitudes and the side turned to first.
"""

from dataclasses import dataclass, replace

import numpy as np

from pymc_ship.machine.arguments import check_choice, check_flags, number_or_nan, real_array, short_repr
from pymc_ship.machine.errors import SimulationError
from pymc_ship.physics.manoeuvre.kinds import SIDES, ManoeuvreKind
from pymc_ship.physics.manoeuvre.registry import KINDS, kind_named

_TWO_ROUNDS = 720.0  # deg of heading
_STEP = 0.1  # s, duration of a step of the order from one angle to the next


@dataclass(frozen=True)
class Manoeuvre:
    """A manoeuvre of a registered kind.

    ``rudder_deg`` and ``heading_deg`` (switching heading) are magnitudes, ``side`` is turned to first; an
    ``approach_speed`` [m/s] of None is the nominal speed. ``time`` and ``delta`` [s, rad] are breakpoints of a rudder
    programme. If ``rate_limited``, the rudder follows at the vessel's rudder rate, else exactly.
    """

    kind: str
    rudder_deg: float = 0.0
    heading_deg: float = 0.0
    side: str = "port"
    approach_speed: float | None = None
    time: tuple[float, ...] = ()
    delta: tuple[float, ...] = ()
    rate_limited: bool = True

    def __post_init__(self) -> None:
        kind_named(self.kind)

    def __repr__(self) -> str:
        details = [f"from {self.approach_speed:g} m/s"] if self.approach_speed is not None else []
        if self.time:
            low, high = np.rad2deg([min(self.delta), max(self.delta)])
            details.append(f"{len(self.time)} angles of {low:.3g} to {high:.3g} deg up to {self.time[-1]:g} s")
        details += [] if self.rate_limited else ["which the rudder follows exactly"]
        return f"<Manoeuvre: {', '.join([self.label, *details])}>"

    @property
    def traits(self) -> ManoeuvreKind:
        """The kind of the manoeuvre: indices, limits, figures, reach."""
        return kind_named(self.kind)

    @property
    def label(self) -> str:
        """Short name: ``zigzag 20/20 starboard``, ``turning circle 35 port``."""
        angles = "/".join(f"{getattr(self, name):g}" for name in self.traits.angles)
        return f"{self.traits.words} {angles} {self.side}" if angles else self.traits.words

    @property
    def attrs(self) -> dict[str, object]:
        """Attrs of a record of the manoeuvre: kind, angles [deg] and side."""
        angles = {"rudder_deg": self.rudder_deg, "heading_deg": self.heading_deg}
        return {"manoeuvre": self.kind, **angles, "side": self.side}

    @property
    def switch(self) -> tuple[float, float]:
        """Switching heading [rad], infinite for none, and the factor on the rudder angle there."""
        factor = self.traits.second_execute_factor
        return (np.inf, 1.0) if factor is None else (np.deg2rad(self.heading_deg), float(factor))

    def command(self, time: np.ndarray) -> np.ndarray:
        """Ordered rudder angle [rad] at times [s] before the switching heading."""
        if self.time:
            return np.interp(time, self.time, self.delta)
        return np.full(np.shape(time), -SIDES[self.side] * np.deg2rad(self.rudder_deg))


def one_manoeuvre(manoeuvre: object) -> Manoeuvre:
    """The manoeuvre itself; SimulationError for anything else."""
    if not isinstance(manoeuvre, Manoeuvre):
        makers = "zigzag, turning_circle or rudder_programme"
        raise SimulationError(f"The manoeuvre is made by {makers}, found {short_repr(manoeuvre)}; give one of these.")
    return manoeuvre


def standard_manoeuvre(kind: str, *angles: float, side: str = "port", approach_speed: float | None = None) -> Manoeuvre:
    """Manoeuvre of any kind with ``angles`` [deg]; side, approach speed and errors as of :func:`zigzag`."""
    traits = kind_named(kind)
    names = traits.angles
    if not names or len(angles) != len(names):
        wanted = " and ".join(names) or "its own constructor"
        raise SimulationError(f"A {kind} is made with {wanted}, found {len(angles)} angles; correct it.")
    magnitudes = dict(zip(names, angles, strict=True))
    _check(side, approach_speed, widest=_TWO_ROUNDS if traits.second_execute_factor == 0.0 else 90.0, **magnitudes)
    rudder_deg, heading_deg = (float(magnitudes.get(name, 0.0)) for name in ("rudder_deg", "heading_deg"))
    return Manoeuvre(kind, rudder_deg, heading_deg, side=side, approach_speed=approach_speed)


def written_manoeuvre(text: str) -> Manoeuvre | None:
    """Manoeuvre of a label such as ``zigzag 20/20 port``, by default to port; None for other words."""
    words = text.split()
    side = words.pop() if words and words[-1] in SIDES else "port"
    *name, angles = words or [""]
    kind = KINDS.get("_".join(name))
    try:
        numbers = [float(angle) for angle in angles.split("/")]
    except ValueError:
        return None
    if kind is None or len(numbers) != len(kind.angles):
        return None
    return standard_manoeuvre(kind.name, *numbers, side=side)


def zigzag(
    rudder_deg: float, heading_deg: float, *, side: str = "port", approach_speed: float | None = None
) -> Manoeuvre:
    """Zigzag test: the rudder is reversed when the heading has changed by heading_deg.

    Parameters
    ----------
    rudder_deg, heading_deg : float
        Magnitudes [deg].
    side : {"port", "starboard"}, optional
        Side turned to first; port is the side of the positive rudder angle.
    approach_speed : float, optional
        [m/s]; the vessel's nominal speed by default.

    Raises
    ------
    SimulationError
        For angles or a speed that are not positive, or an unknown side.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> manoeuvre = ps.zigzag(10, 20, side="starboard")
    >>> manoeuvre.rudder_deg, manoeuvre.heading_deg, manoeuvre.side
    (10.0, 20.0, 'starboard')
    """
    return standard_manoeuvre("zigzag", rudder_deg, heading_deg, side=side, approach_speed=approach_speed)


def turning_circle(rudder_deg: float = 35.0, *, side: str = "port", approach_speed: float | None = None) -> Manoeuvre:
    """Turning circle with constant rudder from time 0.

    Parameters and errors as :func:`zigzag`.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> turn = ps.simulate("kvlcc2", ps.turning_circle(35), duration=900, step=0.5)
    >>> print(f"{float(ps.indices(turn)['tactical_diameter']) / 320.0:.2f} L")
    3.61 L
    """
    return standard_manoeuvre("turning_circle", rudder_deg, side=side, approach_speed=approach_speed)


def pull_out(
    rudder_deg: float = 20.0, heading_deg: float = 90.0, *, side: str = "port", approach_speed: float | None = None
) -> Manoeuvre:
    """Pull-out: a turn until the heading has changed by heading_deg, then rudder amidships.

    Parameters and errors as :func:`zigzag`; heading_deg up to 720 deg.
    """
    return standard_manoeuvre("pull_out", rudder_deg, heading_deg, side=side, approach_speed=approach_speed)


def direct_spiral(
    rudder_deg: float = 15.0, step_deg: float = 5.0, *, hold: float, approach_speed: float | None = None
) -> Manoeuvre:
    """Direct spiral: steady turns from rudder_deg on one side to the other and back.

    Parameters
    ----------
    rudder_deg, step_deg : float
        Largest angle and the step to the next one [deg].
    hold : float
        Time at each angle [s]; 10 L/U lets most ships turn steadily.
    approach_speed : float, optional
        [m/s]; the vessel's nominal speed by default.

    Returns
    -------
    Manoeuvre
        A rudder programme, whose last time is its duration.

    Raises
    ------
    SimulationError
        For values that are not positive, or a step that does not divide the largest angle.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> print(ps.direct_spiral(15, 5, hold=400).time[-1])
    5200.0
    """
    _check("port", approach_speed, rudder_deg=rudder_deg, step_deg=step_deg)
    steps = round(rudder_deg / step_deg)
    if not (_STEP < number_or_nan(hold) < np.inf and abs(steps * step_deg - rudder_deg) < 1e-9 * rudder_deg):
        raise SimulationError(
            "A direct spiral holds each angle for some time and goes on in steps that divide the largest, found "
            f"{rudder_deg:g} deg in steps of {step_deg:g} deg held for {short_repr(hold)} s; correct it."
        )
    there = np.linspace(rudder_deg, -rudder_deg, 2 * steps + 1)
    angles = np.append(there, there[-2::-1])
    return stepped_rudder_programme(angles, np.full(angles.size, hold), approach_speed=approach_speed)


def stepped_rudder_programme(
    angles_deg: np.ndarray, holds: np.ndarray, *, approach_speed: float | None = None
) -> Manoeuvre:
    """Rudder programme of angles [deg], each for its time [s], shape (n,) both."""
    ends = np.cumsum(holds, dtype=float)
    begins = np.append(0.0, ends[:-1] + _STEP)
    time, delta = np.column_stack([begins, ends]).ravel(), np.repeat(np.deg2rad(angles_deg), 2)
    return rudder_programme(time, delta, approach_speed=approach_speed)


def rudder_programme(
    time: np.ndarray, delta: np.ndarray, *, rate_limited: bool = True, approach_speed: float | None = None
) -> Manoeuvre:
    """Rudder angle over time, linear between breakpoints.

    Parameters
    ----------
    time : array_like, shape (n,)
        [s], increasing, from 0; the last angle stays.
    delta : array_like, shape (n,)
        [rad], positive turns to port.
    rate_limited : bool, optional
        True for commands that the rudder follows at the vessel's rate, False for a record of what the rudder did.
    approach_speed : float, optional
        [m/s]; the vessel's nominal speed by default.

    Raises
    ------
    SimulationError
        For arrays of different length, values that are not finite, times that do not increase, or another value of
        ``rate_limited``.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> programme = ps.rudder_programme([0, 50, 51], np.deg2rad([0, 0, 10]))
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), programme, duration=100, step=0.5)
    >>> print(np.rad2deg(trial["delta"].sel(time=[50, 52, 90]).values).round(1))
    [ 0.   3.5 10. ]
    """
    time = real_array("The time of a programme", time, SimulationError)
    delta = real_array("The rudder angle of a programme", delta, SimulationError)
    _check("port", approach_speed)
    if time.ndim != 1 or time.shape != delta.shape or not time.size:
        shapes = f"{time.shape} and {delta.shape}"
        raise SimulationError(f"A programme has one angle for each time, found shapes {shapes}; match them.")
    if not (np.isfinite(time).all() and np.isfinite(delta).all()) or (np.diff(time) <= 0).any():
        raise SimulationError("A rudder programme needs finite angles at finite, increasing times; sort and clean it.")
    check_flags(SimulationError, rate_limited=rate_limited)
    programme = Manoeuvre("rudder_programme", approach_speed=approach_speed, rate_limited=rate_limited)
    return replace(programme, time=tuple(time.tolist()), delta=tuple(delta.tolist()))


def _check(side: str, approach_speed: float | None, widest: float = 90.0, **angles: float) -> None:
    check_choice("The side", side, SIDES, SimulationError)
    if approach_speed is not None and not 0.0 < number_or_nan(approach_speed) < np.inf:
        raise SimulationError(
            f"The approach speed must be positive and finite, found {short_repr(approach_speed)} m/s; correct it."
        )
    for name, angle in angles.items():
        most = widest if name == "heading_deg" else 90.0
        if not 0.0 < number_or_nan(angle) < most:
            raise SimulationError(
                f"{name} is a magnitude between 0 and {most:g} deg, found {short_repr(angle)}; use `side` for the sign."
            )


STANDARD = tuple(
    make(*angles, side=side)
    for make, angles in ((zigzag, (10, 10)), (zigzag, (20, 20)), (turning_circle, (35,)))
    for side in ("port", "starboard")
)
"""Manoeuvres that every ship must be able to run (IMO MSC.137(76))."""
