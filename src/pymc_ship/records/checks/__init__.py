"""Checks of a trial before a fit, and its correction by them.

:mod:`.trial_checks` makes all checks; each other module holds those of one subject, and `verdicts` their outcome.
"""
