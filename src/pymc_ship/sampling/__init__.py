"""Markov chains; the only wing that imports PyMC."""
