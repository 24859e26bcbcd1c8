"""Exact posteriors of all degrees of freedom of a trial, and posteriors pooled over draws of a denoised trial."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.families import prior_family
from pymc_ship.inference.regression.priors import ExactPosterior, Prior, check_prior, rescaled_prior
from pymc_ship.inference.regression.tree import exact_posterior
from pymc_ship.inference.regression.tune import TunedPrior, maximise_evidence, on_edge, tune_prior
from pymc_ship.inference.rows.data import RegressionData
from pymc_ship.inference.rows.from_trials import regression_data
from pymc_ship.machine.arguments import check_callables, check_choice, check_counts, name_list
from pymc_ship.machine.errors import InferenceError, ShipError
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.physics.vessel.reading import VesselLike, as_vessel
from pymc_ship.trial.record import as_trial

SELECTIONS = ("evidence", "bayesian_optimisation")  # ways to choose the hyperparameters
CI_PROB = 0.9  # probability of the pooled intervals


@dataclass(frozen=True, repr=False)
class Identification:
    """Regression data by DOF; prior, tuning (empty for maximum evidence) and exact posterior by family and DOF."""

    data: dict[str, RegressionData]
    priors: dict[str, dict[str, Prior]]
    tuned: dict[str, dict[str, TunedPrior]]
    exact: dict[str, dict[str, ExactPosterior]]

    def __repr__(self) -> str:
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
        priors = self.priors[family]
        return {dof: exact_posterior(data, priors[dof], draws=draws, rng=rng) for dof, data in self.data.items()}

    def edges(self, family: str) -> dict[str, tuple[str, ...]]:
        """Hyperparameters on a bound of the family's box, by DOF; DOFs without any are left out."""
        names = {dof: on_edge(prior) for dof, prior in self.priors[family].items()}
        return {dof: at for dof, at in names.items() if at}

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
        Denoised if accelerations are differences; as measured for the weak form.
    vessel : Vessel, str or Path
    families : sequence of str, optional
        Names of prior families, registered ones included.
    selection : {"evidence", "bayesian_optimisation"}, optional
        How hyperparameters are chosen: :func:`~pymc_ship.inference.regression.tune.maximise_evidence`, or
        :func:`~pymc_ship.inference.regression.tune.tune_prior`, which needs ``rng``.
    interval, derivative : optional
        As :func:`pymc_ship.regression_data`, the interval 1 s by default.
    rng : int, SeedSequence or Generator, optional
    progress : callable, optional
        Called with a short text before each step.

    Raises
    ------
    TrialError, InferenceError, ValueError
        For an unusable trial, an unknown family or selection, or Bayesian optimisation without ``rng``.

    Warns
    -----
    BoundWarning
        If a search ends at a bound; ``edges`` of the result names the hyperparameters.

    Examples
    --------
    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> identified = ps.identify(noisy, vessel, families=["conjugate"], interval=None, derivative="weak")
    >>> for dof, exact in identified.exact["conjugate"].items():
    ...     print(f"{identified.data[dof].coefficients[-1]} = {exact.mean[-1]:.5f}, sd {exact.sd[-1]:.5f}")
    Xgsinsin = -0.00200, sd 0.00039
    Ygsincos|delta| = 0.01065, sd 0.00392
    Ngsincos|delta| = -0.00088, sd 0.00027
    """
    check_callables(progress=progress)
    rng = None if rng is None else random_generator(rng)
    vessel, trial = as_vessel(vessel), as_trial(trial)
    check_choice("The selection of hyperparameters", selection, SELECTIONS)
    if selection == "bayesian_optimisation" and rng is None:
        raise ShipError("The selection by bayesian_optimisation needs a generator, found none; give rng.")
    families = name_list("The families", families)
    data = {dof: regression_data(trial, vessel, dof, interval=interval, derivative=derivative) for dof in vessel.dofs}
    priors: dict[str, dict[str, Prior]] = {family: {} for family in families}
    tuned: dict[str, dict[str, TunedPrior]] = {family: {} for family in families}
    exact: dict[str, dict[str, ExactPosterior]] = {family: {} for family in families}
    for family in families:
        prior_family(family)
        for dof, rows in data.items():
            progress(f"prior of {dof}, {family}")
            if rng is None or selection == "evidence":
                priors[family][dof], _ = maximise_evidence(rows, family)
            else:
                tuned[family][dof] = tune_prior(rows, family=family, rng=rng)
                priors[family][dof] = tuned[family][dof].prior
            exact[family][dof] = priors[family][dof].exact(rows)
    return Identification(data, priors, tuned, exact)


def regression_draws(
    drawn: xr.Dataset, vessel: VesselLike, dof: str, *, interval: float | None = None, derivative: str = "euler"
) -> list[RegressionData]:
    """Regression data of each draw of a denoised trial.

    The other arguments are those of :func:`pymc_ship.regression_data`. InferenceError without draws.
    """
    vessel = as_vessel(vessel)
    if "draw" not in as_trial(drawn).dims:
        raise InferenceError("Regression draws need a trial with the dimension draw, found none; use denoise_draws.")
    runs = (drawn.isel(draw=k, drop=True) for k in range(drawn.sizes["draw"]))
    return [regression_data(run, vessel, dof, interval=interval, derivative=derivative) for run in runs]


def pooled_coefficients(rows: Sequence[RegressionData], prior: Prior, *, draws: int = 4000, rng: Seed) -> xr.Dataset:
    """Coefficients pooled over draws of the rows: multiple imputation of Rubin (1987).

    Parameters
    ----------
    rows : sequence of RegressionData
        The same regression on two or more draws of its data, from :func:`regression_draws`.
    prior : Prior
        Of the scaled coefficients; with vectors, such as of :func:`informed_prior`, on the scales of the first rows.
    draws : int, optional
        Draws from the mixture for its quantiles, equally many of each posterior.
    rng : int, SeedSequence or Generator

    Returns
    -------
    Dataset, dims (coefficient,)
        Original scale: ``mean``; ``within_sd``, the posterior sd for known rows; ``between_sd`` of the means over the m
        draws; ``sd`` by Rubin's rule, within^2 + (1 + 1/m) between^2; ``lower``, ``upper``: equal-tailed 90 % interval.

    Raises
    ------
    InferenceError
        For fewer than two draws, rows of different coefficients, or no prior.
    """
    check_counts(InferenceError, draws=draws)
    rng, rows = random_generator(rng), list(rows) if isinstance(rows, Iterable) else [rows]
    for data in rows:
        check_prior(prior, data)
    names = {data.coefficients for data in rows}
    if len(rows) < 2 or len(names) > 1:
        raise InferenceError(
            f"Pooling needs two or more draws of one regression, found {len(rows)} with {len(names)} sets of "
            "coefficients; draw again."
        )
    exact = [rescaled_prior(prior, rows[0], data).exact(data) for data in rows]
    mean = np.mean([one.mean for one in exact], axis=0)
    within = np.mean([one.sd**2 for one in exact], axis=0)
    between = np.var([one.mean for one in exact], axis=0, ddof=1)
    sample = np.concatenate([one.draw(-(-draws // len(exact)), rng)[0] for one in exact])
    lower, upper = np.quantile(sample, [0.5 - 0.5 * CI_PROB, 0.5 + 0.5 * CI_PROB], axis=0)
    total = np.sqrt(within + (1.0 + 1.0 / len(exact)) * between)
    columns = {"mean": mean, "within_sd": np.sqrt(within), "between_sd": np.sqrt(between), "sd": total}
    columns |= {"lower": lower, "upper": upper}
    coefficients = {"coefficient": list(rows[0].coefficients)}
    return xr.Dataset({name: ("coefficient", values) for name, values in columns.items()}, coefficients)
