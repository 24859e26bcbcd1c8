"""Manoeuvres, their indices and the criteria of IMO MSC.137(76).

A manoeuvre (`standard`) is of a kind (`kinds`, `registry`); `steering_record`, `events` and `indices` read a record.
"""
