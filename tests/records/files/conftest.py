"""A simulated record, and the reader of files with given text."""

from __future__ import annotations

import pytest

import pymc_ship as ps
from tests.records.files.cases import record


@pytest.fixture(scope="package")
def run(container):
    return record(container)


@pytest.fixture
def read(tmp_path):
    """Function that reads a text or bytes as a file."""

    def read(content, name="run.csv", **settings):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return ps.read_trial(path, **settings)

    return read
