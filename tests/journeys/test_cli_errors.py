import re
import resource
import subprocess
from dataclasses import replace

import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.inference.regression import identify as identification
from tests.journeys.cases import ALL_COMMANDS, LONG_WORK, files, program
from tests.physics.vessel.cases import TERMS, toml


def refused(capsys, *words, status=2):
    """Run a command line that cannot run; return its one sentence."""
    try:
        found = main(list(map(str, words)))
    except SystemExit as stop:
        found = stop.code
    printed = capsys.readouterr()
    sentences = [line for line in printed.err.splitlines() if line.startswith("pymc-ship: ")]
    assert found == status
    assert printed.out == ""
    assert len(sentences) == 1
    assert printed.err.splitlines()[-1] == sentences[0]
    assert "Traceback" not in printed.err
    assert sentences[0].endswith(".")
    return sentences[0].removeprefix("pymc-ship: ")


def spoil(trial, how):
    """Text of a trial with a defect, below its own comments."""
    lines = trial.read_text().splitlines()
    comments = [line for line in lines if line[0] == "#"]
    header, *lines = lines[len(comments) :]
    table = [dict(zip(header.split(","), line.split(","), strict=True)) for line in lines]
    if how == "nan":
        table = [row | {"v": "nan"} for row in table]
    elif how == "time":
        table = [row | {"time": "5.7"} for row in table]
    elif how == "missing":
        table = [{name: cell for name, cell in row.items() if name != "r"} for row in table]
    elif how == "short":
        table = table[:20]
    elif how == "rudder":
        table = [row | {"delta": "0.1"} for row in table]
    elif how == "text":
        table[57]["v"] = "fast"
    return "\n".join([*comments, ",".join(table[0]), *(",".join(row.values()) for row in table)]) + "\n"


@pytest.mark.parametrize("command", ["regress", "tune"])
@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ("nan", "The trial needs the channels u, v, r, delta; v missing; add them."),
        ("time", "the time of a trial must increase, found 5.7 s in every row; correct it."),
        ("missing", "The trial needs the channels u, v, r, delta; r missing; add them."),
        ("text", "line 61, column v: a number is needed, found 'fast'; correct or empty the cell."),
    ],
)
def test_a_trial_that_cannot_be_used_is_refused(made, small, tmp_path, capsys, command, how, sentence):
    trial, out = tmp_path / "trial.csv", tmp_path / "out"
    trial.write_text(spoil(made / "trial.csv", how))
    words = ("--vessel", made / "small.toml", "--family", "conjugate", "--out", out)
    dof = "surge" if command == "regress" else "yaw"
    more = ("--dof", dof) if command == "tune" else ()
    message = refused(capsys, command, trial, *words, *more)
    assert sentence.format(dof=dof, n=len(TERMS[dof])) in message
    assert files(tmp_path) == ["trial.csv"]


