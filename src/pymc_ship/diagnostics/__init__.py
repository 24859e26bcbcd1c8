"""Diagnostics of posteriors and their page: convergence, contraction, residuals, cross-validation, sensitivity.

Kinds of posterior: `regression` (one degree of freedom) and `trajectory` (all coefficients); each `*_parts` file
writes the sections of its kind, from the numbers, tables and figures of the files of that name.
"""
