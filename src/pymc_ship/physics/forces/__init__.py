"""What acts on a ship, as functions of her motion and inputs. Imports no other wing.

- `terms`: polynomial terms such as Yv|v| and their one evaluator.
- `prime_system`: the one non-dimensionalisation.
- `propeller`: thrust and inflow of the rudder as functions of the speed.
- `part`: what a part of a ship's force is.
- `programs`: elementary operations, carried out and differentiated.
- `expressions`: formulae, noted as programs.
- `modular`: parts put together, and the table of them.
- `hull`: forces of the water on the hull.
- `hull_database`: what captive tests of other ships say of a bare hull.
- `screw`: thrust, wake, race and side force of the propeller.
- `rudder`: its normal force and what the hull makes of it.
- `surroundings`: wind, current and the unmeasured rest.
"""
