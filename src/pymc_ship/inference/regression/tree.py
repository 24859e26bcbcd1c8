"""Posterior draws as a DataTree with ArviZ groups and dims, and their files."""

import json
import math
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_ship.inference.regression.priors import Prior, check_prior
from pymc_ship.inference.rows.data import LABELS, RegressionData
from pymc_ship.machine.arguments import as_path, check_counts, check_kind, short_repr
from pymc_ship.machine.checksums import append_checksum, folder_checksum, has_valid_checksum
from pymc_ship.machine.errors import InferenceError, ShipError
from pymc_ship.machine.files import finish_killed_runs, staged_path
from pymc_ship.machine.seeds import Seed, random_generator

CITATIONS = {
    "method": "Xue, Liu, Ji & Xue (2020), Ocean Engineering 195:106612, doi:10.1016/j.oceaneng.2019.106612",
    "gibbs": "Gelfand & Smith (1990), JASA 85(410):398, doi:10.1080/01621459.1990.10476213",
    "nuts": "Hoffman & Gelman (2014), JMLR 15:1593; Abril-Pla et al. (2023), PyMC, doi:10.7717/peerj-cs.1516",
    "trajectory": "Maine & Iliff (1986), Application of parameter estimation to aircraft, NASA RP-1168",
    "trajectory_nuts": "Maine & Iliff (1986), NASA RP-1168; Hoffman & Gelman (2014), JMLR 15:1593",
    "windows": (
        "White (1982), Econometrica 50:1, doi:10.2307/1912526; Ribatet, Cooley & Davison (2012), Stat. Sinica 22:813, "
        "doi:10.5705/ss.2009.248; Yao et al. (2018), Bayesian Analysis 13(3):917, doi:10.1214/17-BA1091; "
        "Yoshimura & Masumoto (2012), Proc. MARSIM"
    ),
    "arviz": "Vehtari et al. (2021), Bayesian Analysis 16(2):667, doi:10.1214/20-BA1221",
}
"""Citations in the attrs of a posterior, by method of drawing; "method" and "arviz" are in every one."""

_SUM, _ZARR = "sha256", "zarr.json"
_SCALING = ("column_center", "column_scale", "response_center", "response_scale")
_PACKAGES = ("pymc-ship", "numpy", "scipy", "xarray", "arviz", "pymc")

SAMPLE = ("chain", "draw")  # dims of every draw, as of ArviZ
_R_HAT_MIXED = 1.1  # R-hat above which chains differ in any number of draws: Gelman & Rubin (1992)
_CHANCE = 10.0  # variance between over within chains, times the draws, that independent draws do not reach

FILES = (".nc", ".zarr")  # endings of the files of a posterior


def rng_state(rng: np.random.Generator) -> str:
    """State of a generator as JSON, from which its next draws can be repeated."""
    return json.dumps(rng.bit_generator.state, default=lambda value: np.asarray(value).tolist())


