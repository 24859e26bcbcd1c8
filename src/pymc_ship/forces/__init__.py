"""What acts on a ship, as functions of her motion and inputs. Imports no other wing.

- `terms`: polynomial terms such as Yv|v| and their one evaluator.
- `prime_system`: the one non-dimensionalisation.
- `propeller`: thrust and inflow of the rudder as functions of the speed.
"""
