"""What is steered, its indices and the IMO criteria on them.

- `kinds`: what the manoeuvres of one kind have in common, as one value.
- `zigzags`: the zigzag test as such a value, with its indices, limits and recognition.
- `turning_circles`: the turning circle and the pull-out likewise.
- `registry`: the known kinds by name, where a new one is registered.
- `standard`: zigzag, turning circle and free rudder programme as values.
- `events`: headings reached, peaks, distances and the steady turn of one run.
- `indices`: overshoots, advance, transfer and the like of a record.
- `criteria`: IMO MSC.137(76): limits and verdicts, with probabilities for draws.
- `helm`: execution, held angles and reversals of a rudder.
"""