def draws_tree(
    data: RegressionData,
    prior: Prior,
    coefficients: np.ndarray,
    noise_variance: np.ndarray,
    *,
    method: str,
    rng_state: str,
    groups: dict[str, xr.Dataset] | None = None,
) -> xr.DataTree:
    """Posterior draws on the original scale as a DataTree.

    ``coefficients`` have shape (n_chains, n_draws, n_terms), ``noise_variance`` (n_chains, n_draws); ``rng_state`` is
    :func:`rng_state` before the first draw, ``groups`` are further groups such as ``sample_stats``. The tree has
    posterior (``coefficients`` with dims chain, draw, coefficient; ``noise_variance``), log_likelihood (``response``),
    log_prior (joint over the coefficients), observed_data and constant_data (``design_matrix``, ``time``); prior,
    vessel, versions, generator state and citations are attrs.
    """
    n_chains, n_draws = noise_variance.shape
    coords, sample = {"chain": np.arange(n_chains), "draw": np.arange(n_draws)}, ("chain", "draw")
    work = prior.citation if method == prior.family else ""
    scaled_variance = noise_variance / data.response_scale**2
    log_prior = prior.log_coefficients(data.to_scaled(coefficients), scaled_variance)
    log_prior = log_prior - np.linalg.slogdet(data.transformation[1])[1]
    log_variance_prior = prior.log_noise_variance(scaled_variance) - 2.0 * math.log(data.response_scale)
    log_likelihood = normal_log_density(fitted_residuals(data, coefficients), noise_variance)
    tree = {
        "/": xr.Dataset(attrs=tree_attrs(data, prior.hyperparameters(), method, rng_state, work)),
        "posterior": xr.Dataset(
            {"coefficients": ((*sample, "coefficient"), coefficients), "noise_variance": (sample, noise_variance)},
            coords | {"coefficient": list(data.coefficients)},
        ),
        "log_likelihood": xr.Dataset(
            {"response": ((*sample, "row"), log_likelihood)}, coords | {"row": np.arange(data.n_rows)}
        ),
        "log_prior": xr.Dataset(
            {"coefficients": (sample, log_prior), "noise_variance": (sample, log_variance_prior)}, coords
        ),
    }
    return xr.DataTree.from_dict(tree | data_groups(data) | (groups or {}))


