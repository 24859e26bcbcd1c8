"""Parser of the command line: commands, options, help and examples.

Choices are copies of those of the API, compared by a test, so that ``--help`` imports no library.
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
"""Prior families."""

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
    """Parser with errors of one sentence."""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2 and one sentence."""
        self.exit(2, f"{sentence(f'{message}; see {self.prog} --help')}\n")


type Commands = argparse._SubParsersAction[Parser]


def parser() -> argparse.ArgumentParser:
    """Parser of the whole command line."""
    words = Parser(
        prog="pymc-ship",
        description="Bayesian identification of ship manoeuvring models from trials, with forecasts of manoeuvres.",
        epilog="`pymc-ship COMMAND --help` shows the options and examples of a command.",
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
    """Parser of a command with the common options; ``seeded``: the command draws random numbers."""
    formatter = argparse.RawDescriptionHelpFormatter
    command = commands.add_parser(
        name, help=description, description=description, epilog=epilog, formatter_class=formatter
    )
    if seeded:
        command.add_argument(
            "--seed", type=seed, default=2020, help="seed of the random numbers, recorded in the output (%(default)s)"
        )
    command.add_argument("--quiet", action="store_true", help="print results and errors only")
    return command


def _add_study(commands: Commands) -> None:
    command = _command(commands, "study", "run the study of the paper and write its report", examples.STUDY)
    command.add_argument("--vessel", default="container", help="shipped vessel or TOML file (%(default)s)")
    command.add_argument(
        "--level", type=float, default=0.01, help="noise level of the detailed figures: sd over peak (%(default)s)"
    )
    command.add_argument("--out", help="folder of the report (reports/<vessel>)")


def _add_simulate(commands: Commands) -> None:
    command = _command(commands, "simulate", "simulate a trial and print its manoeuvring indices", examples.SIMULATE)
    command.add_argument("vessel", metavar="VESSEL", help="shipped vessel or TOML file")
    manoeuvre = command.add_mutually_exclusive_group(required=True)
    _add_manoeuvres(manoeuvre, "{0.title} [deg], such as {0.example}")
    manoeuvre.add_argument("--programme", metavar="FILE", help="rudder programme: CSV with the header time,delta_deg")
    command.add_argument("--side", choices=SIDES, help="first side of a zigzag, or side of a turning circle (port)")
    command.add_argument("--speed", type=float, help="approach speed [m/s] (the vessel's nominal speed)")
    command.add_argument("--duration", type=float, default=400.0, help="duration [s] (%(default)s)")
    command.add_argument("--step", type=float, default=0.02, help="step [s] (%(default)s)")
    command.add_argument(
        "--method",
        choices=INTEGRATORS,
        default="euler",
        help="integrator; dop853 controls its error (%(default)s)",
    )
    command.add_argument(
        "--noise",
        type=noise,
        help="noise level: sd over peak of sway, 0.3 of it for other channels, or `literal`; or instruments: "
        f"{', '.join(INSTRUMENTS)} (none)",
    )
    command.add_argument("--out", required=True, help="CSV file of the trial")


def _add_manoeuvres(command: argparse._ActionsContainer, text: str, **settings: Any) -> None:
    """Option of each kind of manoeuvre that has one."""
    for kind in KINDS.values():
        if kind.option:
            settings |= {"type": angles(kind), "metavar": kind.metavar, "help": text.format(kind)}
            command.add_argument(f"--{kind.option}", **settings)


def _add_check(commands: Commands) -> None:
    command = _command(commands, "check", "check and correct a trial before a fit", examples.CHECK, seeded=False)
    _add_trial(command)
    command.add_argument("--vessel", help="shipped vessel or TOML file (none)")
    command.add_argument("--out", help="CSV file of the corrected trial (not written)")


def _add_denoise(commands: Commands) -> None:
    command = _command(commands, "denoise", "denoise the motion channels of a trial", examples.DENOISE, seeded=False)
    _add_trial(command)
    command.add_argument(
        "--method",
        choices=DENOISE_METHODS,
        default="wavelet",
        help="smoother (%(default)s)",
    )
    command.add_argument("--wavelet", default="sym8", help="orthogonal wavelet of PyWavelets (%(default)s)")
    command.add_argument(
        "--prior", choices=DENOISE_PRIORS, default="laplace", help="prior of the detail coefficients (%(default)s)"
    )
    command.add_argument("--decimated", action="store_true", help="decimated transform, without average over shifts")
    command.add_argument("--out", required=True, help="CSV file of the denoised trial")


def _add_trial(command: argparse.ArgumentParser, name: str = "trial", **settings: Any) -> None:
    """Trial files and their format file."""
    command.add_argument(
        name,
        metavar="TRIAL",
        help="text file or .gz with time [s], u v [m/s], r p [rad/s], phi psi delta [rad]",
        **settings,
    )
    command.add_argument(
        "--format", metavar="FILE.toml", help="format file of TRIAL: columns, units, signs, frame, scale"
    )


def _add_overrule(command: argparse._ActionsContainer) -> None:
    """Option of the commands that fit or score trials."""
    command.add_argument(
        "--overrule",
        action="append",
        default=[],
        metavar="CHECK",
        help="use a TRIAL with this bad check, such as `rudder sign`; repeatable (none)",
    )


def _add_regression(command: argparse.ArgumentParser) -> None:
    """Options of regression data."""
    _add_trial(command)
    _add_overrule(command)
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file: particulars and terms")
    command.add_argument("--raw", action="store_true", help="do not denoise the trial")
    command.add_argument(
        "--interval",
        type=interval,
        default="auto",
        help="interval of the rows [s], `all` or `auto` (%(default)s): about 1 s, in the weak form 0.22 L/U",
    )
    command.add_argument(
        "--derivative",
        choices=DERIVATIVES,
        default="euler",
        help="derivative for the accelerations, or the weak form without derivative and denoising (%(default)s)",
    )


def _add_regress(commands: Commands) -> None:
    command = _command(commands, "regress", "estimate coefficients by regression of accelerations", examples.REGRESS)
    _add_regression(command)
    command.add_argument("--family", choices=(*FAMILIES, "both"), default="both", help="prior family (%(default)s)")
    command.add_argument(
        "--select", choices=SELECTIONS, default="evidence", help="selection of the hyperparameters (%(default)s)"
    )
    command.add_argument("--draws", type=draws, default=4000, help="posterior draws, a multiple of 4 (%(default)s)")
    command.add_argument("--out", required=True, help="folder of <dof>-<family>.nc and coefficients.csv")


def _add_identify(commands: Commands) -> None:
    command = _command(commands, "identify", "identify a ship from its trials and write a report", examples.IDENTIFY)
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument(
        "--facility",
        action="append",
        nargs="+",
        default=[],
        metavar=("FILE.toml", "TRIAL"),
        help="runs of another basin: its format file, then the trials; repeatable",
    )
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file: particulars, propeller if known")
    command.add_argument(
        "--terms",
        action="append",
        metavar="SET",
        help="term set, or `own terms` of the vessel file; repeatable (all that suit the vessel)",
    )
    command.add_argument(
        "--prior",
        metavar="KIND",
        help=f"prior: {', '.join(SHIP_PRIORS)}; or the folder of an earlier report, whose likelihood is added "
        "(hull_database with a draught d in the vessel file, otherwise order_damped)",
    )
    command.add_argument(
        "--captive",
        metavar="FILE",
        help="captive tests: speed, beta, r, delta, n and prime forces X', Y', N' (none)",
    )
    command.add_argument(
        "--captive-format", metavar="FILE.toml", help="format file of --captive: signs, reference point, area, scale"
    )
    command.add_argument("--draws", type=draws, default=1000, help="posterior draws, a multiple of 4 (%(default)s)")
    command.add_argument("--out", required=True, help="folder of the report, which `forecast` takes")


def _add_fit(commands: Commands) -> None:
    command = _command(commands, "fit", "estimate coefficients by a fit of simulated trajectories", examples.FIT)
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file: particulars and terms")
    command.add_argument(
        "--prior",
        choices=TRAJECTORY_PRIORS,
        default="order_damped",
        help="prior of the coefficients (%(default)s)",
    )
    command.add_argument(
        "--channels",
        type=names,
        metavar="NAME,...",
        help=f"channels to fit (the recorded ones of {', '.join(default_channels())})",
    )
    command.add_argument(
        "--noise-model",
        choices=NOISE_MODELS,
        default="auto",
        help="noise model; auto tests the residuals (%(default)s)",
    )
    command.add_argument(
        "--offsets", choices=("auto", "yes", "no"), default="auto", help="constant sensor offsets (%(default)s)"
    )
    command.add_argument("--method", choices=METHODS, default="rk4", help="integrator (%(default)s)")
    command.add_argument("--draws", type=draws, default=1000, help="posterior draws, a multiple of 4 (%(default)s)")
    command.add_argument("--out", required=True, help="folder of trajectory.nc and coefficients.csv")


def _add_tune(commands: Commands) -> None:
    command = _command(commands, "tune", "choose hyperparameters of a prior by Bayesian optimisation", examples.TUNE)
    _add_regression(command)
    command.add_argument("--dof", choices=DOFS, required=True, help="degree of freedom")
    command.add_argument("--family", choices=FAMILIES, required=True, help="prior family")
    command.add_argument("--evaluations", type=int, default=40, help="number of evaluated priors (%(default)s)")
    command.add_argument("--folds", type=int, default=5, help="folds of the cross-validation (%(default)s)")
    command.add_argument("--split", choices=SPLITS, default="blocks", help="assignment of rows to folds (%(default)s)")
    command.add_argument("--out", help="JSON file of the chosen prior (not written)")


def _add_source(command: argparse.ArgumentParser) -> None:
    """Options of the ship: an identified one, or that of a posterior."""
    command.add_argument(
        "posterior",
        metavar="POSTERIOR",
        help="folder that `identify` or `regress` wrote, or a joint posterior, .nc or .zarr",
    )
    command.add_argument(
        "--vessel",
        help="shipped vessel or TOML file, needed for a posterior (the identified vessel)",
    )
    command.add_argument(
        "--family", choices=FAMILIES, default="conjugate", help="prior family, for a folder of `regress` (%(default)s)"
    )


def _add_forecast(commands: Commands) -> None:
    command = _command(commands, "forecast", "forecast manoeuvres of a ship with probability bands", examples.FORECAST)
    _add_source(command)
    _add_manoeuvres(command, "{0.words} [deg]; repeatable", action="append", default=[])
    command.add_argument(
        "--measured",
        action="append",
        default=[],
        metavar="TRIAL",
        help="trial to compare with the forecast of its manoeuvre; repeatable",
    )
    command.add_argument(
        "--format", metavar="FILE.toml", help="format file of TRIAL: columns, units, signs, frame, scale"
    )
    _add_overrule(command)
    command.add_argument("--spiral", action="store_true", help="forecast steady turns and course stability")
    command.add_argument(
        "--stop",
        type=float,
        metavar="RPS",
        help="forecast a stopping test with these astern revolutions [1/s] (none)",
    )
    command.add_argument("--draws", type=int, help="largest number of simulated draws (1000, for a posterior 300)")
    command.add_argument("--duration", type=float, help="duration [s] (40 L/U, for a posterior 400)")
    command.add_argument("--n", type=float, help="propeller revolutions [1/s] (those of the approach)")
    command.add_argument("--wind", type=flow, metavar="SPEED/FROM", help="true wind [m/s, deg, from] (none)")
    command.add_argument("--current", type=flow, metavar="SPEED/TO", help="current [m/s, deg, to] (none)")
    command.add_argument(
        "--facility",
        metavar="NAME",
        help="facility of the steering gear and approach speed (that of most runs)",
    )
    command.add_argument("--side", choices=SIDES, help="first side (both, for a posterior port)")
    command.add_argument("--out", help="folder of the page (folder of the posterior)")


def _add_score(commands: Commands) -> None:
    command = _command(commands, "score", "score open-loop simulations of windows of recorded trials", examples.SCORE)
    command.add_argument("ship", metavar="SHIP", help="folder that `identify` wrote, shipped vessel or TOML file")
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument("--length", type=float, help="length of a window [s] (5 L/U)")
    command.add_argument("--every", type=float, help="interval between the starts of windows [s] (their length)")
    command.add_argument("--draws", type=int, default=100, help="largest number of simulated draws (%(default)s)")
    command.add_argument("--out", help="folder of the page (none)")


def _add_trial_report(commands: Commands) -> None:
    description = "report on a sea trial in the form of IMO MSC/Circ.1053"
    command = _command(commands, "trial-report", description, examples.TRIAL_REPORT)
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add_argument("--vessel", required=True, help="shipped vessel or TOML file, in the condition of the trial")
    command.add_argument("--conditions", metavar="FILE.toml", help="conditions of the trial: depth, draughts, wind")
    command.add_argument(
        "--ship", metavar="REPORT", help="folder that `identify` wrote, for corrections of wind and loading (none)"
    )
    command.add_argument(
        "--full-load",
        metavar="VESSEL",
        help="TOML file of the ship at full load (none)",
    )
    command.add_argument("--out", required=True, help="folder of the page")


def _add_design(commands: Commands) -> None:
    command = _command(
        commands, "design", "choose the next trial runs that narrow the forecast intervals most", examples.DESIGN
    )
    _add_source(command)
    command.add_argument("--n", type=int, default=2, help="number of runs to choose (%(default)s)")
    command.add_argument("--sea-room", type=float, metavar="M", help="largest extent of the track of a run [m] (any)")
    command.add_argument(
        "--wind", type=flow, metavar="SPEED/FROM", help="true wind [m/s, deg from the approach course] (none)"
    )
    command.add_argument("--out", required=True, help="folder of the tables")


def _add_montecarlo(commands: Commands) -> None:
    description = "run or continue a Monte-Carlo study, such as a grid of experiments"
    command = _command(commands, "montecarlo", description, examples.MONTECARLO, seeded=False)
    command.add_argument("study", metavar="STUDY.toml", help="study file: a grid or a population")
    command.add_argument("--workers", type=int, help="number of processes (one for each core)")
    command.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers to use")
    command.add_argument("--out", required=True, help="folder of the results and the page")


def _add_report(commands: Commands) -> None:
    command = _command(commands, "report", "write a diagnostic report of saved posteriors", examples.REPORT)
    command.add_argument("posteriors", metavar="POSTERIOR", nargs="+", help="posterior file, .nc or .zarr")
    command.add_argument("--vessel", help="shipped vessel or TOML file: reference and published values (none)")
    command.add_argument("--out", default="reports/diagnostics", help="folder of diagnostics.html (%(default)s)")
