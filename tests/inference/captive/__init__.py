"""Tests of the wing captive."""
