"""Parser of the command line: commands, options, help and examples.

Choices are copies of those of the API, compared by a test, so that ``--help`` imports no library.
"""

import argparse
import re
from collections.abc import Callable
from typing import Any, NoReturn

from pymc_ship import __version__
from pymc_ship.cli.argument_types import INSTRUMENTS, angles, draws, flow, interval, names, noise, seed
from pymc_ship.cli.examples import EXAMPLES
from pymc_ship.machine.names import did_you_mean
from pymc_ship.physics.manoeuvre.registry import KINDS
from pymc_ship.trial.channels import default_channels

FAMILIES = ("conjugate", "semiconjugate")  # prior families

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


LONGEST = 600  # largest number of characters of an error line

_END = 200  # of them, the last part of a long text


def error_line(text: str) -> str:
    """One printable line with a full stop; a long text loses its middle, since its end has the remedy."""
    line = "".join(character if character.isprintable() else "?" for character in " ".join(text.split()))
    line = f"pymc-ship: {line.removesuffix('.')}."
    return line if len(line) <= LONGEST else f"{line[: LONGEST - _END - 5]} ... {line[-_END:]}"


class Parser(argparse.ArgumentParser):
    """Parser with errors of one sentence, and defaults at the end of the help."""

    def add(self, name: str, text: str, default: Any = None, **settings: Any) -> None:
        """Add an argument with a help text, to which a default is appended."""
        if default not in (None, [], False):
            text = f"{text} (%(default)s)"
        self.add_argument(name, help=text, default=default, **settings)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Arguments, all of which are known; a misspelt option exits with the nearest one."""
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            options = {option: None for action in self._actions for option in action.option_strings}
            self.error(f"unrecognized arguments: {' '.join(unknown)}{did_you_mean(unknown[0].split('=')[0], options)}")
        return known, unknown

    def error(self, message: str) -> NoReturn:
        """Exit with status 2 and one sentence."""
        if choice := re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message):
            message += did_you_mean(choice[1], re.findall(r"[^', ]+", choice[2]))
        self.exit(2, f"{error_line(f'{message}; see {self.prog} --help')}\n")


def parser() -> Parser:
    """Parser of the whole command line."""
    command_line = Parser(
        prog="pymc-ship",
        description="Bayesian identification of ship manoeuvring models from trials, with forecasts of manoeuvres.",
        epilog="`pymc-ship COMMAND --help` shows the options and examples of a command.",
    )
    command_line.add_argument("--version", action="version", version=f"pymc-ship {__version__}")
    commands = command_line.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (description, add_options) in _COMMANDS.items():
        settings: dict[str, Any] = {"help": description, "description": description, "epilog": EXAMPLES[name]}
        command = commands.add_parser(name, formatter_class=argparse.RawDescriptionHelpFormatter, **settings)
        if name not in _WITHOUT_SEED:
            command.add("--seed", "seed of the random numbers, recorded in the output", 2020, type=seed)
        command.add("--quiet", "print results and errors only", False, action="store_true")
        if name not in _REPLACES_OWN_OUTPUT:
            command.add("--force", "replace an input or another result", False, action="store_true")
        add_options(command)
    return command_line


def _study(command: Parser) -> None:
    command.add("--vessel", "shipped vessel or TOML file", "container")
    command.add("--level", "noise level of the detailed figures: sd over peak", 0.01, type=float)
    command.add("--out", "folder of the report (reports/<vessel>)")


def _simulate(command: Parser) -> None:
    command.add("vessel", "shipped vessel or TOML file", metavar="VESSEL")
    manoeuvre = command.add_mutually_exclusive_group(required=True)
    _add_manoeuvres(manoeuvre, "{0.title} [deg], such as {0.example}")
    manoeuvre.add_argument("--programme", metavar="FILE", help="rudder programme: CSV with the header time,delta_deg")
    command.add("--side", "first side of a zigzag, or side of a turning circle (port)", choices=SIDES)
    command.add("--speed", "approach speed [m/s] (the vessel's nominal speed)", type=float)
    command.add("--duration", "duration [s]", 400.0, type=float)
    command.add("--step", "step [s]", 0.02, type=float)
    command.add("--method", "integrator; dop853 controls its error", "euler", choices=INTEGRATORS)
    levels = "noise level: sd over peak of sway, 0.3 of it for other channels, or `literal`"
    command.add("--noise", f"{levels}; or instruments: {', '.join(INSTRUMENTS)} (none)", type=noise)
    command.add("--out", "CSV file of the trial", required=True)


def _add_manoeuvres(command: argparse._ActionsContainer, text: str, **settings: Any) -> None:
    for kind in KINDS.values():
        if kind.option:
            settings |= {"type": angles(kind), "metavar": kind.metavar, "help": text.format(kind)}
            command.add_argument(f"--{kind.option}", **settings)


def _check(command: Parser) -> None:
    _add_trial(command)
    command.add("--vessel", "shipped vessel or TOML file (none)")
    command.add("--out", "CSV file of the corrected trial, or .html page of the check (not written)")
    text = "format file that reproduces this reading, to edit (not written)"
    command.add("--write-format", text, metavar="FILE.toml")


def _denoise(command: Parser) -> None:
    _add_trial(command)
    command.add("--method", "smoother", "wavelet", choices=DENOISE_METHODS)
    command.add("--wavelet", "orthogonal wavelet of PyWavelets", "sym8")
    command.add("--prior", "prior of the detail coefficients", "laplace", choices=DENOISE_PRIORS)
    command.add("--decimated", "decimated transform, without average over shifts", False, action="store_true")
    command.add("--out", "CSV file of the denoised trial", required=True)


def _add_trial(command: Parser, name: str = "trial", **settings: Any) -> None:
    channels = "time [s], u v [m/s], r p [rad/s], phi psi delta [rad]"
    command.add(name, f"text file or .gz with {channels}", metavar="TRIAL", **settings)
    _add_format(command)


def _add_format(command: Parser) -> None:
    command.add("--format", "format file of TRIAL: columns, units, signs, frame, scale", metavar="FILE.toml")
    command.add("--join", "a TRIAL may be a folder, whose files are one run", False, action="store_true")


def _add_overrule(command: Parser) -> None:
    text = "use a TRIAL with this bad check, such as `rudder sign`; repeatable (none)"
    command.add("--overrule", text, [], action="append", metavar="CHECK")


def _add_regression(command: Parser) -> None:
    _add_trial(command)
    _add_overrule(command)
    command.add("--vessel", "shipped vessel or TOML file: particulars and terms", required=True)
    command.add("--raw", "do not denoise the trial", False, action="store_true")
    text = "interval of the rows [s], `all` or `auto` (%(default)s): about 1 s, in the weak form 0.22 L/U"
    command.add_argument("--interval", type=interval, default="auto", help=text)
    text = "derivative for the accelerations, or the weak form without derivative and denoising"
    command.add("--derivative", text, "euler", choices=DERIVATIVES)


def _add_draws(command: Parser, default: int = 1000) -> None:
    command.add("--draws", "posterior draws, a multiple of 4", default, type=draws)


def _regress(command: Parser) -> None:
    _add_regression(command)
    command.add("--family", "prior family", "both", choices=(*FAMILIES, "both"))
    command.add("--select", "selection of the hyperparameters", "evidence", choices=SELECTIONS)
    _add_draws(command, 4000)
    command.add("--out", "folder of <dof>-<family>.nc and coefficients.csv", required=True)


def _identify(command: Parser) -> None:
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    text = "runs of another basin: its format file, then the trials; repeatable"
    command.add("--facility", text, [], action="append", nargs="+", metavar=("FILE.toml", "TRIAL"))
    command.add("--vessel", "shipped vessel or TOML file: particulars, propeller if known", required=True)
    text = "term set, or `own terms` of the vessel file; repeatable (all that suit the vessel)"
    command.add("--terms", text, action="append", metavar="SET")
    text = f"prior: {', '.join(SHIP_PRIORS)}; or the folder of an earlier report, whose likelihood is added "
    text += "(hull_database with a draught d in the vessel file, otherwise order_damped)"
    command.add("--prior", text, metavar="KIND")
    text = "captive tests: speed, beta, r, delta, n and prime forces X', Y', N' (none)"
    command.add("--captive", text, metavar="FILE")
    text = "format file of --captive: signs, reference point, area, scale"
    command.add("--captive-format", text, metavar="FILE.toml")
    _add_draws(command)
    command.add("--out", "folder of the report, which `forecast` takes", required=True)


def _fit(command: Parser) -> None:
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add("--vessel", "shipped vessel or TOML file: particulars and terms", required=True)
    command.add("--prior", "prior of the coefficients", "order_damped", choices=TRAJECTORY_PRIORS)
    text = f"channels to fit (the recorded ones of {', '.join(default_channels())})"
    command.add("--channels", text, type=names, metavar="NAME,...")
    command.add("--noise-model", "noise model; auto tests the residuals", "auto", choices=NOISE_MODELS)
    command.add("--offsets", "constant sensor offsets", "auto", choices=("auto", "yes", "no"))
    command.add("--method", "integrator", "rk4", choices=METHODS)
    _add_draws(command)
    command.add("--out", "folder of trajectory.nc and coefficients.csv", required=True)


def _tune(command: Parser) -> None:
    _add_regression(command)
    command.add("--dof", "degree of freedom", choices=DOFS, required=True)
    command.add("--family", "prior family", choices=FAMILIES, required=True)
    command.add("--evaluations", "number of evaluated priors", 40, type=int)
    command.add("--folds", "folds of the cross-validation", 5, type=int)
    command.add("--split", "assignment of rows to folds", "blocks", choices=SPLITS)
    command.add("--out", "JSON file of the chosen prior (not written)")


def _add_ship(command: Parser) -> None:
    text = "folder that `identify` or `regress` wrote, or a joint posterior, .nc or .zarr"
    command.add("posterior", text, metavar="POSTERIOR")
    command.add("--vessel", "shipped vessel or TOML file, needed for a posterior (the identified vessel)")
    command.add("--family", "prior family, for a folder of `regress`", "conjugate", choices=FAMILIES)


def _forecast(command: Parser) -> None:
    _add_ship(command)
    _add_manoeuvres(command, "{0.words} [deg]; repeatable", action="append", default=[])
    text = "trial to compare with the forecast of its manoeuvre; repeatable"
    command.add("--measured", text, [], action="append", metavar="TRIAL")
    _add_format(command)
    _add_overrule(command)
    command.add("--spiral", "forecast steady turns and course stability", False, action="store_true")
    text = "forecast a stopping test with these astern revolutions [1/s] (none)"
    command.add("--stop", text, type=float, metavar="RPS")
    command.add("--draws", "largest number of simulated draws", 1000, type=int)
    command.add("--duration", "duration [s] (40 L/U, pull-out 60)", type=float)
    command.add("--n", "propeller revolutions [1/s] (those of the approach)", type=float)
    command.add("--wind", "true wind [m/s, deg, from] (none)", type=flow, metavar="SPEED/FROM")
    command.add("--current", "current [m/s, deg, to] (none)", type=flow, metavar="SPEED/TO")
    command.add("--facility", "facility of the steering gear and approach speed (that of most runs)", metavar="NAME")
    command.add("--side", "first side (both)", choices=SIDES)
    command.add("--out", "folder of the page (folder of the posterior)")


def _score(command: Parser) -> None:
    command.add("ship", "folder that `identify` wrote, shipped vessel or TOML file", metavar="SHIP")
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add("--length", "length of a window [s] (5 L/U)", type=float)
    command.add("--every", "interval between the starts of windows [s] (their length)", type=float)
    command.add("--draws", "largest number of simulated draws", 100, type=int)
    command.add("--out", "folder of the page (none)")


def _trial_report(command: Parser) -> None:
    _add_trial(command, "trials", nargs="+")
    _add_overrule(command)
    command.add("--vessel", "shipped vessel or TOML file, in the condition of the trial", required=True)
    command.add("--conditions", "conditions of the trial: depth, draughts, wind", metavar="FILE.toml")
    text = "folder that `identify` wrote, for corrections of wind and loading (none)"
    command.add("--ship", text, metavar="REPORT")
    command.add("--full-load", "TOML file of the ship at full load (none)", metavar="VESSEL")
    command.add("--out", "folder of the page", required=True)


def _design(command: Parser) -> None:
    _add_ship(command)
    command.add("--n", "number of runs to choose", 2, type=int)
    command.add("--sea-room", "largest extent of the track of a run [m] (any)", type=float, metavar="M")
    command.add("--wind", "true wind [m/s, deg from the approach course] (none)", type=flow, metavar="SPEED/FROM")
    command.add("--out", "folder of the tables", required=True)


def _montecarlo(command: Parser) -> None:
    command.add("study", "study file: a grid or a population", metavar="STUDY.toml")
    command.add("--workers", "number of processes (one for each core)", type=int)
    command.add("--scheduler", "Dask scheduler whose workers to use", metavar="ADDRESS")
    command.add("--out", "folder of the results and the page", required=True)


def _report(command: Parser) -> None:
    command.add("posteriors", "posterior file, .nc or .zarr", metavar="POSTERIOR", nargs="+")
    command.add("--vessel", "shipped vessel or TOML file: reference and published values (none)")
    command.add("--out", "folder of diagnostics.html", "reports/diagnostics")


_COMMANDS: dict[str, tuple[str, Callable[[Parser], None]]] = {
    "study": ("run the study of the paper and write its report", _study),
    "simulate": ("simulate a trial and print its manoeuvring indices", _simulate),
    "check": ("check and correct a trial before a fit", _check),
    "denoise": ("denoise the motion channels of a trial", _denoise),
    "identify": ("identify a ship from its trials and write a report", _identify),
    "regress": ("estimate coefficients by regression of accelerations", _regress),
    "fit": ("estimate coefficients by a fit of simulated trajectories", _fit),
    "tune": ("choose hyperparameters of a prior by Bayesian optimisation", _tune),
    "forecast": ("forecast manoeuvres of a ship with probability bands", _forecast),
    "score": ("score open-loop simulations of windows of recorded trials", _score),
    "trial-report": ("report on a sea trial in the form of IMO MSC/Circ.1053", _trial_report),
    "design": ("choose the next trial runs that narrow the forecast intervals most", _design),
    "montecarlo": ("run or continue a Monte-Carlo study, such as a grid of experiments", _montecarlo),
    "report": ("write a diagnostic report of saved posteriors", _report),
}
"""Description of each command, and the function that adds its options."""

_WITHOUT_SEED = ("check", "denoise", "montecarlo")  # commands that draw no random numbers
_REPLACES_OWN_OUTPUT = ("study", "montecarlo", "report")  # commands that continue or renew an earlier result
