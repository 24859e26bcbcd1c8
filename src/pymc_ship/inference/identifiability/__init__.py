"""Identifiability: `information` of runs and unidentified directions; Cramer-Rao `bound` of clean trials."""
