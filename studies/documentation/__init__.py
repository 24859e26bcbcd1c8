"""Figures of the documentation, and its page on what to expect, from the tables in ``reports``.

``python -m studies.documentation`` writes them into ``docs``.
"""
