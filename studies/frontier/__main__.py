"""Measure every method against the Cramer-Rao bound: ``python -m studies.frontier --out reports/frontier``."""

from __future__ import annotations

import argparse
import sys

from pymc_ship.cli.argument_types import seed
from pymc_ship.cli.files import Outcome, Progress
from pymc_ship.cli.main import run_command
from studies.command_line import study_parser


def parser() -> argparse.ArgumentParser:
    """Words of the command line of the study."""
    words = study_parser("frontier", "measure how close every method comes to the Cramer-Rao bound")
    words.add_argument("--seed", type=seed, default=2020, help="root of every random number (%(default)s)")
    words.add_argument("--seeds", type=int, default=25, help="data sets of each kind and noise level (%(default)s)")
    words.add_argument("--out", default="reports/frontier", help="folder of the report (%(default)s)")
    return words


def frontier(args: argparse.Namespace, progress: Progress) -> Outcome:
    """Measure and report; the text has each number beside its aim."""
    from studies.frontier.page import reported_frontier

    return reported_frontier(args.out, seeds=args.seeds, seed=args.seed, progress=progress)


if __name__ == "__main__":
    sys.exit(run_command(parser(), frontier))
