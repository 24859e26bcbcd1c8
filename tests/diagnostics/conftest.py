"""A good posterior, read only."""

from __future__ import annotations

import pytest

from tests.diagnostics.regressions import posterior


@pytest.fixture(scope="module")
def good(container):
    return posterior(container)
