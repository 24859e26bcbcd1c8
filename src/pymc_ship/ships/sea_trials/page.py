"""The page of a sea trial: the form of IMO MSC/Circ.1053, conditions, corrections with their uncertainty, figures."""

from pathlib import Path

from pymc_ship.machine.arguments import check_kind
from pymc_ship.machine.errors import TrialError
from pymc_ship.pages.page import Content, Page, write_page
from pymc_ship.pages.tables import at_least, fixed_point, heads, number, table
from pymc_ship.ships.sea_trials.figures import circles, spirals, swings
from pymc_ship.ships.sea_trials.sea_trial import SeaTrial
from pymc_ship.trial.quality_flags import quality_remarks

PAGE = Page(  # its folder may hold the page of an identification, too
    "sea_trial.html",
    Path(__file__).with_name("page.html.j2"),
    own=("figures/sea_trial_*.png", "tables/sea_trial_*.csv"),
    packages=("pymc-ship", "numpy", "scipy", "pywavelets", "xarray", "matplotlib"),
)

SOURCES = (
    "IMO (2002), Standards for ship manoeuvrability, resolution MSC.137(76).",
    "IMO (2002), Explanatory notes to the standards for ship manoeuvrability, MSC/Circ.1053.",
    "JCGM 100:2008, Evaluation of measurement data: guide to the expression of uncertainty in measurement.",
)

_INDEX = heads(str, run="run", manoeuvre="manoeuvre", index="index", units="")
_VALUES = (
    heads(fixed_point(2), raw="as measured", without_current="without drift")
    | heads(fixed_point(3), ratio="F / B")
    | heads(fixed_point(2), corrected="result")
    | heads(str, corrected_for="corrected for")
    | heads(at_least(2), U="U (k = 2)")
    | heads(fixed_point(2), lower="95 % from", upper="to")
    | heads(number(3), limit="limit")
    | heads(str, conformity="conformity")
)
_PARTS = heads(at_least(3), u_record="record", u_current="drift", u_model="model", u_runs="runs", u_c="u_c")
_CURRENT = (
    heads(str, run="run")
    | heads(number(2), speed="speed [m/s]")
    | heads(fixed_point(0), direction="to [deg]")
    | heads(number(2), u_north="u, north [m/s]", u_east="u, east [m/s]")
    | heads(str, pairs="pairs")
)
_WIND = heads(str, run="run") | heads(fixed_point(1), speed="speed [m/s]") | heads(fixed_point(0), origin="from [deg]")


def trial_report(result: SeaTrial, out: str | Path, *, command: str = "pymc_ship.trial_report(...)") -> Path:
    """Write the report of a sea trial.

    Parameters
    ----------
    result : SeaTrial
        From :func:`pymc_ship.sea_trial`.
    out : str or Path
        Folder, created where it is missing.
    command : str, optional
        Command that repeats the page.

    Returns
    -------
    Path
        ``out/sea_trial.html``; its figures and tables are in folders there.

    Raises
    ------
    OutputError
        When the folder cannot be written.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> circle = ps.simulate(vessel, ps.turning_circle(35), duration=2400, step=0.5, current=(0.5, 90))
    >>> print(ps.trial_report(ps.sea_trial({"circle": circle}, vessel, rng=1), "report").name)
    sea_trial.html
    """
    check_kind("The result", result, SeaTrial, "make it by ps.sea_trial", TrialError)
    index_rows = [row | {"index": row["index"].replace("_", " ")} for row in result.indices]
    flows = [
        {"run": name, "speed": current.speed, "direction": current.direction}
        | {"u_north": current.sd[0], "u_east": current.sd[1], "pairs": len(current.local)}
        for name, current in result.currents.items()
    ]
    winds = [{"run": name, "speed": speed, "origin": origin % 360.0} for name, (speed, origin) in result.winds.items()]
    records = {name: result.trials[name] for name in result.manoeuvres}
    turning = {name: trial for name, trial in records.items() if result.manoeuvres[name].traits.circles}
    content = {
        "vessel": result.vessel,
        "command": command,
        "remarks": result.remarks,
        "identified": result.turns is not None,
        "forecast": any(row["ratio"] != 1.0 for row in result.indices),
        "shared": any(name not in turning for name in result.currents),
        "doubtful": [name for name, trial in result.trials.items() if quality_remarks({name: trial})],
        "lines": [row for row in result.form if row["conformity"]],
        "tables": {
            "ship": table(result.ship_data, heads(str, item="item", value="")),
            "form": table(result.form, {key: (key, str) for key in result.form[0]}),
            "conditions": table(result.conditions, {key: (key, str) for key in result.conditions[0]}),
            "indices": table(index_rows, _INDEX | _VALUES),
            "parts": table(index_rows, _INDEX | _PARTS),
            "currents": table(flows, _CURRENT),
            "winds": table(winds, _WIND),
        },
    }
    swinging = {name: trial for name, trial in records.items() if result.manoeuvres[name].traits.swings}
    figures = {}
    if turning:
        figures["sea_trial_circles"] = circles(turning, result.currents, result.vessel.particulars.L)
    if swinging:
        switching = {name: result.manoeuvres[name].heading_deg for name in swinging}
        figures["sea_trial_zigzags"] = swings(swinging, switching)
    if result.spirals:
        figures["sea_trial_spirals"] = spirals(result.spirals, result.turns)
    rows = {"sea_trial_indices": result.indices, "sea_trial_form": [*result.ship_data, *result.form]}
    rows |= {"sea_trial_conditions": result.conditions, "sea_trial_currents": flows}
    return write_page(PAGE, out, Content(content, figures, rows, sources=SOURCES))
