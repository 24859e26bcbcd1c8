"""How a known ship moves.

Here live the forces on a ship, the ship as data, the manoeuvres that are steered and the equations of motion. A vessel
file and a manoeuvre enter. A simulated trial, its derivatives by every coefficient and its indices leave.

- `forces`: what acts on a ship, as functions of motion and inputs, by one evaluator.
- `vessel`: particulars, inertia and force terms, read from a file and checked.
- `manoeuvre`: kinds of manoeuvre, their indices and IMO criteria.
- `motion`: the equations of motion, integrated and differentiated.
"""