@pytest.mark.parametrize("command", ["regress", "tune", "fit"])
@pytest.mark.parametrize(
    ("how", "sentence"),
    [("short", "The ship hardly turns"), ("rudder", "rudder unit: delta never changes")],
)
def test_a_trial_with_a_bad_check_is_not_fitted(made, tmp_path, capsys, command, how, sentence):
    trial, out = tmp_path / "trial.csv", tmp_path / "out"
    trial.write_text(spoil(made / "trial.csv", how))
    more = ("--dof", "yaw", "--family", "conjugate") if command == "tune" else ()
    words = ("--vessel", made / "small.toml", *more, "--out", out)
    message = refused(capsys, command, trial, *words, status=3)
    assert f"{trial}: The trial cannot be fitted: " in message
    assert sentence in message
    assert files(tmp_path) == ["trial.csv"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            "simulate tanker --turn 35 --out {out}",
            "A vessel is one of .*container.* or the path of a .toml file; found 'tanker'",
        ),
        (
            "simulate {tmp}/none.toml --turn 35 --out {out}",
            "none.toml cannot be read: No such file or directory; check",
        ),
        ("simulate {tmp}/odd.toml --turn 35 --out {out}", r"odd.toml: coefficients.yaw.Nvzz must name a coefficient"),
        (
            "regress {made}/trial.csv --vessel {tmp}/odd.toml --out {out}",
            r"coefficients.yaw.Nvzz must name a coefficient",
        ),
        ("study --vessel tanker --out {out}", "A vessel is one of .* found 'tanker'"),
        (
            "simulate container --zigzag 20-20 --out {out}",
            "a zigzag must be RUDDER/HEADING \\[deg\\] such as 20/20, found '20-20'",
        ),
        ("simulate container --zigzag 20/20/20 --out {out}", "found '20/20/20'"),
        ("simulate container --zigzag 0/20 --out {out}", "rudder_deg is a magnitude between 0 and 90 deg, found 0.0"),
        ("simulate container --zigzag 20/20 --turn 35 --out {out}", "not allowed with argument --zigzag"),
        ("simulate container --out {out}", "one of the arguments --zigzag --turn --pull-out --programme is required"),
        ("simulate container --turn 35 --step 0 --out {out}", "The step must be a positive number, found 0.0 s"),
        (
            "simulate container --turn 35 --duration nan --out {out}",
            "The duration must be a positive number, found nan s",
        ),
        ("simulate container --turn 35 --duration 0.02 --out {out}", "two samples or more, found 1"),
        ("simulate container --turn 35 --duration 1e13 --out {out}", "The duration has at most 1e.08 steps, found"),
        ("simulate container --turn 35 --speed -1 --out {out}", "The approach speed must be positive"),
        (
            "simulate container --turn 35 --speed 100 --out {out}",
            "a divergence at once, at 100 m/s with a step of 0.02 s; give a --speed nearer to the nominal 12.7 m/s",
        ),
        ("simulate container --turn 35 --noise -1 --duration 9 --out {out}", "The noise level is a number from 0 up"),
        (
            "simulate container --turn 35 --noise loud --out {out}",
            "noise must be a level, 'literal' or instruments of .*, found 'loud'",
        ),
        ("simulate container --turn 35 --seed -1 --out {out}", "a seed must be a whole number from 0 up, found '-1'"),
        ("simulate container --programme {tmp}/none.csv --out {out}", "none.csv cannot be read: No such file"),
        (
            "simulate container --programme {made}/trial.csv --out {out}",
            "trial.csv cannot be read: the header is not time,delta_deg but 'time,u,v",
        ),
        (
            "simulate container --programme {tmp}/rad.csv --out {out}",
            "the header is not time,delta_deg but 'time,delta'; correct the file",
        ),
        (
            "simulate container --programme {tmp}/wide.csv --out {out}",
            "wide.csv cannot be read: cannot reshape .*; correct the file",
        ),
        (
            "simulate container --programme {tmp}/rad.csv --side port --out {out}",
            "has its own rudder angles, found --side",
        ),
        ("denoise {tmp}/none.csv --out {out}", "none.csv cannot be read: No such file or directory; check the path"),
        ("denoise {tmp}/rudder.csv --out {out}", "needs one of the channels u, v, r, p, phi, psi, found none"),
        ("denoise {made}/trial.csv --wavelet sinus --out {out}", "needs an orthogonal wavelet, found 'sinus'"),
        ("denoise {made}/trial.csv --prior flat --out {out}", "invalid choice: 'flat'"),
        ("regress {made}/trial.csv --vessel container --family flat --out {out}", "invalid choice: 'flat'"),
        ("regress {made}/trial.csv --vessel container --draws 10 --out {out}", "a positive multiple of 4, found '10'"),
        (
            "regress {made}/trial.csv --vessel container --interval soon --out {out}",
            "seconds, 'all' or 'auto', found 'soon'",
        ),
        ("regress {made}/trial.csv --vessel {small} --interval 0.15 --out {out}", "multiple of the sampling interval"),
        (
            "tune {made}/trial.csv --vessel {small} --dof roll --family conjugate --out {out}",
            "surge, sway, yaw, found 'roll'",
        ),
        (
            "tune {made}/trial.csv --vessel {small} --dof yaw --family conjugate --evaluations 2 --out {out}",
            "at least 6",
        ),
        ("tune {made}/trial.csv --vessel {small} --dof yaw --family conjugate --folds 1 --out {out}", "2 to 150 folds"),
        ("forecast {made}/identified --vessel {small} --out {out}", "needs a manoeuvre, found none; add --zigzag"),
        (
            "forecast {tmp} --vessel {small} --turn 35 --out {out}",
            "found nothing at .*surge-conjugate.nc; check the path",
        ),
        (
            "forecast {made}/identified --vessel {other} --turn 35 --out {out}",
            "must be of the vessel 'other', found 'small' in",
        ),
        ("forecast {tmp}/junk --vessel {small} --turn 35 --out {out}", "surge-conjugate.nc is no posterior"),
        (
            "forecast {tmp}/swapped --vessel {small} --turn 35 --out {out}",
            "must be a posterior of surge, found one of yaw",
        ),
        ("forecast {made}/identified --vessel {small} --turn 35 --draws 1 --out {out}", "draws must be"),
        (
            "forecast {made}/identified/yaw-conjugate.nc --vessel {small} --turn 35 --out {out}",
            "The joint posterior lacks Xdeltadelta, .* of 'small'; use its own terms",
        ),
        (
            "forecast {made}/identified/yaw-conjugate.nc --vessel {other} --turn 35 --out {out}",
            "must be of the vessel 'other', found 'small' in .*yaw-conjugate.nc",
        ),
        ("sail", r"argument COMMAND: invalid choice: 'sail' \(choose from"),
        ("", "the following arguments are required: COMMAND"),
    ],
)
def test_what_cannot_run_is_one_sentence_and_leaves_no_file(made, small, tmp_path, capsys, words, sentence):
    (tmp_path / "odd.toml").write_text(toml(small).replace("Nv =", "Nvzz ="))
    (tmp_path / "other.toml").write_text(toml(replace(small, name="other")))
    (tmp_path / "rad.csv").write_text("time,delta\n0,0.1\n1,0.2\n")
    (tmp_path / "rudder.csv").write_text('# rudder_positive = "port"\ntime,delta\n0,0.1\n1,0.2\n')
    (tmp_path / "wide.csv").write_text("time,delta_deg\n0,1,2,3\n4,5,6,7\n")
    (tmp_path / "junk").mkdir()
    (tmp_path / "junk" / "surge-conjugate.nc").write_text("no NetCDF")
    (tmp_path / "swapped").mkdir()
    yaw = (made / "identified" / "yaw-conjugate.nc").read_bytes()
    (tmp_path / "swapped" / "surge-conjugate.nc").write_bytes(yaw)
    before = files(tmp_path)
    places = {"tmp": tmp_path, "out": tmp_path / "out", "made": made, "small": made / "small.toml"}
    message = refused(capsys, *words.format(**places, other=tmp_path / "other.toml").split())
    assert re.search(sentence, message), message
    assert files(tmp_path) == before


