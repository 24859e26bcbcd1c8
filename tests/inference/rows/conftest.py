"""Fixtures of this wing; all are read only."""

from __future__ import annotations

import pytest

from tests.inference.rows.frames import motion


@pytest.fixture
def frame():
    return pytest.importorskip("pandas").DataFrame(motion())
