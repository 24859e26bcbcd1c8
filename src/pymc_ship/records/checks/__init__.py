"""Whether a record can be trusted, and its mending.

- `verdicts`: the outcome of a check: verdict, numbers, sentence and remedy.
- `record_quality`: sampling, noise, resolution, spikes, gaps and frozen sensors.
- `kinematics`: whether rates lead to heading and roll, and speeds to the length of the track.
- `track`: whether velocities lead to the track: axes, sign of v, lever arm, drift.
- `lag`: velocities that are late behind the track.
- `rudder`: unit, sign, zero, rate and delay of the rudder.
- `surroundings`: advance number of the propeller, and whether the wind is the true one.
- `plausibility`: whether the motion can be that of this ship, and which piece of it the models hold.
- `excitation`: straight approach, range of the motion, directions of the design above the noise.
- `trial_checks`: all checks of a record, and the record corrected by them.
"""