def exact_posterior(
    data: RegressionData, prior: Prior, *, draws: int = 4000, chains: int = 4, rng: Seed
) -> xr.DataTree:
    """Independent draws from the exact posterior as a DataTree.

    Parameters
    ----------
    data : RegressionData
    prior : Prior
    draws, chains : int, optional
        Total number of draws, and number of chains that they are laid out in.
    rng : int, SeedSequence or Generator

    Returns
    -------
    DataTree
        As :func:`draws_tree`.

    Raises
    ------
    InferenceError, ValueError
        For no prior, or vectors of the wrong length; for ``draws`` that are no positive multiple of ``chains``.
    """
    check_counts(draws=draws, chains=chains)
    if draws % chains:
        raise ShipError(f"The draws are dealt evenly to the chains, found {draws} for {chains}; give a multiple.")
    rng = random_generator(rng)
    check_prior(prior, data)
    exact, state = prior.exact(data), rng_state(rng)
    coefficients, noise_variance = exact.draw(draws, rng)
    coefficients, noise_variance = coefficients.reshape(chains, draws // chains, -1), noise_variance.reshape(chains, -1)
    return draws_tree(data, prior, coefficients, noise_variance, method=prior.family, rng_state=state)


def posterior_group(tree: xr.DataTree) -> xr.Dataset:
    """Group posterior of a tree; InferenceError for anything else than a DataTree that has it, such as the group."""
    check_kind("A posterior", tree, xr.DataTree, "give the whole tree", InferenceError)
    if "posterior" not in tree.children:
        raise InferenceError("A posterior must have the group posterior, found none; give the whole tree.")
    return tree["posterior"].to_dataset()


def drawn_coefficients(tree: xr.DataTree, what: str = "A posterior", *, group: str = "posterior") -> xr.Dataset:
    """Group of draws of coefficients, with the dims chain and draw first.

    InferenceError for other dims, values that are not finite, or a noise variance that is not positive.
    """
    drawn = posterior_group(tree) if group == "posterior" else tree[group].to_dataset()
    drawn = drawn.transpose(*SAMPLE, ..., missing_dims="ignore")
    if "coefficients" not in drawn or drawn["coefficients"].dims != (*SAMPLE, "coefficient"):
        raise InferenceError(
            f"{what} needs coefficients with dims chain, draw, coefficient, found {', '.join(map(str, drawn))} with "
            f"dims {', '.join(map(str, drawn.sizes))}; give the whole tree of a posterior."
        )
    values = drawn["coefficients"].to_numpy().astype(float)
    variance = drawn["noise_variance"].to_numpy() if "noise_variance" in drawn else np.ones(1)
    faults = {"no draw": values.size == 0, "NaN or infinity": not np.isfinite(values).all()}
    faults["a noise variance that is not positive"] = not (variance > 0.0).all()
    if found := " and ".join(fault for fault, present in faults.items() if present):
        raise InferenceError(f"{what} needs finite draws and positive variances, found {found}; draw it again.")
    return drawn


def warn_of_chains(what: str, drawn: xr.Dataset) -> None:
    """Warn if chains of :func:`drawn_coefficients` are of different distributions."""
    values, names = drawn["coefficients"].to_numpy(), drawn["coefficient"].to_numpy()
    within, between = values.var(axis=1).mean(axis=0), values.mean(axis=1).var(axis=0)
    ratio = np.divide(between, within, out=np.zeros(len(names)), where=within > 0.0)
    if ratio.max() > _R_HAT_MIXED**2 - 1.0 + _CHANCE / values.shape[1]:
        warnings.warn(
            f"{what} needs chains of one distribution, found an R-hat of {np.sqrt(1.0 + ratio.max()):.3g} of "
            f"{names[ratio.argmax()]}; draw longer chains of one fit, and do not join those of several.",
            UserWarning,
            stacklevel=3,
        )


def normal_log_density(residual: np.ndarray, noise_variance: np.ndarray) -> np.ndarray:
    """Log density (..., n_rows) of normal errors of variance (...), written over the residuals."""
    np.square(residual, out=residual)
    residual /= noise_variance[..., None]
    residual += np.log(2.0 * math.pi * noise_variance)[..., None]
    residual *= -0.5
    return residual


def fitted_residuals(data: RegressionData, coefficients: np.ndarray) -> np.ndarray:
    """Response less that of coefficients (..., n_terms), (..., n_rows), in one array of its own."""
    fitted = coefficients @ data.design_matrix.T
    return np.subtract(data.response, fitted, out=fitted)


def tree_attrs(data: RegressionData, prior: dict, method: str, state: str, work: str = "") -> dict[str, str]:
    """Attrs of a posterior: data, hyperparameters of the prior, generator, versions and citations."""
    return {
        "method": method,
        **{name: getattr(data, name) for name in LABELS},
        "prior": json.dumps(prior),
        "scaling": json.dumps({name: np.asarray(getattr(data, name)).tolist() for name in _SCALING}),
        **({"held_fixed": json.dumps(dict(data.fixed))} if data.fixed else {}),
        "rng_state": state,
        **provenance(work or CITATIONS.get(method, "")),
    }


def data_groups(data: RegressionData) -> dict[str, xr.Dataset]:
    """Groups observed_data and constant_data of a posterior."""
    row = {"row": np.arange(data.n_rows)}
    design = (("row", "coefficient"), data.design_matrix)
    constant = {"design_matrix": design, "time": ("row", data.time, {"units": "s"})}
    if len(set(data.run)) > 1:
        constant["run"] = ("row", data.run)
    return {
        "observed_data": xr.Dataset({"response": ("row", data.response)}, row),
        "constant_data": xr.Dataset(constant, row | {"coefficient": list(data.coefficients)}),
    }


def provenance(work: str) -> dict[str, str]:
    """Attrs with the package versions and the citations of a posterior; ``work`` is that of its method."""
    versions = {package: version(package) for package in _PACKAGES}
    works = [CITATIONS["method"], *([work] if work else []), CITATIONS["arviz"]]
    return {"versions": json.dumps(versions), "citations": json.dumps(works)}


def write_posterior(tree: xr.DataTree, path: str | Path) -> Path:
    """Write a posterior to NetCDF (``.nc``) or Zarr (``.zarr``), with a checksum.

    Raises
    ------
    ValueError, OutputError
        For another ending of the path, or contents that such files do not have, such as a stacked dim; for a folder
        that cannot be written.
    """
    path = as_path("path", path)
    if path.suffix not in FILES:
        raise ShipError(f"A posterior is written to a path ending in .nc or .zarr, found {path.name!r}; rename it.")
    check_kind("A posterior", tree, xr.DataTree, "give the whole tree")
    _check_contents(tree)
    with staged_path(path) as partial:
        try:
            if path.suffix == ".nc":
                tree.to_netcdf(partial, engine="netcdf4")
            else:
                tree.to_zarr(partial, consolidated=False)
        except (NotImplementedError, TypeError, ValueError, OverflowError, AttributeError) as error:
            raise ShipError(f"A posterior has contents that files keep, found: {error}; convert them.") from None
        except RuntimeError as error:  # of a disk that is full, among others
            raise OSError(None, f"{error}, the disk may be full") from None
        if path.suffix == ".nc":
            append_checksum(partial)
        else:
            index = json.loads((partial / _ZARR).read_text(encoding="utf-8"))
            index["attributes"][_SUM] = _zarr_checksum(partial, index)
            (partial / _ZARR).write_text(json.dumps(index), encoding="utf-8")
    return path


def _check_contents(tree: xr.DataTree) -> None:
    for node in tree.subtree:
        group = node.to_dataset()
        for name, index in group.indexes.items():
            if index.nlevels > 1:
                raise ShipError(
                    f"A posterior is written without stacked dims, found {name} in {node.path}; unstack it before."
                )
        for of, attrs in {node.path: group.attrs, **{name: one.attrs for name, one in group.variables.items()}}.items():
            for key, value in attrs.items():
                if not isinstance(key, str) or not _is_writable(value):
                    raise ShipError(
                        f"Attrs of a posterior are texts, numbers or lists of them, found {short_repr(value)} in "
                        f"{key!r} of {of}; convert it, such as by json.dumps, or leave it out."
                    )
        for name, variable in group.variables.items():
            items = variable.to_numpy().ravel().tolist() if variable.dtype.kind == "O" else []
            missing = any(item is None or (isinstance(item, float) and item != item) for item in items)
            if missing or variable.dtype.kind not in "biufUSMmO":
                found = "None or NaN among texts" if missing else f"the type {variable.dtype}"
                raise ShipError(
                    f"A posterior has real numbers and texts, found {found} in {name} of {node.path}; convert it."
                )


def _is_writable(value: Any) -> bool:
    if isinstance(value, list | tuple):
        kinds = {isinstance(item, str) for item in value}
        return len(kinds) == 1 and all(map(_is_writable, value))
    if isinstance(value, str | np.ndarray | np.generic):
        return np.asarray(value).dtype.kind in "iufU"
    return isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63)


