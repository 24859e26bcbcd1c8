"""Bayesian identification of ship manoeuvring models."""
