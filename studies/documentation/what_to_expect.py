"""Page of the documentation on what to expect from which trials, from the tables in ``reports``."""

from __future__ import annotations

import numpy as np

from pymc_ship.ships.ensemble.calibration import constants
from studies.documentation.tables import foreign_summary, row, table

OVERSHOOTS = ("first_overshoot_angle", "second_overshoot_angle")

PAGE = """# What to expect

How far off is a forecast, and how often is its 95 % interval right? The answer depends on the trials.

![median error and half width of the 95 % intervals, by the trials of a ship](figures/what_to_expect.png)

The figure shows seventy simulated ships. Each ship was identified from the trials at the left; 20/20 is a zigzag with
20 deg of rudder, reversed at 20 deg of heading. Then circles, zigzags and pull-outs were forecast and compared with the
true ones. [How these ships were made](case_studies/foreign_ships.md#a-population).

## Simulated ships

| trials of the ship | 95 % intervals that hold the truth [%] | median error | median half width |
| --- | --- | --- | --- |
{trials}

Errors are in ship lengths, in L/U for times, and in peak headings for overshoot angles. Over all ships,
{share} % of {indices} intervals hold the truth. The tactical diameter has a median error of {diameter} L.

[Four published simulators](case_studies/foreign_ships.md) gave {cases} further cases. There the median error of the
tactical diameter is {foreign_error} %, and {foreign_inside} intervals hold the truth.

## Real ships

| ship | identified from | forecast | mean error | in 95 % intervals |
| --- | --- | --- | --- | --- |
| [KVLCC2](case_studies/kvlcc2.md), model | six zigzags | overshoots of the seventh | {overshoots} deg | {kvlcc2} |
{esso}

## Which trials to sail

- **Zigzags forecast zigzags.** The overshoots of the KVLCC2 are right to half a degree.
- **Hard turns need a circle.** A ship known from zigzags alone turns where no trial was. The interval of a circle is
  therefore wider. Where the rudder stalls beyond zigzags of 10 deg, intervals of 95 % hold {stalled} % of
  the indices ([kinds left out](case_studies/foreign_ships.md#kinds-left-out)).
- **Sail more than one kind of run, each from a steady speed.** Others show little of the model error: the Esso Osaka
  has wide intervals.
- **Small zigzags alone are the weakest trials.** Their intervals are the widest of the figure.
- **Record the wind and the revolutions where they vary** ([example](case_studies/esso_osaka.md)).
- **A second facility is almost a second ship.** Gear and approach differ;
  see [two towing tanks](case_studies/kvlcc2.md#from-one-facility-to-the-other).

[Design the next run](how_to/design_the_next_run.md) computes which run helps most for your ship.

## Probabilities

Beyond the motion of the trials a forecast states at most {cap} that a limit is met. Of {made} statements of 99 %,
{held} were right.

## Limits

No trial here is in shallow water or in waves. None has several screws or rudders. A ship unlike the hulls behind the
[priors](how_to/choose_a_prior.md) may err more than any ship here.
"""


def what_to_expect() -> str:
    """Text of ``docs/what_to_expect.md``."""
    population, summary = row("ships/tables/trials", "group", "all"), foreign_summary()
    held, made = (int(constants()[f"calibration_{word}"].value) for word in ("hits", "trials"))
    diameter = row("ships/tables/indices", "group", "turning circle, tactical diameter")
    return PAGE.format(
        trials="\n".join(trials_row(line) for line in table("ships/tables/trials") if line["group"] != "all"),
        share=f"{float(population['hold_95']):.1f}",
        indices=population["indices"],
        diameter=f"{float(diameter['median_error']):.2f}",
        cases=summary["cases"],
        stalled=stalled(),
        foreign_error=summary["error"],
        foreign_inside=summary["inside"],
        overshoots=" and ".join(f"{mean_overshoot_error(name):.2f}" for name in OVERSHOOTS),
        kvlcc2=inside_kvlcc2(),
        esso="\n".join(esso_row(line) for line in table("esso_osaka/indices")),
        cap=f"{(held + 1) / (made + 2):.3f}",  # Laplace's rule of succession
        made=made,
        held=held,
    )


def stalled() -> str:
    """Percentage of indices in intervals of 95 %, of ships with rudder stall known from zigzags of 10 deg."""
    ships = [line for line in table("left_out/tables/ships") if line["hull"] == "rudder stall"]
    return f"{np.mean([float(line['hold_95']) for line in ships if line['trials'] == '10/10 to both sides']):.0f}"


def trials_row(line: dict[str, str]) -> str:
    """Row of the table of a class of trials."""
    share = f"{float(line['hold_95']):.0f} ± {float(line['hold_95_se']):.0f}"
    return f"| {line['group']} | {share} | {float(line['median_error']):.3f} | {float(line['half_width']):.2f} |"


def esso_row(line: dict[str, str]) -> str:
    """Row of the table of the Esso Osaka, from some of the runs."""
    name = "[Esso Osaka](case_studies/esso_osaka.md), model in a windy pond"
    error = f"diameter {float(line['tactical_diameter_error']):.0f} %"
    return f"| {name} | {line['trials']} | {line['forecast']} | {error} | {line['inside']} of {line['indices']} |"


def mean_overshoot_error(name: str) -> float:
    """Mean error of an overshoot angle of the held-out zigzags of the KVLCC2 [deg]."""
    errors = [abs(float(line["error"])) for line in table("kvlcc2/tables/held_out_indices") if line["index"] == name]
    return float(np.mean(errors))


def inside_kvlcc2() -> str:
    """Indices of the KVLCC2 inside their intervals of 95 %."""
    z = [abs(float(line["z"])) for line in table("kvlcc2/tables/held_out_indices")]
    return f"{sum(value < 1.96 for value in z)} of {len(z)}"
