"""The words of the command line: every command with its options, help and worked examples.

Nothing heavy is imported here: choices are copies of the API's, which tests hold beside them.
"""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from pymc_ship import __version__
from pymc_ship.cli import examples
from pymc_ship.cli.sentences import sentence
from pymc_ship.cli.words import INSTRUMENTS, angles, draws, flow, interval, names, noise, seed
from pymc_ship.physics.manoeuvre.registry import KINDS
from pymc_ship.trial.channels import default_channels

FAMILIES = ("conjugate", "semiconjugate")
"""Prior families; like the choices below a copy of the API's, so that ``--help`` need not import it."""

SELECTIONS = ("evidence", "bayesian_optimisation")
SIDES = ("port", "starboard")
METHODS = ("euler", "rk4")
INTEGRATORS = (*METHODS, "dop853")
DERIVATIVES = ("euler", "central", "savgol", "weak", "weak_euler")
DENOISE_METHODS = ("wavelet", "savitzky_golay", "low_pass", "rts")
DENOISE_PRIORS = ("laplace", "cauchy")
SPLITS = ("blocks", "random")
DOFS = ("surge", "sway", "yaw", "roll")
TRAJECTORY_PRIORS = ("order_damped", "sister_ship", "flat")
SHIP_PRIORS = ("hull_database", "order_damped", "sister_ship")
NOISE_MODELS = ("auto", "white", "ar1", "student_t")


class Parser(argparse.ArgumentParser):
    """Parser whose complaints are one sentence, like every other error of the program."""

    def error(self, message: str) -> NoReturn:
        """End the program with status 2 and one sentence."""
        self.exit(2, f"{sentence(f'{message}; see {self.prog} --help')}\n")


type Commands = argparse._SubParsersAction[Parser]


def parser() -> argparse.ArgumentParser:
    """Parser of the whole command line."""
    words = Parser(
        prog="pymc-ship",
        description="Bayesian identification of ship manoeuvring models: from a trial to coefficients and forecasts.",
        epilog="`pymc-ship COMMAND --help` explains a command and shows worked examples.",
    )
    words.add_argument("--version", action="version", version=f"pymc-ship {__version__}")
    commands = words.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for add in (
        _add_study,
        _add_simulate,
        _add_check,
        _add_denoise,
        _add_identify,
        _add_regress,
        _add_fit,
        _add_tune,
        _add_forecast,
        _add_score,
        _add_trial_report,
        _add_design,
        _add_montecarlo,
        _add_report,
    ):
        add(commands)
    return words


def _command(
    commands: Commands,
    name: str,
    description: str,
    epilog: str,
    *,
    seeded: bool = True,
) -> argparse.ArgumentParser:
    """Parser of a command with the options that all have; one that draws nothing takes no seed."""
    formatter = argparse.RawDescriptionHelpFormatter
    command = commands.add_parser(
        name, help=description, description=description, epilog=epilog, formatter_class=formatter
    )
    if seeded:
        command.add_argument(
            "--seed", type=seed, default=2020, help="root of every random number, recorded in the output (%(default)s)"
        )
    command.add_argument("--quiet", action="store_true", help="no progress and no remarks; results and errors only")
    return command


def _add_study(commands: Commands) -> None:
    command = _command(commands, "study", "run the paper's study and write its report", examples.STUDY)
    command.add_argument("--vessel", default="container", help="shipped vessel or TOML file (%(default)s)")
    command.add_argument(
        "--level", type=float, default=0.01, help="noise level shown in detail: sd over peak (%(default)s)"
    )
    command.add_argument("--out", help="folder of the report (reports/<vessel>)")


