"""Posterior draws of a denoised signal and of a denoised trial."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymc_ship.machine.arguments import check_counts
from pymc_ship.machine.seeds import Seed, random_generator
from pymc_ship.machine.threads import map_in_threads
from pymc_ship.records.denoising.denoise import channels_to_denoise, finite_signal, without_turns
from pymc_ship.records.denoising.wavelet_posterior import wavelet_posterior
from pymc_ship.trial.record import as_trial


def denoise_draws(
    trial: xr.Dataset,
    wavelet: str = "sym8",
    prior: str = "laplace",
    translation_invariant: bool = True,
    *,
    draws: int = 200,
    rng: Seed,
    channels: Sequence[str] | None = None,
    **options: Any,
) -> xr.Dataset:
    """Draw motion channels from the posterior behind :func:`pymc_ship.denoise`.

    Parameters
    ----------
    trial, wavelet, prior, translation_invariant, channels
        As for :func:`pymc_ship.denoise`, with the same errors.
    draws : int, optional
    rng : int, SeedSequence or Generator
    **options
        ``scale``, ``levels``, ``boundary`` of :func:`pymc_ship.denoise_signal`.

    Returns
    -------
    Dataset, dims (draw, time)
        The trial with draws of its denoised channels, independent of each other. Each ``isel(draw=k)`` is a trial,
        ``std("draw")`` the pointwise standard deviation.

    Examples
    --------
    Standard deviation of the sway velocity, on average over the record, and its error:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> trial = ps.simulate(ps.load_vessel("kvlcc2"), ps.zigzag(20, 20), duration=300, step=0.5)
    >>> noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    >>> draws = ps.denoise_draws(noisy, rng=np.random.default_rng(2))
    >>> sd, error = draws["v"].std("draw").mean(), (draws["v"].mean("draw") - trial["v"]).std()
    >>> print(f"{1e3 * sd:.1f} mm/s, {1e3 * error:.1f} mm/s")
    4.4 mm/s, 3.1 mm/s
    """
    check_counts(draws=draws)
    rng, trial = random_generator(rng), as_trial(trial)
    names = channels_to_denoise(trial, channels)
    settings = {"wavelet": wavelet, "prior": prior, "translation_invariant": translation_invariant, **options}

    def draw(name: str, rng: np.random.Generator) -> np.ndarray:
        values, turns = without_turns(trial, name)
        return _draw(values, f"channel {name}", draws, rng, settings) + turns

    results = map_in_threads(draw, names, rng.spawn(len(names)))
    trial_draws = trial.assign_coords(draw=np.arange(draws))
    for name, values in zip(names, results, strict=True):
        trial_draws[name] = (("draw", "time"), values, trial[name].attrs)
    return trial_draws.assign_attrs(denoised=" ".join(names))


def denoise_signal_draws(
    y: ArrayLike,
    wavelet: str = "sym4",
    prior: str = "laplace",
    translation_invariant: bool = True,
    *,
    draws: int = 200,
    rng: Seed,
    **options: Any,
) -> np.ndarray:
    """Draw a signal from the posterior behind :func:`pymc_ship.denoise_signal`.

    In one orthogonal wavelet basis the spike-and-slab posterior is exact. Translation invariant, each draw takes one
    shift at random (Coifman & Donoho 1995, doi:10.1007/978-1-4612-2544-7_9). Noise sd and priors count as known.

    Parameters
    ----------
    y, wavelet, prior, translation_invariant
        As for :func:`pymc_ship.denoise_signal`, with the same errors.
    draws : int, optional
    rng : int, SeedSequence or Generator
    **options
        ``scale``, ``levels``, ``boundary`` of :func:`pymc_ship.denoise_signal`.
    """
    check_counts(draws=draws)
    settings = {"wavelet": wavelet, "prior": prior, "translation_invariant": translation_invariant, **options}
    return _draw(y, "signal", draws, random_generator(rng), settings)


def _draw(y: ArrayLike, what: str, draws: int, rng: np.random.Generator, settings: dict[str, Any]) -> np.ndarray:
    posterior = wavelet_posterior(finite_signal(y, what), what, **settings)
    return np.array([posterior.draw(rng) for _ in range(draws)])
