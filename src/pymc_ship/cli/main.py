"""Entry point of ``pymc-ship``, the only module that prints.

Results go to standard output, progress and remarks to standard error. Exit status: 2 with one sentence if the command
cannot run, 3 if a trial or the results fail a check, 4 if a trial is corrected or doubtful, 130 after an interrupt.
Libraries are imported after the arguments are parsed.
"""

from __future__ import annotations

import _thread
import os
import sys
import threading
import warnings
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pymc_ship.cli.argument_types import expand_patterns
from pymc_ship.cli.parser import error_line, parser
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.memory import address_space

if TYPE_CHECKING:
    from pymc_ship.cli.files import Outcome

_ADDRESS_SPACE = 4_000_000_000  # smallest address space [bytes] in which the numerical libraries do not abort

_MODULES = {"check": "check"} | dict.fromkeys(
    ("identify", "forecast", "score", "trial-report", "design"), "ship_commands"
)  # of commands that are not in `commands`

_LIBRARY_ERRORS = {
    "no locator available": "The cache of compiled functions needs a writable folder, found none; set "
    "NUMBA_CACHE_DIR to one.",
    "can't start new thread": "The system cannot start a thread, perhaps for lack of memory; end other programs.",
}
"""Error sentences by words of the messages of libraries."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command with arguments, by default those of the process, and return its exit status.

    Status 0, 2 if the command cannot run, 3 if a check fails, 4 if ``check`` corrects or doubts the record, 130 after
    an interrupt. SystemExit with status 2 for arguments that cannot be parsed, 0 after ``--help`` and ``--version``.
    """
    return run_command(parser(), _command, argv)


def run_command(parser: ArgumentParser, command: Callable[..., Outcome], argv: Sequence[str] | None = None) -> int:
    """Run a command with the arguments of a parser that has ``--quiet``; errors and exit status as of :func:`main`.

    ``command(args, progress)`` returns an :data:`Outcome`.
    """
    try:
        _replace_unencodable()
        args = parser.parse_args(expand_patterns(sys.argv[1:] if argv is None else argv))
        _check_address_space()
        with _repeat_interrupts(), _plain_warnings(), _progress(args.quiet) as progress:
            outcome = command(args, progress)
        text, path = outcome[:2]
        if text:
            print(text, flush=True)
        if path and not args.quiet:
            print(f"Written to {path}.", file=sys.stderr)
    except KeyboardInterrupt:
        return _fail("interrupted; no partial files remain and earlier results are unchanged.", 130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    except MemoryError as error:
        return _fail(f"The memory is too small for this run: {str(error) or 'none is left'}; make the run shorter.", 2)
    except (ImportError, SystemError) as error:  # also what the interpreter makes of too little memory
        return _library_error(error)
    except (ValueError, OSError) as error:
        if "shared object" in str(error):  # of numba
            return _library_error(error)
        return _fail(str(error), 3 if isinstance(error, TrialError) and error.checks else 2)
    except RuntimeError as error:
        for reason, text in _LIBRARY_ERRORS.items():
            if reason in str(error):
                return _fail(text, 2)
        raise
    failure = outcome[2] if len(outcome) > 2 else ""
    return _fail(failure, outcome[3] if len(outcome) > 3 else 3) if failure else 0


def _command(args: Namespace, progress: Callable[..., None]) -> Outcome:
    from pymc_ship.cli.files import check_joined, check_replaced

    check_joined(args)
    check_replaced(args)
    module = import_module(f"pymc_ship.cli.{_MODULES.get(args.command, 'commands')}")
    return getattr(module, args.command.replace("-", "_"))(args, progress)


def _replace_unencodable() -> None:
    """Print "?" for characters that the encoding of the output lacks, as that of a Windows pipe."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _check_address_space() -> None:
    limit = address_space()
    if limit < _ADDRESS_SPACE:
        raise OSError(
            f"A run needs an address space of {_ADDRESS_SPACE / 1e9:.0f} GB, found a limit of {limit / 1e9:.1f} GB; "
            "raise the limit (ulimit -v)."
        )


def _library_error(error: Exception) -> int:
    reason = str(error).removesuffix(".")
    return _fail(f"A library cannot be loaded, for lack of memory or a broken installation: {reason}; reinstall it.", 2)


def _fail(text: str, status: int) -> int:
    print(error_line(text), file=sys.stderr)
    return status


@contextmanager
def _repeat_interrupts() -> Iterator[None]:
    """Repeat an interrupt that Python ignored in a weakref callback or a ``__del__``."""
    other_hook, pending = sys.unraisablehook, []

    def hook(ignored: sys.UnraisableHookArgs) -> None:
        if issubclass(ignored.exc_type, KeyboardInterrupt):
            pending.append(threading.Timer(0.05, _thread.interrupt_main))  # not at once: it would be ignored again
            pending[-1].start()
        else:
            other_hook(ignored)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = other_hook
        for timer in pending:
            timer.cancel()


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print each warning for users once and as one line, without the line of the program."""
    printed: set[str] = set()
    with warnings.catch_warnings():
        shown = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *args: Any, **kwargs: Any) -> None:
            if category is UserWarning:
                if str(message) not in printed:
                    print(error_line(str(message)), file=sys.stderr)
                printed.add(str(message))
            else:
                shown(message, category, *args, **kwargs)

        warnings.showwarning = show
        yield


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[..., None]]:
    """Function that prints progress, one line a step; on a terminal a spinner, where ``remark=True`` stays."""
    if quiet:
        yield lambda text, remark=False: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text, remark=False: print(text, file=sys.stderr, flush=True)
        return
    columns = (SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("")

        def show(text: str, remark: bool = False) -> None:
            if remark:
                console.print(text, markup=False, highlight=False, soft_wrap=True)
            else:
                bar.update(task, description=text)

        yield show