def forbid(*args, **settings):
    raise AssertionError("long work has begun")


@pytest.mark.parametrize("words", ALL_COMMANDS)
def test_a_place_that_cannot_be_written_is_refused_before_long_work(made, tmp_path, capsys, monkeypatch, words):
    """Below a regular file nothing can be written, not even by root."""
    (tmp_path / "file").write_text("kept")
    command, *rest = words.format(made=made).split()
    monkeypatch.setattr(LONG_WORK[command], forbid)
    monkeypatch.setattr(identification, "identify", forbid)
    message = refused(capsys, command, *rest, "--out", tmp_path / "file" / "below" / "out.csv")
    assert re.fullmatch(r".*file/below.* cannot be written: Not a directory; choose another path\.", message)
    assert files(tmp_path) == ["file"]
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize("words", ALL_COMMANDS[:2] + ALL_COMMANDS[3:4])
def test_a_file_never_takes_the_place_of_a_folder(made, tmp_path, capsys, words):
    (tmp_path / "kept.csv").write_text("kept")
    message = refused(capsys, *words.format(made=made).split(), "--out", tmp_path)
    assert message == f"--out must be a file, found the folder {tmp_path}; give the name of a file in it."
    assert files(tmp_path) == ["kept.csv"]


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (OSError(28, "No space left on device"), "[Errno 28] No space left on device."),
        (ValueError("Two lines\n  of a library"), "Two lines of a library."),
        (MemoryError("much"), "The memory is too small for this run: much; make the run shorter."),
    ],
)
def test_errors_of_others_become_one_sentence(made, tmp_path, capsys, monkeypatch, error, sentence):
    def denoise(*args, **settings):
        raise error

    monkeypatch.setattr(ps, "denoise", denoise)
    assert refused(capsys, "denoise", made / "trial.csv", "--out", tmp_path / "smooth.csv") == sentence
    assert files(tmp_path) == []


@pytest.mark.parametrize(("limit", "status"), [(600_000_000, 2), (3_900_000_000, 2), (8_000_000_000, 0)])
def test_a_limit_on_the_address_space_is_a_sentence_not_an_abort(limit, status, tmp_path):
    words = program(
        "simulate", "kvlcc2", "--turn", "35", "--duration", "20", "--quiet", "--out", tmp_path / "trial.csv"
    )
    run = subprocess.run(
        words,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )
    assert run.returncode == status
    found = f"found a limit of {limit / 1e9:.1f} GB; raise the limit (ulimit -v)."
    assert run.stderr == (f"pymc-ship: A run needs an address space of 4 GB, {found}\n" if status else "")
    assert (tmp_path / "trial.csv").exists() == (status == 0)
