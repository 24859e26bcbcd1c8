"""Forces on a ship as functions of its motion and inputs.

- `terms`: polynomial terms such as Yv|v| and their evaluator.
- `prime_system`: non-dimensional values (SNAME).
- `propeller`: propeller loading of polynomial terms as a function of the speed.
- `part`: the interface of a part of the force.
- `programs`: evaluation and reverse-mode derivatives of traced formulae.
- `expressions`: formulae, traced to programs.
- `modular`: the table of parts and the accelerations of a set of parts.
- `hull`: forces of the water on the hull.
- `hull_database`: hull coefficients from captive tests of other ships.
- `screw`: thrust, wake, race and side force of the propeller.
- `rudder`: its normal force, flow straightening and interaction with the hull.
- `surroundings`: wind, current and a constant residual force.
"""
