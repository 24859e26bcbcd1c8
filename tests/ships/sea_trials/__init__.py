"""Tests of pymc_ship.sea_trials."""
