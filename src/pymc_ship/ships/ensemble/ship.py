"""The ship: draws of one model or of several, and what is known of their errors and of the runs behind them.

A forecast, a replay, a score and the design of the next run take a ship. An identification makes one, and so do a
posterior and a vessel file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.machine.errors import VesselError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, most_dofs, reference_coefficients
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.draws import coefficient_draws, fitted_motion, sensor_noise
from pymc_ship.ships.ensemble.index_table import index_table
from pymc_ship.trial.channels import SIMULATED


@dataclass(frozen=True, eq=False)
class Member:
    """One model of an ensemble.

    Attributes
    ----------
    name : str
        Of its term set, or of what made it.
    vessel : Vessel
    draws : ndarray, shape (n_draws, n_coefficients)
    estimate : ndarray, shape (n_coefficients,)
    weight : float
        Share of the ensemble.
    likelihood : Earlier or None
        Likelihood of all runs so far, for runs to come.
    inflation, dispersion : float
        Factor on the standard deviations, and design effect of the windows' likelihood.
    """

    name: str
    vessel: Vessel
    draws: np.ndarray
    estimate: np.ndarray
    weight: float = 1.0
    likelihood: EarlierLikelihood | None = None
    inflation: float = 1.0
    design_effect: float = 1.0

    def __repr__(self) -> str:
        """Name and number of draws."""
        return f"Member({self.name!r}, {len(self.draws)} draws, weight {self.weight:.3g})"


@dataclass(frozen=True, eq=False)
class Ship:
    """A ship as forecasts and later runs take it: an ensemble of models with the laws of their errors.

    Attributes
    ----------
    members : tuple of Member
        By falling weight; one without draws takes no part.
    motion : DataArray, dims (row, symbol), or None
        Prime motion of the runs; None where it is unknown.
    index_error : dict of str to ndarray, or None
        Equally probable sizes of the error of indices beyond the draws, by kind; see
        :func:`pymc_ship.ships.ensemble.index_error.model_error`. None where only the draws are known.
    motion_error : dict of str to ndarray
        Equally probable sizes of the error of the motion beyond the draws, by state; see
        :func:`pymc_ship.ships.ensemble.motion_error.motion_error`.
    noise_sd : dict of str to float
        Standard deviation of the sensors by channel [SI], as a joint posterior found it.
    facilities : dict of str to Steering
        How the rudder was steered at each facility, by name, that with the most trials first.
    remarks : tuple of str
        How the intervals were made.
    prior : str
        Kind of prior of the coefficients.
    held_out_indices : Dataset, dims (run, index)
        Indices of the held-out manoeuvres of all runs so far, see
        :func:`pymc_ship.ships.ensemble.index_table.index_table`.
    uses_captive_tests : bool
        Whether captive tests are part of the likelihoods.
    """

    members: tuple[Member, ...]
    motion: xr.DataArray | None = None
    index_error: dict[str, np.ndarray] | None = None
    motion_error: dict[str, np.ndarray] = field(default_factory=dict)
    noise_sd: dict[str, float] = field(default_factory=dict)
    facilities: dict[str, Steering] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    prior: str = ""
    held_out_indices: xr.Dataset = field(default_factory=lambda: index_table(()))
    uses_captive_tests: bool = False

    @classmethod
    def from_posterior(
        cls,
        vessel: VesselLike,
        posteriors: Mapping[str, xr.DataTree] | xr.DataTree,
        *,
        draws: int = 300,
        rng: Seed,
        noise_sd: Mapping[str, float] | None = None,
    ) -> Ship:
        """Make a ship of the draws of a posterior.

        Parameters
        ----------
        vessel : Vessel, str or Path
        posteriors : DataTree or mapping of str to DataTree
            Joint posterior of all coefficients, or the posterior of each DOF, of any method; a DOF that a mapping
            leaves out keeps the vessel's reference values.
        draws : int, optional
        rng : int, SeedSequence or Generator
        noise_sd : mapping of str to float, optional
            Standard deviation of the noise of the sensors by channel [SI]; by default what a joint posterior has.

        Returns
        -------
        Ship
            Without a law of errors beyond the draws: forecasts have the uncertainty of the coefficients alone.

        Raises
        ------
        VesselError
            For posteriors that do not fit the vessel.
        ValueError
            For fewer than two draws, or noise of an unknown channel or one that is negative or not finite.

        Examples
        --------
        >>> import numpy as np
        >>> import pymc_ship as ps
        >>> vessel, rng = ps.load_vessel("kvlcc2"), np.random.default_rng(1)
        >>> trial = ps.pollute(ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5), level=0.01, rng=rng)
        >>> found = ps.identify(trial, vessel, families=["conjugate"], interval=None, derivative="weak")
        >>> ship = ps.Ship.from_posterior(vessel, found.posteriors("conjugate", draws=40, rng=rng), draws=40, rng=rng)
        >>> ship
        Ship(kvlcc2: 1 model, 40 draws, errors beyond the draws unknown)
        """
        rng, vessel = random_generator(rng), as_vessel(vessel)
        if draws < 2:
            raise ValueError(f"A ship of a posterior needs two draws or more, found {draws}; ask for more.")
        noise = sensor_noise(posteriors) if noise_sd is None else dict(noise_sd)
        _check_noise(noise)
        rows = coefficient_draws(vessel, posteriors, draws, rng)
        member = Member("posterior", vessel, rows, rows.mean(axis=0))
        return cls((member,), motion=fitted_motion(posteriors), noise_sd=noise)

    @classmethod
    def from_vessel(cls, vessel: VesselLike) -> Ship:
        """Make a ship of one draw: the coefficients of a vessel file.

        Parameters
        ----------
        vessel : Vessel, str or Path

        Raises
        ------
        VesselError
            For a file that cannot be read.
        """
        vessel = as_vessel(vessel)
        values = reference_coefficients(vessel)
        return cls((Member("vessel file", vessel, values[None], values),))

    @property
    def models(self) -> list[tuple[Vessel, np.ndarray]]:
        """Vessel and draws (n_draws, n_coefficients) of each member that takes part."""
        return [(one.vessel, one.draws) for one in self.members if len(one.draws)]

    @property
    def vessel(self) -> Vessel:
        """Vessel of the member that weighs most, of those that roll where some do."""
        return most_dofs(vessel for vessel, _ in self.models)

    @property
    def likelihoods(self) -> dict[str, EarlierLikelihood]:
        """Likelihood of all runs so far, by term set."""
        return {one.name: one.likelihood for one in self.members if one.likelihood is not None}

    @property
    def draws(self) -> int:
        """Draws of all members."""
        return sum(len(one.draws) for one in self.members)

    def __repr__(self) -> str:
        """Name, number of models and draws, and whether the errors beyond the draws are known."""
        n, runs = len(self.models), self.held_out_indices.sizes["run"]
        known = "unknown" if self.index_error is None else f"from {runs} held-out run{'s' * (runs != 1)}"
        return (
            f"Ship({self.vessel.name}: {n} model{'s' * (n != 1)}, {self.draws} draws, errors beyond the draws {known})"
        )


ShipLike = Ship | VesselLike
"""A ship, or the vessel or file that one is made of."""


def as_ship(ship: ShipLike) -> Ship:
    """Ship as it is, or that of a vessel; VesselError for anything else."""
    if isinstance(getattr(ship, "ship", None), Ship):
        raise VesselError("A ship or a vessel is meant, found an identification; give its ship, `found.ship`.")
    return ship if isinstance(ship, Ship) else Ship.from_vessel(ship)


def _check_noise(noise: Mapping[str, float]) -> None:
    for name, sd in noise.items():
        if name not in SIMULATED or not 0.0 <= sd < np.inf:
            raise ValueError(
                f"Sensor noise has a standard deviation from 0 up for any of {', '.join(SIMULATED)}; found {sd} for "
                f"{name!r}; correct it."
            )
