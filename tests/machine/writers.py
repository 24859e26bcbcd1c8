"""Processes that write results: over and over, until they are killed, or up to a step at which they kill themselves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from pymc_ship.machine.files import staged_files, staged_path

ROOT = Path(__file__).parents[2]
PATH = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
PARTS = 40


def write(how, out, mark):
    """Write a result of some parts, each with a mark: a file, a folder or files of a folder that has others."""
    if how == "file":
        with staged_path(out / "result") as partial, partial.open("w") as file:
            for _ in range(PARTS):
                file.write(f"{mark}\n")
                file.flush()
        return
    with staged_path(out / "result") if how == "folder" else staged_files(out / "result", own=["part*"]) as partial:
        partial.mkdir(exist_ok=True)
        for k in range(PARTS):
            (partial / f"part{k}").write_text(f"{mark}\n")


def read(how, out):
    """Marks of the parts of a result."""
    if how == "file":
        return (out / "result").read_text().split()
    return [path.read_text().strip() for path in sorted((out / "result").glob("part*"))]


def write_many(how, out, mark, times):
    for _ in range(times):
        write(how, out, mark)


def killed_at(how, out, mark, step):
    """Write, but die without a word when a name is to be changed for the time ``step``."""
    replace, calls = os.replace, []

    def deadly(source, target):
        calls.append(target)
        if len(calls) == step:
            os.kill(os.getpid(), signal.SIGKILL)
        replace(source, target)

    os.replace = deadly
    write(how, out, mark)


def killed_in_removal(how, out, mark, step):
    """Write, but die when a file or folder is to be removed for the time ``step``."""
    calls = []

    def hook(event, arguments):
        if event in ("os.remove", "os.rmdir"):
            calls.append(arguments)
            if len(calls) == step:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    write(how, out, mark)


def started(name, *arguments):
    """Process that calls a function of this module."""
    code = "from pathlib import Path\nimport tests.machine.writers as w\n"
    code += f"w.{name}({', '.join(map(_shown, arguments))})"
    environment = os.environ | {"PYTHONPATH": PATH}
    return subprocess.Popen([sys.executable, "-c", code], env=environment)


def _shown(value):
    return f"Path({str(value)!r})" if isinstance(value, Path) else repr(value)
