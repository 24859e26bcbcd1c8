"""Posterior draws carried into manoeuvres, with bands, intervals and a page."""
