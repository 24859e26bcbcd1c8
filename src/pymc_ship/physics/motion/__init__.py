"""The equations of motion: integrated and differentiated.

- `equations`: accelerations from state and rudder, many ships at once.
- `inputs`: rudder, revolutions and wind as the forces take them.
- `captive`: forces on a ship in prescribed motion, as in captive tests.
- `linearisation`: derivatives of the rates by states, coefficients and parameters.
- `prime_record`: the motion of a record in prime quantities.
- `stepping`: the steps of the integrators, and the range of motions in which the model is valid.
- `controlled`: the motion of one ship with controlled error, the reference of the steps.
- `stability`: how a small disturbance of a straight course grows.
- `simulation`: a manoeuvre, integrated.
- `replay`: the motion along a rudder record.
- `sensitivities`: derivatives of a simulated motion by coefficients and initial state.
"""
