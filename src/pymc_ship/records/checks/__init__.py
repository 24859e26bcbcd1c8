"""Checks of a trial before a fit, and its correction by them.

- `verdicts`: the outcome of a check: verdict, numbers, sentence and remedy.
- `record_quality`: sampling, noise, resolution, spikes, gaps and frozen sensors.
- `mistakes`: known mistakes as data, and which of them explains a disagreement.
- `kinematics`: rates against heading and roll, speed against the length of the track.
- `track`: velocities against the track: axes, sign of v, lever arm, drift.
- `lag`: velocities that are late behind the track.
- `rudder`: unit, sign, zero, rate and delay of the rudder.
- `revolutions_and_wind`: advance number of the propeller, true or relative wind.
- `plausibility`: whether the motion can be that of this ship, and which piece of it the models cover.
- `excitation`: straight approach, range of the motion, directions of the design above the noise.
- `run_set`: the same motion in two runs.
- `trial_checks`: all checks of a record, and the record corrected by them.
"""