def read_posterior(path: str | Path) -> xr.DataTree:
    """Read a posterior from NetCDF or Zarr.

    ValueError if there is none.
    """
    path = as_path("path", path)
    finish_killed_runs(path.parent)
    if not path.exists():
        raise ShipError(f"A posterior is read from a .nc or .zarr path, found nothing at {path}; check the path.")
    zarr = path.suffix == ".zarr"
    try:
        if not (_zarr_is_whole(path) if zarr else has_valid_checksum(path)):
            raise ShipError("its checksum does not fit; copy or make it again")
        options: dict[str, Any] = {"engine": "zarr", "consolidated": False} if zarr else {"engine": "netcdf4"}
        with xr.open_datatree(path, **options) as stored:
            tree = stored.load()
    except (OSError, ValueError, RuntimeError, LookupError, TypeError, AttributeError) as error:
        raise ShipError(f"{path} is no posterior written by this package: {error}.") from None
    tree.attrs.pop(_SUM, None)
    if "posterior" not in tree.children:
        raise ShipError(f"{path} is no posterior written by this package: it has no group posterior.")
    return tree


def _zarr_is_whole(path: Path) -> bool:
    try:
        index = json.loads((path / _ZARR).read_text(encoding="utf-8"))
        checksum = index["attributes"].pop(_SUM, None)
        return checksum is None or checksum == _zarr_checksum(path, index)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False


def _zarr_checksum(path: Path, index: dict) -> str:
    files = (file.relative_to(path) for file in path.rglob("[!.]*") if file.is_file())
    return folder_checksum(path, (name for name in files if name != Path(_ZARR)), index)
