"""Grids of experiments that can be stopped and continued."""
