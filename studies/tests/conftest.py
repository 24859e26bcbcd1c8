"""Trials and vessels that the tests of the studies share with those of the library."""

from __future__ import annotations

from tests.conftest import container, nine  # noqa: F401
