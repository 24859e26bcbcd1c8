"""Peers written in R: run where R and the package are installed, a note in the table where they are not."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.table import MissingPeer

EBAYES_THRESH = """
library(EbayesThresh)
work <- function() as.matrix(ebayesthresh(rows[, 1], prior = "laplace", a = 0.5, sdev = 1, threshrule = "median"))
"""

MCMC_REGRESS = """
suppressMessages(library(MCMCpack))
y <- rows[, 1]
X <- rows[, -1]
work <- function() as.matrix(MCMCregress(y ~ X - 1, burnin = 500, mcmc = 4000, b0 = 0, B0 = 1 / kappa,
                                         c0 = 2 * shape, d0 = 2 * scale))
"""

_FRAME = """
rows <- as.matrix(read.csv("rows.csv", header = FALSE))
{settings}
{script}
result <- work()
seconds <- median(replicate(3, system.time(work())[["elapsed"]]))
write.table(result, "result.csv", sep = ",", row.names = FALSE, col.names = FALSE)
cat(seconds)
"""


def seconds(
    script: str, rows: np.ndarray, settings: Mapping[str, float], what: str, peer: str
) -> tuple[float, np.ndarray]:
    """Median time of a function ``work`` of R over rows, its import left out, and its result, a matrix."""
    if shutil.which("Rscript") is None:
        raise MissingPeer(what, peer, "not run: R is not installed")
    with tempfile.TemporaryDirectory() as folder:
        np.savetxt(Path(folder, "rows.csv"), rows, delimiter=",", fmt="%.17g")
        assigned = "\n".join(f"{name} <- {value!r}" for name, value in settings.items())
        Path(folder, "run.R").write_text(_FRAME.format(settings=assigned, script=script), encoding="utf-8")
        ran = subprocess.run(["Rscript", "run.R"], cwd=folder, capture_output=True, text=True, check=False)
        if ran.returncode:
            said = ran.stderr.strip().splitlines() or ["no message"]
            raise MissingPeer(what, peer, f"not run: R said {said[0]}")
        return float(ran.stdout.split()[-1]), np.loadtxt(Path(folder, "result.csv"), delimiter=",", ndmin=2)
