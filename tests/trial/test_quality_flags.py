"""Doubts about records, as pages and texts name them."""

from __future__ import annotations

import pymc_ship as ps
from pymc_ship.trial.quality_flags import quality_flags, quality_remarks, with_quality_flags


def test_doubts_of_a_fit_are_none_of_a_measured_number():
    remarks = ("Doubtful: spikes: 3 on u.", "Doubtful: excitation yaw: 5 of 12.", "Doubtful: ranges: small.")
    bad = "Overruled, though bad: rudder sign: to starboard."
    run = ps.simulate("kvlcc2", ps.turning_circle(35), duration=60, step=1.0)
    trials = {"a": with_quality_flags(run, "doubtful", remarks), "b": with_quality_flags(run, "bad", [bad]), "c": run}
    assert quality_remarks(trials) == [f"a: {remarks[0]}", f"b: {bad}"]
    every = quality_flags([*trials.values()], [*trials])
    assert every["record_remarks"].splitlines() == [*(f"a: {remark}" for remark in remarks), f"b: {bad}"]
    assert every["record_verdict"] == "bad"
