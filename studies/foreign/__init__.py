"""Simulators of foreign ships, which judge what the package identifies; they share no code with it.

``mmg``, ``mariner`` and ``s175`` hold the ships, ``sailing`` sails them, ``cases`` names what is sailed and ``run``
identifies each case and scores the forecasts: ``make foreign``.
"""
