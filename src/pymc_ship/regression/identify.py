"""From a trial to the exact posterior of every degree of freedom under several prior families."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.regression.families import prior_family
from pymc_ship.regression.priors import ExactPosterior, Prior
from pymc_ship.regression.tree import independent_posterior
from pymc_ship.regression.tune import TunedPrior, maximise_evidence, on_edge, tune_prior
from pymc_ship.rows.data import RegressionData
from pymc_ship.rows.from_trials import regression_data
from pymc_ship.vessel.reading import VesselLike, as_vessel

SELECTIONS = ("evidence", "bayesian_optimisation")
"""Ways to choose the hyperparameters."""


@dataclass(frozen=True, repr=False)
class Identification:
    """Regression data of each DOF, and by family and DOF: the prior, how it was tuned and the exact posterior.

    ``tuned`` is empty where the priors come from the evidence maximum.
    """

    data: dict[str, RegressionData]
    priors: dict[str, dict[str, Prior]]
    tuned: dict[str, dict[str, TunedPrior]]
    exact: dict[str, dict[str, ExactPosterior]]

    def __repr__(self) -> str:
        """Rows and terms of each DOF, and the log evidence of each family."""
        vessels = {data.vessel for data in self.data.values()}
        head = f"Identification of {' and '.join(map(repr, sorted(vessels)))}, log evidence by family"
        lines = [
            f"  {dof:6}{data.n_rows:6} rows {data.n_terms:3} terms  "
            + "  ".join(f"{family} {exact[dof].log_evidence:.6g}" for family, exact in self.exact.items())
            for dof, data in self.data.items()
        ]
        return "\n".join([head, *lines])

    def posteriors(self, family: str, *, draws: int, rng: Seed) -> dict[str, xr.DataTree]:
        """Independent draws of every DOF under a family, by DOF."""
        rng = random_generator(rng)
        priors, exact = self.priors[family], self.exact[family]
        return {
            dof: independent_posterior(data, priors[dof], exact[dof].draw, draws=draws, rng=rng)
            for dof, data in self.data.items()
        }

    def edges(self, family: str) -> dict[str, tuple[str, ...]]:
        """Hyperparameters that lie on an edge of the family's box, by DOF; none for a DOF that is left out."""
        found = {dof: on_edge(prior) for dof, prior in self.priors[family].items()}
        return {dof: at for dof, at in found.items() if at}

    def coefficients(self, family: str) -> dict[str, np.ndarray]:
        """Posterior means by DOF, each of shape (n_terms,)."""
        return {dof: exact.mean for dof, exact in self.exact[family].items()}


def identify(
    trial: xr.Dataset,
    vessel: VesselLike,
    *,
    families: Sequence[str] = ("conjugate", "semiconjugate"),
    selection: str = "evidence",
    interval: float | None = 1.0,
    derivative: str = "euler",
    rng: Seed | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify a vessel's coefficients from a trial.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        Denoised for differences, as it was measured for the weak form.
    vessel : Vessel, str or Path
        Gives particulars, inertia and terms.
    families : sequence of str, optional
        Names of prior families; see :func:`~pymc_ship.regression.families.register_family` for one of your own.
    selection : {"evidence", "bayesian_optimisation"}, optional
        Hyperparameters from the maximum of the evidence or from Bayesian optimisation of the cross-validated log
        predictive density (which needs ``rng``).
    interval : float, optional
        Interval of the rows [s]; None for every sample, or each 4 s in the weak form, whose intervals get too narrow
        when its windows overlap more.
    derivative : str, optional
        See :func:`pymc_ship.regression_data`.
    rng : int, SeedSequence or Generator, optional
    progress : callable, optional
        Called with a short text before each step.

    Returns
    -------
    Identification

    Raises
    ------
    TrialError, RegressionDataError, PriorError
        For a trial that cannot be used, an unknown family.
    ValueError
        For an unknown selection, or Bayesian optimisation without ``rng``.

    Examples
    --------
    The rudder coefficients of a noisy zigzag:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> found = ps.identify(noisy, vessel, families=["conjugate"], interval=None, derivative="weak")
    >>> for dof, exact in found.exact["conjugate"].items():
    ...     print(f"{found.data[dof].coefficients[-1]} = {exact.mean[-1]:.5f}, sd {exact.sd[-1]:.5f}")
    Xgdeltadelta = -0.00145, sd 0.00068
    Ygdelta = 0.00554, sd 0.00047
    Ngdelta = -0.00195, sd 0.00002
    """
    rng = None if rng is None else random_generator(rng)
    vessel = as_vessel(vessel)
    if selection not in SELECTIONS or (selection == "bayesian_optimisation" and rng is None):
        raise ValueError(
            f"Hyperparameters are selected by {' or '.join(SELECTIONS)} (which needs rng), found {selection!r}."
        )
    data = {dof: regression_data(trial, vessel, dof, interval=interval, derivative=derivative) for dof in vessel.dofs}
    priors: dict[str, dict] = {}
    tuned: dict[str, dict] = {}
    exact: dict[str, dict] = {}
    for family in families:
        prior_family(family)
        priors[family], exact[family], tuned[family] = {}, {}, {}
        for dof, rows in data.items():
            progress(f"prior of {dof}, {family}")
            if selection == "evidence":
                priors[family][dof], _ = maximise_evidence(rows, family)
            else:
                tuned[family][dof] = tune_prior(rows, family=family, rng=rng)
                priors[family][dof] = tuned[family][dof].prior
            exact[family][dof] = priors[family][dof].exact(rows)
    return Identification(data, priors, tuned, exact)
