"""Command line ``pymc-ship``: parses, calls, prints; the only place that prints.

Results go to standard output, progress and remarks to standard error. A command that cannot run says so in one sentence
and ends with status 2, an interrupted one with status 130. A trial with a bad check is not fitted and ends with status
3; results that fail a check are written, and one sentence and status 3 say that they do. Nothing heavy is imported
before a command line is accepted.
"""

from __future__ import annotations

import _thread
import os
import sys
import threading
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pymc_ship.cli.parser import parser
from pymc_ship.cli.sentences import sentence
from pymc_ship.cli.words import expanded
from pymc_ship.machine.errors import TrialError
from pymc_ship.machine.memory import address_space

if TYPE_CHECKING:
    from pymc_ship.cli.files import Outcome

_ADDRESS_SPACE = 4_000_000_000
"""Address space [bytes] below which the libraries of linear algebra, threads and compilation may abort."""

_MACHINE = {
    "no locator available": "Compiled functions are kept in a folder, found none that can be written; set "
    "NUMBA_CACHE_DIR to one.",
    "can't start new thread": "The machine starts no more threads, of too little memory perhaps; end other programs.",
}
"""Sentences on errors of the machine, by words of the libraries that meet them."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Words after the program's name; those of the process by default.

    Returns
    -------
    int
        Exit status: 0, 2 when the command cannot run, 3 when a check of the results fails, 130 when it was interrupted.

    Raises
    ------
    SystemExit
        Status 2 for words that cannot be parsed, 0 after ``--help`` and ``--version``.
    """
    return run_command(parser(), _command, argv)


def run_command(words: ArgumentParser, command: Callable[..., Outcome], argv: Sequence[str] | None = None) -> int:
    """Run a command on the words of a command line; errors and the exit status are those of :func:`main`.

    Parameters
    ----------
    words : ArgumentParser
        Of the command, with an option ``--quiet``.
    command : callable
        Takes the parsed words and a function that shows progress.
    argv : sequence of str, optional
        Words after the program's name; those of the process by default.
    """
    try:
        _print_what_can_be_shown()
        args = words.parse_args(expanded(sys.argv[1:] if argv is None else argv))
        _check_address_space()
        with _interrupts_kept(), _progress(args.quiet) as progress:
            text, path, *failures = command(args, progress)
        if text:
            print(text, flush=True)
        if path and not args.quiet:
            print(f"Written to {path}.", file=sys.stderr)
    except KeyboardInterrupt:
        return _fail("interrupted; nothing is left half-written and earlier results stand as they were.", 130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    except MemoryError as error:
        return _fail(f"The memory does not hold this run: {str(error) or 'none is left'}; make it shorter.", 2)
    except (ImportError, SystemError) as error:  # also what the interpreter makes of too little memory
        return _unloaded(error)
    except (ValueError, OSError) as error:
        if "shared object" in str(error):  # of numba
            return _unloaded(error)
        return _fail(str(error), 3 if isinstance(error, TrialError) and error.checks else 2)
    except RuntimeError as error:
        for reason, said in _MACHINE.items():
            if reason in str(error):
                return _fail(said, 2)
        raise
    return _fail(failures[0], 3) if any(failures) else 0


def _command(args: Namespace, progress: Callable[..., None]) -> Outcome:
    """Do a command of ``pymc-ship``."""
    from pymc_ship.cli import commands

    return getattr(commands, args.command.replace("-", "_"))(args, progress)


def _print_what_can_be_shown() -> None:
    """Print a question mark for a letter that the encoding of the output lacks, as that of a Windows pipe may."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _check_address_space() -> None:
    """Refuse to run where a limit on the address space would let a library abort in the midst of a run."""
    limit = address_space()
    if limit < _ADDRESS_SPACE:
        raise OSError(
            f"A run needs an address space of {_ADDRESS_SPACE / 1e9:.0f} GB, found a limit of {limit / 1e9:.1f} GB; "
            "raise it (ulimit -v)."
        )


def _unloaded(error: Exception) -> int:
    """Say that a library cannot be loaded; return the exit status."""
    reason = str(error).removesuffix(".")
    return _fail(f"A library cannot be loaded, for want of memory or installed badly: {reason}; see to it.", 2)


def _fail(text: str, status: int) -> int:
    """Print an error as one line; return the exit status."""
    print(sentence(text), file=sys.stderr)
    return status


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Raise an interrupt again when Python has ignored it because it fell into a weakref callback or a ``__del__``."""
    others, pending = sys.unraisablehook, []

    def hook(ignored: sys.UnraisableHookArgs) -> None:
        if issubclass(ignored.exc_type, KeyboardInterrupt):
            pending.append(threading.Timer(0.05, _thread.interrupt_main))  # not at once: it would be ignored again
            pending[-1].start()
        else:
            others(ignored)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = others
        for timer in pending:
            timer.cancel()


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[..., None]]:
    """Function that shows progress: a spinner on a terminal, otherwise one line for each step.

    With ``remark=True`` the text is to stay, on a terminal, too.
    """
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