def _add_simulate(commands: Commands) -> None:
    command = _command(commands, "simulate", "simulate a trial and print its indices", examples.SIMULATE)
    command.add_argument("vessel", metavar="VESSEL", help="shipped vessel or TOML file")
    manoeuvre = command.add_mutually_exclusive_group(required=True)
    _add_manoeuvres(manoeuvre, "{0.title} [deg], such as {0.example}")
    manoeuvre.add_argument("--programme", metavar="FILE", help="rudder programme: CSV with the header time,delta_deg")
    command.add_argument("--side", choices=SIDES, help="side turned to first by a zigzag or a circle (port)")
    command.add_argument("--speed", type=float, help="approach speed [m/s] (the vessel's nominal speed)")
    command.add_argument("--duration", type=float, default=400.0, help="[s] (%(default)s)")
    command.add_argument("--step", type=float, default=0.02, help="integration and sampling step [s] (%(default)s)")
    command.add_argument(
        "--method",
        choices=INTEGRATORS,
        default="euler",
        help="integrator; dop853 has steps of controlled error and samples at --step (%(default)s)",
    )
    command.add_argument(
        "--noise",
        type=noise,
        help="noise level: sd over peak of sway, 0.3 of it elsewhere, or `literal`; or instruments between commas: "
        f"{', '.join(INSTRUMENTS)} (none)",
    )
    command.add_argument("--out", required=True, help="CSV file of the trial")


def _add_manoeuvres(command: argparse._ActionsContainer, text: str, **settings: Any) -> None:
    """Option of each kind of manoeuvre that has one."""
    for kind in KINDS.values():
        if kind.option:
            told = text.format(kind)
            command.add_argument(f"--{kind.option}", type=angles(kind), metavar=kind.metavar, help=told, **settings)


def _add_check(commands: Commands) -> None:
    command = _command(
        commands, "check", "check a trial before it is fitted, and correct it", examples.CHECK, seeded=False
    )
    _add_trial(command)
    command.add_argument("--vessel", help="shipped vessel or TOML file (L/U is guessed from the tightest turn)")
    command.add_argument("--out", help="CSV file of the corrected trial (not written)")


def _add_denoise(commands: Commands) -> None:
    command = _command(commands, "denoise", "denoise the motion channels of a trial", examples.DENOISE, seeded=False)
    _add_trial(command)
    command.add_argument(
        "--method",
        choices=DENOISE_METHODS,
        default="wavelet",
        help="empirical-Bayes wavelets, or a smoother that chooses its own parameter (%(default)s)",
    )
    command.add_argument("--wavelet", default="sym8", help="orthogonal wavelet of PyWavelets (%(default)s)")
    command.add_argument("--prior", choices=DENOISE_PRIORS, default="laplace", help="prior of details (%(default)s)")
    command.add_argument("--decimated", action="store_true", help="decimated transform, not averaged over shifts")
    command.add_argument("--out", required=True, help="CSV file of the smooth trial")


def _add_trial(command: argparse.ArgumentParser, name: str = "trial", **settings: Any) -> None:
    """Trial files of a command and how they are read."""
    command.add_argument(
        name, metavar="TRIAL", help="text or .gz: time [s], u v [m/s], r p [rad/s], phi psi delta [rad]", **settings
    )
    command.add_argument("--format", metavar="FILE.toml", help="columns, units, signs, frame and scale of a TRIAL")


def _add_overrule(command: argparse._ActionsContainer) -> None:
    """Option of every command that fits or judges a model by trials."""
    command.add_argument(
        "--overrule",
        action="append",
        default=[],
        metavar="CHECK",
        help="use a TRIAL although this check is bad, such as `rudder sign`; the result names it; repeatable (none)",
    )


def _add_regression(command: argparse.ArgumentParser) -> None:
    """Options that make regression data of a trial."""
    _add_trial(command)
    _add_overrule(command)
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file: particulars and terms")
    command.add_argument("--raw", action="store_true", help="the trial is smooth already, do not denoise it")
    command.add_argument(
        "--interval",
        type=interval,
        default=1.0,
        help="interval of the rows [s] or `all` samples (%(default)s); 4 suits the weak form, whose windows overlap",
    )
    command.add_argument(
        "--derivative",
        choices=DERIVATIVES,
        default="euler",
        help="how accelerations are formed, or the weak form, which does without and is not denoised (%(default)s)",
    )


def _add_regress(commands: Commands) -> None:
    command = _command(commands, "regress", "regress the accelerations of a trial, as the paper", examples.REGRESS)
    _add_regression(command)
    command.add_argument("--family", choices=(*FAMILIES, "both"), default="both", help="prior family (%(default)s)")
    command.add_argument(
        "--select", choices=SELECTIONS, default="evidence", help="how hyperparameters are chosen (%(default)s)"
    )
    command.add_argument("--draws", type=draws, default=4000, help="posterior draws, a multiple of 4 (%(default)s)")
    command.add_argument("--out", required=True, help="folder of <dof>-<family>.nc and coefficients.csv")


