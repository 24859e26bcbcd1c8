"""Manoeuvres, their indices and the IMO criteria.

- `kinds`: kind of manoeuvre and index, as values.
- `zigzags`: the zigzag test: indices, limits, recognition in a record.
- `turning_circles`: the turning circle and the pull-out, likewise.
- `registry`: the known kinds by name; new ones are registered here.
- `standard`: one manoeuvre, as zigzag, turning circle, spiral or rudder programme.
- `events`: headings reached, peaks, distances and the steady turn of one run.
- `indices`: overshoots, advance, transfer and other indices of a record.
- `criteria`: limits of IMO MSC.137(76) and the probability of conformity.
- `steering_record`: first execute, fixed rudder angles and rudder reversals of a record.
"""
