"""What is steered, its indices and IMO criteria, and how a record of it is recognised.

- `standard`: zigzag, turning circle and free rudder programme as values.
- `indices`: overshoots, advance, transfer and the like of a record.
- `criteria`: IMO MSC.137(76): limits and verdicts, with probabilities for draws.
- `recognition`: which manoeuvre a record holds, and its steering gear.
- `measured`: a measured manoeuvre beside a forecast one.
"""