def _add_identify(commands: Commands) -> None:
    command = _command(commands, "identify", "identify a ship from her trials and report on it", examples.IDENTIFY)
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument(
        "--facility",
        action="append",
        nargs="+",
        default=[],
        metavar=("FILE.toml", "TRIAL"),
        help="runs of another basin, its format file, which names it, first; repeatable",
    )
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file: particulars, perhaps propeller")
    command.add_argument(
        "--terms",
        action="append",
        metavar="SET",
        help="term set, or `own terms` of the file; repeatable (all there are)",
    )
    command.add_argument(
        "--prior",
        metavar="KIND",
        help=f"of the coefficients: {', '.join(SHIP_PRIORS)}, which are captive tests of other hulls, wide about 0, or "
        "the values of the vessel file (the first where the file states the draught d, else the second); or the folder "
        "of an earlier report, whose runs count on",
    )
    command.add_argument(
        "--captive",
        metavar="FILE",
        help="captive tests of her model: speed, beta, r, delta, n and prime forces X', Y', N', one row a test (none)",
    )
    command.add_argument("--captive-format", metavar="FILE.toml", help="signs, reference point, area and scale of them")
    command.add_argument("--draws", type=draws, default=1000, help="posterior draws, a multiple of 4 (%(default)s)")
    command.add_argument("--out", required=True, help="folder of the report, which `forecast` takes")


def _add_fit(commands: Commands) -> None:
    command = _command(commands, "fit", "fit the simulated trajectory to raw trials", examples.FIT)
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file: particulars and terms")
    command.add_argument(
        "--prior",
        choices=TRAJECTORY_PRIORS,
        default="order_damped",
        help="of the coefficients: small for high orders, near the vessel file's values, or none (%(default)s)",
    )
    command.add_argument(
        "--channels",
        type=names,
        metavar="NAME,...",
        help=f"channels to fit (those of {', '.join(default_channels())} there are)",
    )
    command.add_argument(
        "--noise-model", choices=NOISE_MODELS, default="auto", help="auto tests the residuals (%(default)s)"
    )
    command.add_argument(
        "--offsets", choices=("auto", "yes", "no"), default="auto", help="constant sensor offsets (%(default)s)"
    )
    command.add_argument("--method", choices=METHODS, default="rk4", help="integrator (%(default)s)")
    command.add_argument("--draws", type=draws, default=1000, help="posterior draws, a multiple of 4 (%(default)s)")
    command.add_argument("--out", required=True, help="folder of trajectory.nc and coefficients.csv")


def _add_tune(commands: Commands) -> None:
    command = _command(commands, "tune", "choose hyperparameters by Bayesian optimisation", examples.TUNE)
    _add_regression(command)
    command.add_argument("--dof", choices=DOFS, required=True, help="degree of freedom")
    command.add_argument("--family", choices=FAMILIES, required=True, help="prior family")
    command.add_argument("--evaluations", type=int, default=40, help="priors tried (%(default)s)")
    command.add_argument("--folds", type=int, default=5, help="folds of the cross-validation (%(default)s)")
    command.add_argument("--split", choices=SPLITS, default="blocks", help="how rows are dealt to folds (%(default)s)")
    command.add_argument("--out", help="JSON file of the chosen prior (not written)")


def _add_source(command: argparse.ArgumentParser) -> None:
    """Options that name the ship of a command: an identified one, or that of a posterior."""
    command.add_argument(
        "posterior",
        metavar="POSTERIOR",
        help="folder that `identify` or `regress` wrote, or joint posterior, .nc or .zarr",
    )
    command.add_argument(
        "--vessel",
        help="shipped vessel or TOML file: particulars and terms of a posterior, which states none (the ship's own)",
    )
    command.add_argument(
        "--family", choices=FAMILIES, default="conjugate", help="prior family, of a folder of `regress` (%(default)s)"
    )


