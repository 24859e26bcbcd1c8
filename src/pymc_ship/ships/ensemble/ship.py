"""The ship: posterior draws of several weighted models, with the distributions of the model error."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from pymc_ship.inference.trajectory.sequential_likelihood import EarlierLikelihood
from pymc_ship.machine.arguments import check_counts, check_kind, number_or_nan, short_repr
from pymc_ship.machine.errors import ShipError, VesselError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.physics.vessel.vessel import Vessel, most_dofs, reference_coefficients
from pymc_ship.records.steering.recognition import Steering
from pymc_ship.ships.ensemble.draws import coefficient_draws, fitted_motion, sensor_noise
from pymc_ship.ships.ensemble.index_error import extrapolation_growth, growth_at
from pymc_ship.ships.ensemble.index_table import index_table
from pymc_ship.trial.channels import SIMULATED


@dataclass(frozen=True, eq=False)
class Member:
    """One model of an ensemble."""

    name: str  # of the term set or the method
    vessel: Vessel
    draws: np.ndarray  # (n_draws, n_coefficients)
    estimate: np.ndarray  # (n_coefficients,)
    weight: float = 1.0  # fraction of the ensemble
    likelihood: EarlierLikelihood | None = None  # of all runs so far
    inflation: float = 1.0  # factor on the sd of the draws
    design_effect: float = 1.0  # the power of the likelihood is 1 / design_effect

    def __repr__(self) -> str:
        return f"Member({self.name!r}, {len(self.draws)} draws, weight {self.weight:.3g})"


@dataclass(frozen=True, eq=False)
class Ship:
    """A ship: an ensemble of models with the distributions of their errors.

    Attributes
    ----------
    members : tuple of Member; by descending weight, some perhaps without draws
    motion : DataArray, dims (row, symbol), or None; non-dimensional (prime) motion of the training runs
    index_error : dict of str to ndarray, or None; quantiles of the sd of the indices by kind, from :func:`.model_error`
    motion_error : dict of str to ndarray; quantiles of the sd of the motion by state, from :func:`.motion_error`
    extrapolation_growth : ndarray; growths of both errors beyond the runs, from :func:`.extrapolation_growth`
    noise_sd : dict of str to float; sensor noise sd by channel [SI], of a joint posterior
    facilities : dict of str to Steering; steering by facility, most trials first
    remarks : tuple of str; how the intervals were made
    prior : str; kind of prior of the coefficients
    held_out_indices : Dataset, dims (run, index), from :func:`.index_table`
    harder_indices : Dataset, dims (run, index); the same of the harder runs, forecast by the milder ones
    uses_captive_tests : bool; whether the likelihoods include captive tests
    """

    members: tuple[Member, ...]
    motion: xr.DataArray | None = None
    index_error: dict[str, np.ndarray] | None = None
    motion_error: dict[str, np.ndarray] = field(default_factory=dict)
    extrapolation_growth: np.ndarray = field(default_factory=lambda: extrapolation_growth((), {}))
    noise_sd: dict[str, float] = field(default_factory=dict)
    facilities: dict[str, Steering] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    prior: str = ""
    held_out_indices: xr.Dataset = field(default_factory=lambda: index_table(()))
    harder_indices: xr.Dataset = field(default_factory=lambda: index_table(()))
    uses_captive_tests: bool = False

    def growth_at(self, beyond: float) -> np.ndarray:
        """Equally probable growths of the errors at a distance beyond the runs, in ranges of them."""
        measured = float(self.harder_indices["beyond"].max()) if self.harder_indices.sizes["run"] else 0.0
        return growth_at(self.extrapolation_growth, measured, beyond)

    @classmethod
    def from_posterior(
        cls,
        vessel: VesselLike,
        posteriors: Mapping[str, xr.DataTree] | xr.DataTree,
        *,
        draws: int = 300,
        rng: Seed,
        noise_sd: Mapping[str, float] | None = None,
    ) -> "Ship":
        """Ship of the draws of a posterior.

        Parameters
        ----------
        vessel : Vessel, str or Path
        posteriors : DataTree or mapping of str to DataTree
            Joint posterior, or that of each DOF, of any method; a DOF without one has the vessel's reference values.
        draws : int, optional
        rng : int, SeedSequence or Generator
        noise_sd : mapping of str to float, optional
            Sensor noise sd by channel [SI]; default: that of a joint posterior.

        Returns
        -------
        Ship
            Without model error: forecasts have the uncertainty of the coefficients only.

        Raises
        ------
        VesselError
            For no posterior, or posteriors that do not fit the vessel.
        ValueError
            For fewer than two draws, or noise that is invalid or of an unknown channel.
        """
        check_counts(least=2, draws=draws)
        rng, vessel = random_generator(rng), as_vessel(vessel)
        if posteriors is None or (isinstance(posteriors, Mapping) and not posteriors):
            found = short_repr(posteriors)
            raise VesselError(
                f"A ship needs a posterior, found {found}; give a joint one, or take ps.Ship.from_vessel."
            )
        if noise_sd is not None:
            check_kind("noise_sd", noise_sd, Mapping, "give a dict by channel")
        noise = sensor_noise(posteriors) if noise_sd is None else dict(noise_sd)
        for name, sd in noise.items():
            if name not in SIMULATED or not 0.0 <= number_or_nan(sd) < np.inf:
                raise ShipError(
                    f"The sd of sensor noise is finite and at least 0, for any of {', '.join(SIMULATED)}; found {sd} "
                    f"for {name!r}; correct it."
                )
        rows = coefficient_draws(vessel, posteriors, draws, rng)
        member = Member("posterior", vessel, rows, rows.mean(axis=0))
        return cls((member,), motion=fitted_motion(posteriors), noise_sd=noise)

    @classmethod
    def from_vessel(cls, vessel: VesselLike) -> "Ship":
        """Ship of one draw, the coefficients of a vessel file; VesselError for a file that cannot be read."""
        vessel = as_vessel(vessel)
        values = reference_coefficients(vessel)
        return cls((Member("vessel file", vessel, values[None], values),))

    @property
    def models(self) -> list[tuple[Vessel, np.ndarray]]:
        """Vessel and draws (n_draws, n_coefficients) of each member with draws."""
        return [(one.vessel, one.draws) for one in self.members if len(one.draws)]

    @property
    def vessel(self) -> Vessel:
        """Vessel of the member of largest weight; members with roll come first."""
        return most_dofs(vessel for vessel, _ in self.models)

    @property
    def likelihoods(self) -> dict[str, EarlierLikelihood]:
        """Likelihood of all runs so far, by term set."""
        return {one.name: one.likelihood for one in self.members if one.likelihood is not None}

    @property
    def draws(self) -> int:
        """Number of draws of all members."""
        return sum(len(one.draws) for one in self.members)

    def __repr__(self) -> str:
        n, runs = len(self.models), self.held_out_indices.sizes["run"]
        errors = "unknown" if self.index_error is None else f"from {runs} held-out run{'s' * (runs != 1)}"
        models = f"{n} model{'s' * (n != 1)}, {self.draws} draws"
        return f"Ship({self.vessel.name}: {models}, model error {errors})"


ShipLike = Ship | VesselLike


def as_ship(ship: ShipLike) -> Ship:
    """The ship, or that of a vessel; VesselError for anything else."""
    if isinstance(getattr(ship, "ship", None), Ship):
        raise VesselError("A ship or a vessel is needed, found an identification; give its attribute `ship`.")
    return ship if isinstance(ship, Ship) else Ship.from_vessel(ship)
