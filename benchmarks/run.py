"""Measure every row, print the table and write it with figures, machine and versions: ``make bench``."""

from __future__ import annotations

import argparse
import csv
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

import pymc_ship as ps
from benchmarks import ROOT, denoising, fitting, growth, processes, regression, simulation
from benchmarks.growth import Curve
from benchmarks.table import HEADER, Row, collected, line, markdown, write_csv
from pymc_ship.machine.files import staged_path, writable_folder

PACKAGES = ("pymc-ship", "numpy", "scipy", "numba", "pymc", "nutpie", "arviz", "xarray", "PyWavelets")
PEERS = ("scikit-learn", "scikit-image", "shipmmg")


def machine() -> str:
    """Cores, processor, memory, threads and load before the run."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines() if Path("/proc/cpuinfo").exists() else []
    model = next((text.split(":")[1].strip() for text in lines if text.startswith("model name")), platform.processor())
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1024**3
    threads = os.environ.get("OPENBLAS_NUM_THREADS", "all")
    return (
        f"{os.cpu_count()} cores, {model or platform.machine()}, {memory:.0f} GiB; BLAS threads: {threads}; load "
        f"before the run {os.getloadavg()[0]:.2f}; {platform.system()} {platform.release()}"
    )


def versions() -> str:
    """Python, this package and its peers."""
    found = [f"Python {platform.python_version()}"]
    for package in (*PACKAGES, *PEERS):
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} not installed")
    return ", ".join(found)


def measurements(study: bool) -> Iterator[Callable[[], Iterator[Row]]]:
    """Every measurement, in the order of the table."""
    vessel = ps.load_vessel("container")
    trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=400)
    noisy = ps.pollute(trial, level=0.01, rng=np.random.default_rng(1))
    data = ps.regression_data(ps.denoise(noisy), vessel, "sway", interval=1.0)
    prior, _ = ps.maximise_evidence(data, "semiconjugate")
    yield partial(simulation.one_run, vessel)
    yield simulation.parts
    yield simulation.shipmmg
    yield partial(simulation.batch, vessel)
    yield partial(simulation.derivatives, vessel, trial)
    yield partial(fitting.trajectory, vessel, noisy)
    yield partial(fitting.forecasts, vessel, noisy)
    yield partial(denoising.denoising, trial, noisy)
    yield denoising.ebayes_thresh
    yield partial(regression.sampling, data, prior)
    yield partial(regression.mcmcpack, data, prior)
    yield partial(regression.bayesian_ridge, data)
    yield partial(regression.nuts, data)
    yield processes.first_run
    yield partial(processes.trajectory_report, vessel, noisy)
    if study:
        yield processes.whole_study


def curves() -> Iterator[Curve]:
    """How the cost grows."""
    vessel = ps.load_vessel("container")
    trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=400)
    data = ps.regression_data(trial, vessel, "sway", interval=1.0)
    yield growth.rows()
    yield growth.terms()
    yield growth.draws(data, ps.SemiConjugatePrior())
    yield growth.runs(vessel)


def page(rows: Sequence[Row], grown: Sequence[Curve], machine: str, versions: str, seconds: float) -> str:
    """The benchmark as a Markdown page."""
    losses = [f"{row.what}: {row.peer}, {1.0 / row.ratio:.3g} times as fast" for row in rows if "wins" in row.verdict]
    differ = [f"{row.what}: {row.peer}" for row in rows if "DIFFER" in row.verdict]
    skipped = [f"{row.what}: {row.peer} ({row.note})" for row in rows if row.skipped]
    slopes = [
        f"- {curve.title} against {curve.xlabel}: "
        + "; ".join(f"{method} {curve.exponent(method):.2f}" for method in curve.seconds)
        for curve in grown
    ]
    listed = {"Where a peer wins": losses, "Rows whose results disagree": differ, "Skipped": skipped}
    parts = [
        "# Beside named peers",
        f"`make bench`, {datetime.now(UTC):%Y-%m-%d}, {seconds:.0f} s.\n\n- {machine}\n- {versions}",
        "Every row was measured in this run. The ratio is how many times as fast as the peer ours is (for rates, how "
        "many times as much work a second); the check is how far the two results are apart, its limit in brackets.",
        markdown(rows),
        *(f"## {title}\n\n" + ("\n".join(f"- {item}" for item in items) or "None.") for title, items in listed.items()),
        "## How the cost grows\n\nExponents of time against size over the last decade of sizes:\n\n"
        + "\n".join(slopes),
        "\n\n".join(f"![{curve.title}](figures/{curve.name}.png)" for curve in grown),
    ]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def write(rows: Sequence[Row], grown: Sequence[Curve], text: str, out: Path) -> None:
    """Write page, tables and figures; each appears under its name when complete."""
    with staged_path(out / "figures") as folder:
        folder.mkdir()
        for curve in grown:
            growth.draw_figure(curve, folder / f"{curve.name}.png")
    with staged_path(out / "benchmarks.csv") as partial_path:
        write_csv(rows, partial_path)
    with staged_path(out / "growth.csv") as partial_path, partial_path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("curve", "method", "size", "seconds"))
        for curve in grown:
            for method, seconds in curve.seconds.items():
                writer.writerows((curve.name, method, n, f"{s:.4g}") for n, s in zip(curve.sizes, seconds, strict=True))
    with staged_path(out / "benchmarks.md") as partial_path:
        partial_path.write_text(text, encoding="utf-8")


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; status 3 when the results of a row disagree."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.run", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "benchmarks", help="folder of page and tables")
    parser.add_argument("--no-study", action="store_true", help="leave out the whole study, which takes minutes")
    arguments = parser.parse_args(words)
    out, begin, state = writable_folder(arguments.out), time.perf_counter(), (machine(), versions())
    print("\n".join([*state, "", line(HEADER)]), flush=True)
    rows = []
    for row in collected(measurements(not arguments.no_study)):
        rows.append(row)
        print(line(row.cells), flush=True)
    grown = []
    for curve in curves():
        grown.append(curve)
        found = ", ".join(f"{method} {curve.exponent(method):.2f}" for method in curve.seconds)
        print(f"exponent of {curve.title} against {curve.xlabel}: {found}", flush=True)
    write(rows, grown, page(rows, grown, *state, time.perf_counter() - begin), out)
    print(f"{out / 'benchmarks.md'}, {time.perf_counter() - begin:.0f} s")
    differ = [row.what for row in rows if row.verdict == "RESULTS DIFFER"]
    if differ:
        print(f"The results of {len(differ)} rows disagree beyond their limit: {'; '.join(differ)}.", file=sys.stderr)
    return 3 if differ else 0


if __name__ == "__main__":
    raise SystemExit(main())
