"""Whether a record can be trusted, and its mending.

- `verdicts`: what a check says: verdict, numbers, sentence and remedy.
- `record_quality`: sampling, noise, resolution, spikes, gaps and frozen sensors.
- `kinematics`: whether velocities lead to heading, roll and track.
- `rudder`: unit, sign, zero, rate and delay of the rudder.
- `plausibility`: whether the motion can be that of this ship, and which piece of it the models hold.
- `excitation`: straight approach, range of the motion, terms that can be told apart.
- `trial_checks`: all checks of a record, and the record corrected by them.
"""