def _add_forecast(commands: Commands) -> None:
    command = _command(commands, "forecast", "forecast manoeuvres with bands from a posterior", examples.FORECAST)
    _add_source(command)
    _add_manoeuvres(command, "{0.words} [deg]; repeatable", action="append", default=[])
    command.add_argument(
        "--measured", action="append", default=[], metavar="TRIAL", help="trial to forecast and show beside; repeatable"
    )
    command.add_argument("--format", metavar="FILE.toml", help="columns, units, signs, frame and scale of a TRIAL")
    _add_overrule(command)
    command.add_argument("--spiral", action="store_true", help="steady turns and course stability (none)")
    command.add_argument(
        "--stop",
        type=float,
        metavar="RPS",
        help="stopping test with these revolutions astern [1/s], of a ship with forces at any speed (none)",
    )
    command.add_argument("--draws", type=int, help="simulated ships at most (1000, of a posterior 300)")
    command.add_argument("--duration", type=float, help="[s] (40 L/U, of a posterior 400)")
    command.add_argument("--n", type=float, help="revolutions [1/s] (those of the approach)")
    command.add_argument("--wind", type=flow, metavar="SPEED/FROM", help="true wind [m/s, deg] (none)")
    command.add_argument("--current", type=flow, metavar="SPEED/TO", help="water [m/s, deg] (none)")
    command.add_argument(
        "--facility",
        metavar="NAME",
        help="whose steering gear and approach speed (gear of most runs)",
    )
    command.add_argument("--side", choices=SIDES, help="side turned to first (both, of a posterior port)")
    command.add_argument("--out", help="folder of the page (that of the posterior)")


def _add_score(commands: Commands) -> None:
    command = _command(commands, "score", "score a ship on records she is restarted in", examples.SCORE)
    command.add_argument("ship", metavar="SHIP", help="folder that `identify` wrote, shipped vessel or TOML file")
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument("--length", type=float, help="of a window [s] (5 L/U)")
    command.add_argument("--every", type=float, help="from a window's start to the next [s] (its length)")
    command.add_argument("--draws", type=int, default=100, help="simulated ships at most (%(default)s)")
    command.add_argument("--out", help="folder of the page (none)")


def _add_trial_report(commands: Commands) -> None:
    description = "report on a sea trial as IMO MSC/Circ.1053 asks for it"
    command = _command(commands, "trial-report", description, examples.TRIAL_REPORT)
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file, as she was tried")
    command.add_argument("--conditions", metavar="FILE.toml", help="what was noted of the day: depth, draughts, wind")
    command.add_argument(
        "--ship", metavar="REPORT", help="folder that `identify` wrote: corrects wind and loading (not corrected)"
    )
    command.add_argument(
        "--full-load", metavar="VESSEL", help="her TOML file at full load, where she was tried at another draught"
    )
    command.add_argument("--out", required=True, help="folder of the page")


def _add_design(commands: Commands) -> None:
    command = _command(commands, "design", "choose the runs that will tell most about a ship", examples.DESIGN)
    _add_source(command)
    command.add_argument("--n", type=int, default=2, help="runs to choose (%(default)s)")
    command.add_argument("--sea-room", type=float, metavar="M", help="largest extent of a run's track [m] (any)")
    command.add_argument(
        "--wind", type=flow, metavar="SPEED/FROM", help="true wind [m/s, deg from the approach course] (none)"
    )
    command.add_argument("--out", required=True, help="folder of the tables")


def _add_montecarlo(commands: Commands) -> None:
    description = "run a grid of experiments or another study, or go on with one that was stopped"
    command = _command(commands, "montecarlo", description, examples.MONTECARLO, seeded=False)
    command.add_argument("study", metavar="STUDY.toml", help="a grid of experiments, or a study that names its kind")
    command.add_argument("--workers", type=int, help="processes (one for each core)")
    command.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the tasks instead")
    command.add_argument("--out", required=True, help="folder of the results and the page")


def _add_report(commands: Commands) -> None:
    command = _command(commands, "report", "diagnose saved posteriors and write a report", examples.REPORT)
    command.add_argument("posteriors", metavar="POSTERIOR", nargs="+", help="posterior file, .nc or .zarr")
    command.add_argument("--vessel", help="shipped vessel or TOML file: reference and published values (none)")
    command.add_argument("--out", default="reports/diagnostics", help="folder of diagnostics.html (%(default)s)")
