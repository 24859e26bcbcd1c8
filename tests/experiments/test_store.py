"""The store of a study: nothing is lost or counted twice, whatever is cut off, full or changed."""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys

import pyarrow.parquet as pq
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.experiments import run as engine
from pymc_ship.experiments.run import read_study
from pymc_ship.experiments.store import locked_store
from pymc_ship.machine.errors import StudyError
from tests.experiments.cases import trivial
from tests.experiments.folders import PATH, changed, kept, run, tables, timings
from tests.sentences import refused


def journalled(study, out):
    """Store of a study with three results in the journal of its first part, and the journal."""
    with locked_store(out, read_study(study)) as store:
        (cell, part, seeds), *_ = store.missing()
        for seed in seeds[:3]:
            clock = {"session": 1, "executor": "joblib", "workers": 1, "wall": 1.0, "parent": 1.0}
            store.add(trivial(store.study.task(cell, seed, part)) | clock)
    (journal,) = out.rglob("_*.jsonl")
    return journal


def test_a_line_that_was_cut_off_is_dropped(study, plain, tmp_path):
    journal = journalled(study, tmp_path)
    journal.write_bytes(journal.read_bytes()[:-30])
    with locked_store(tmp_path, read_study(study)) as store:
        assert store.missing()[0][2] == [2, 3]
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)
    assert timings(tmp_path)["session"].eq(1).sum() == 2


def test_a_journal_whose_part_is_written_counts_once(study, plain, tmp_path):
    """The run was killed after the part was moved into place and before its journal went."""
    shutil.copytree(plain, tmp_path / "out")
    journal = journalled(study, tmp_path / "other")
    target = tmp_path / "out" / journal.relative_to(tmp_path / "other")
    shutil.copy(journal, target)
    run(study, tmp_path / "out")
    assert tables(tmp_path / "out") == tables(plain)


@pytest.mark.parametrize("how", ["flipped", "another part", "no table"])
def test_a_damaged_part_is_named_and_done_again_when_it_is_gone(study, plain, tmp_path, how):
    shutil.copytree(plain, tmp_path / "out")
    part, other, *_ = sorted((tmp_path / "out" / "parts").rglob("*.parquet"))
    raw = bytearray(part.read_bytes())
    raw[10] ^= 1
    part.write_bytes({"flipped": raw, "another part": other.read_bytes(), "no table": b"no table"}[how])
    with refused(StudyError, str(part)):
        run(study, tmp_path / "out")
    part.unlink()
    run(study, tmp_path / "out")
    assert tables(tmp_path / "out") == tables(plain)


def test_a_grid_that_grows_keeps_its_results_and_gets_those_of_the_grown_one(study, plain, tmp_path):
    grown = changed(study, ("seeds = 4", "seeds = 6"), ("[0.01, 0.05]", "[0.001, 0.01, 0.05]"))
    run(grown, tmp_path / "whole")
    shutil.copytree(plain, tmp_path / "out")
    run(grown, tmp_path / "out", workers=2)
    assert tables(tmp_path / "out") == tables(tmp_path / "whole")
    assert timings(tmp_path / "out").groupby("session").size().tolist() == [16, 20]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("seeds = 4", "seeds = 3", "seeds was 4, found 3"),
        ("root_seed = 7", "root_seed = 8", "root_seed was 7, found 8"),
        ("duration = 60.0", "duration = 61", "duration was 60.0, found 61.0"),
        ("[0.01, 0.05]", "[0.01, 0.04]", "noise.white had 0.05, which is gone"),
        ("white =", "offsets =", "noise had 'white', which is gone"),
        ('"weak form", ', "", "methods had 'weak form', which is gone"),
        ('"zigzag 20/20"', '"zigzag 10/10"', "manoeuvres had 'zigzag 20/20 port', which is gone"),
        ('["small.toml"]', '["container"]', "ships had 'small', which is gone"),
    ],
)
def test_a_study_that_changes_is_refused(study, plain, tmp_path, capsys, old, new, sentence):
    shutil.copytree(plain, tmp_path / "out")
    words = ["montecarlo", str(changed(study, (old, new))), "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        f"pymc-ship: {tmp_path / 'out'} holds another study, which can only be extended: {sentence}; "
        "choose another folder.\n"
    )
    assert tables(tmp_path / "out") == tables(plain)


def test_a_full_disk_ends_in_a_sentence_and_loses_nothing(study, plain, tmp_path):
    """Files of a child process may not grow over 1000 bytes: the third line of a journal is cut off."""
    code = "import sys, tests.experiments.cases as c\n"
    code += "from pymc_ship.experiments import run as e\n"
    code += "e.reported_montecarlo.__kwdefaults__['work'] = c.trivial\n"
    code += "e._parent_seconds = lambda *_: 0.001\n"
    code += "from pymc_ship.cli.main import main; sys.exit(main(sys.argv[1:]))"
    words = ["montecarlo", str(study), "--workers", "1", "--quiet", "--out", str(tmp_path)]

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    environment = os.environ | {"PYTHONPATH": PATH, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code, *words], env=environment, preexec_fn=limited, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    sentence = r"pymc-ship: .*jsonl cannot be written: .*; what was measured is kept: make room and run again\.\n"
    assert re.fullmatch(sentence, done.stderr)
    before = kept(tmp_path)
    assert 1 <= len(before) < 4
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)
    assert timings(tmp_path).groupby("session").size().tolist() == [len(before), 16 - len(before)]


def full(*args, **settings):
    raise OSError(28, "No space left on device")


def test_a_disk_that_is_full_when_a_part_is_written_keeps_its_journal(study, plain, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_parent_seconds", lambda *_: 0.001)
    with monkeypatch.context() as patch:
        patch.setattr(pq.ParquetWriter, "write_table", full)
        with refused(ps.OutputError):
            run(study, tmp_path)
    assert len(kept(tmp_path)) == 4
    run(study, tmp_path)
    assert tables(tmp_path) == tables(plain)


def test_a_disk_that_is_full_when_the_tables_are_written_keeps_the_results(study, plain, tmp_path, monkeypatch):
    shutil.copytree(plain, tmp_path / "out")
    before = tables(tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setattr(pq.ParquetWriter, "write_table", full)
        with refused(ps.OutputError):
            run(study, tmp_path / "out")
    assert tables(tmp_path / "out") == before
    assert len(kept(tmp_path / "out")) == 16
