import functools
import signal
import subprocess
import time
import weakref

import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.inference.regression import identify as identification
from tests.journeys.cases import ALL_COMMANDS, LONG_WORK, files, program, stop


@pytest.mark.parametrize(("lasts", "ends"), [(10.0, 130), (0.0, 2)])
def test_an_interrupt_that_python_ignores_still_ends_the_run(tmp_path, capsys, monkeypatch, lasts, ends):
    """But not what comes after a command that was over first."""

    def work(*args, **settings):
        referent = set()
        kept = weakref.ref(referent, stop)
        del referent
        assert kept() is None
        end = time.monotonic() + lasts
        while time.monotonic() < end:  # an interrupt of another thread cuts no sleep short
            time.sleep(0.01)
        raise ValueError("over.")

    monkeypatch.setattr(ps, "simulate", work)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status = main(["simulate", "container", "--turn", "35", "--out", str(tmp_path / "trial.csv")])
        time.sleep(0.2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert status == ends
    assert ("interrupted; no partial files remain" in capsys.readouterr().err) == (ends == 130)


@pytest.mark.parametrize("words", ALL_COMMANDS[:5])
@pytest.mark.parametrize("place", ["api", "writing"])
def test_an_interrupted_run_keeps_the_earlier_result_and_leaves_nothing_else(
    made, tuned, tmp_path, capsys, monkeypatch, words, place
):
    command, *rest = words.format(made=made).split()
    results = {
        "regress": ["out/coefficients.csv", "out/sway-conjugate.nc"],
        "forecast": ["out/forecast.html", "out/tables/forecast_verdict.csv"],
    }.get(command, ["out"])
    for name in results:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("earlier")
    monkeypatch.setattr("pymc_ship.cli.commands.tune_prior", lambda *args, **settings: tuned)
    if place == "api":
        monkeypatch.setattr(LONG_WORK[command], stop)
        monkeypatch.setattr(identification, "identify", stop)
    else:
        monkeypatch.setattr("os.replace", stop)
    assert main([command, *rest, "--quiet", "--force", "--out", str(tmp_path / "out")]) == 130
    printed = capsys.readouterr()
    expected = "pymc-ship: interrupted; no partial files remain and earlier results are unchanged.\n"
    assert (printed.out, printed.err) == ("", expected)
    assert files(tmp_path) == results
    assert {(tmp_path / name).read_text() for name in results} == {"earlier"}
    assert [path for path in tmp_path.rglob("*") if "partial" in path.name] == []


def test_an_interrupted_forecast_moves_no_file_before_all_are_there(made, tmp_path, monkeypatch):
    """The second of two manoeuvres is interrupted; the first is not left behind."""
    forecast, calls = ps.forecast, []

    def once(*args, **settings):
        calls.append(args[1].label)
        return stop() if len(calls) > 1 else forecast(*args, **settings)

    monkeypatch.setattr(ps, "forecast", once)
    options = ["--draws", "4", "--duration", "10", "--zigzag", "10/10", "--turn", "35", "--side", "port"]
    words = ("--vessel", made / "small.toml", *options)
    assert main(["forecast", *map(str, (made / "identified", *words)), "--out", str(tmp_path)]) == 130
    assert calls == ["zigzag 10/10 port", "turning circle 35 port"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_control_c_ends_a_true_run(made, tmp_path):
    words = ("tune", made / "trial.csv", "--vessel", made / "small.toml", "--dof", "yaw", "--family", "conjugate")
    words = program(*words, "--evaluations", 5000, "--out", tmp_path / "prior.json")
    listen = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a runner in the background ignores it
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, preexec_fn=listen, **pipes) as process:
        try:
            told = [process.stderr.readline() for _ in range(3)]
            time.sleep(0.3)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=20)
        finally:
            process.kill()
    assert told[1:] == ["denoising\n", "tuning the conjugate prior of the yaw: 5000 evaluations\n"]
    assert err == "pymc-ship: interrupted; no partial files remain and earlier results are unchanged.\n"
    assert (process.returncode, out) == (130, "")
    assert list(tmp_path.iterdir()) == []
