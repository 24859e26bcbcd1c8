"""An impossible number in a vessel file is refused, an unusual one is reported."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.physics.vessel.plausibility import findings, remarks

MODELS = Path(__file__).parents[3] / "models"


@pytest.fixture
def with_slip(tmp_path):
    """Write a shipped vessel with one key of another value; return its path."""

    def write(ship, key, value):
        text = (MODELS / f"{ship}.toml").read_text()
        pattern = rf"^({key} = (?:\{{ value = )?)[-+.\de]+"
        text, count = re.subn(pattern, lambda found: found[1] + value, text, count=1, flags=re.MULTILINE)
        assert count == 1
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    ("ship", "key", "value", "excerpt"),
    [
        (
            "container",
            "m",
            "0",
            "inertia.m = 0 gives m L^3/(2 volume) = 0, which must lie between 0.6667 and 1.5; perhaps",
        ),
        ("container", "m", "-0.0075", "m L^3/(2 volume) = -0.999"),
        (
            "kvlcc2",
            "m",
            "2.2e7",
            "m L^3/(2 volume) = 1.15e+09, which must lie between 0.6667 and 1.5; perhaps it is in kg",
        ),
        ("kvlcc2", "m", "0.19081", "m L^3/(2 volume) = 10,"),
        ("kvlcc2", "m", "0.0095405", "m L^3/(2 volume) = 0.5,"),
        ("container", "I_zz", "0", "inertia.I_zz = 0 gives"),
        ("container", "I_zz", "-43e-5", "which must lie between 0.1 and 0.5; perhaps it is in kg m2"),
        ("container", "I_xx", "1.3e-3", "the radius of gyration over B = 3,"),
        ("container", "I_xx", "0", "inertia.I_xx = 0 gives"),
        ("container", "volume", "460.7", "volume/(L B^2) = 0.00195"),
        ("kvlcc2", "volume", "3126.22", "the block coefficient volume/(L B d) = 0.0081"),
        ("kvlcc2", "volume", "400000", "the block coefficient volume/(L B d) = 1.04"),
        ("kvlcc2", "volume", "-1", "particulars.volume = -1 gives"),
        ("kvlcc2", "d", "-20.8", "particulars.d = -20.8 gives B/d = -2.79"),
        ("kvlcc2", "L", "320000", "L = 320000, which must lie between 0.1 and 1000; perhaps it is in mm or km"),
        ("kvlcc2", "L", "0", "particulars.L = 0, which must lie"),
        ("kvlcc2", "B", "58000", "gives L/B = 0.00552"),
        ("kvlcc2", "B", "0", "gives L/B = inf"),
        ("kvlcc2", "nominal_speed", "7974", "the Froude number U/sqrt(g L) = 142"),
        ("kvlcc2", "nominal_speed", "-1", "the Froude number U/sqrt(g L) = -0.0178"),
        ("kvlcc2", "rudder_rate_deg", "-2", "the rudder angle moved in L/U [deg] = -80.3"),
        ("kvlcc2", "rudder_delay", "-1", "the delay over L/U = -0.0249"),
        ("kvlcc2", "rudder_delay", "2500", "perhaps it is in ms"),
        ("kvlcc2", "x_G", "11136", "gives x_G/L = 34.8"),
        ("container", "z_G", "-354", "gives z_G/B = -11.1"),
        ("container", "GM", "1e308", "GM = 1e+308 gives GM/B = 3.13e+306"),
        ("container", "GM", "830", "perhaps it is in mm"),
        ("container", "BM", "0", "BM volume/(L B^3) = 0,"),
        ("container", "BM", "35", "which must lie between 0.005 and 0.1; perhaps it is KM"),
        ("kvlcc2", "Xudot", "0.00143", "gives -Xudot/m = -0.0749"),
        ("kvlcc2", "Yvdot", "0.014495", "perhaps it is m_x, m_y or J_z, of the other sign"),
        ("kvlcc2", "Yvdot", "-0.223", "gives -Yvdot/m = 11.7, which must lie between 0.01 and 8"),
        ("kvlcc2", "Nrdot", "-0.011", "gives -Nrdot/I_zz = 9.33"),
        ("container", "Nrdot", "0", "gives -Nrdot/I_zz"),
        ("container", "Yrdot", "-4810e-5", "added_mass.Yrdot = -0.0481 gives its size over the root of both inertias"),
        ("container", "Kpdot", "0.7e-5", "gives -Kpdot/I_xx = -0.538"),
        (
            "kvlcc2",
            "n",
            "90.8",
            "the advance ratio (1 - w) U/(n D) = 0.00565, which must lie between 0.03 and 4; perhaps it",
        ),
        ("kvlcc2", "n", "0", "the advance ratio (1 - w) U/(n D) = inf"),
        ("kvlcc2", "D", "9326", "gives D/L = 29.1"),
        ("kvlcc2", "wake_fraction", "40", "perhaps it is in %"),
        ("kvlcc2", "k_1", "-2.7", "K_T at the nominal speed = -0.58,"),
        ("kvlcc2", "eta", "1.7", "perhaps it is the height over the diameter"),
        ("kvlcc2", "kappa", "-0.5", "propeller.kappa = -0.5, which must lie between 0 and 3"),
        ("container", "Yv", "1e308", "coefficients.sway.Yv = 1e+308, which must lie"),
    ],
)
def test_an_impossible_number_is_refused(with_slip, ship, key, value, excerpt):
    path = with_slip(ship, key, value)
    with pytest.raises(ps.VesselError) as error:
        ps.load_vessel(path)
    sentence = str(error.value)
    assert sentence.startswith(f"{path}: ")
    assert excerpt in sentence
    assert sentence.endswith(".")


@pytest.mark.parametrize(
    ("ship", "key", "value", "excerpt"),
    [
        (
            "container",
            "nominal_speed",
            "24.7",
            "the Froude number U/sqrt(g L) = 0.519, which usually lies between 0.02 and",
        ),
        (
            "kvlcc2",
            "nominal_speed",
            "15.5",
            "of this block coefficient = 1.72, which usually lies between 0 and 1.394;",
        ),
        ("kvlcc2", "m", "0.0202", "m L^3/(2 volume) = 1.06, which usually lies between 0.95 and 1.05"),
        ("kvlcc2", "rudder_rate_deg", "0.041", "perhaps it is in rad/s"),
        ("kvlcc2", "rudder_rate_deg", "140", "in deg/min"),
        ("kvlcc2", "k_1", "0.27", "perhaps it has lost its minus"),
        ("kvlcc2", "Yvdot", "-0.0072", "Yvdot over that of Motora's charts = 0.494"),
        ("container", "GM", "-0.1", "its sign is wrong"),
        ("container", "BM", "0.9", "perhaps it is KM or GM"),
        ("container", "Kpdot", "0", "gives -Kpdot/I_xx = 0, which usually lies between 0.02 and 1.5"),
        ("container", "Yv", "-725", "perhaps a factor such as 1e-5 is missing"),
    ],
)
def test_an_unusual_number_is_reported_and_accepted(with_slip, ship, key, value, excerpt):
    (finding,) = findings(ps.load_vessel(with_slip(ship, key, value)))
    assert not finding.impossible
    assert finding.key.endswith(f".{key}")
    assert excerpt in finding.sentence


def test_a_number_that_was_derived_is_not_called_doubtful():
    vessel = ps.load_vessel("kvlcc2")
    slender = replace(vessel, added_mass=vessel.added_mass | {"Yvdot": -0.0072})
    assert [finding.key for finding in findings(slender)] == ["added_mass.Yvdot"]
    assert findings(replace(slender, derived={"added_mass.Yvdot": "-0.0072"})) == []


def test_masses_that_make_a_negative_kinetic_energy_are_impossible(container):
    """Each coupling is below the root of its inertias, all of them together are not."""
    couplings = {"Yrdot": 2e-3, "Nvdot": 2e-3, "Ypdot": 3e-4, "Kvdot": 3e-4, "Npdot": 1e-4, "Krdot": 1e-4}
    vessel = replace(container, added_mass=container.added_mass | couplings)
    (finding,) = [finding for finding in findings(vessel) if finding.impossible]
    assert finding.sentence.startswith("inertia and added_mass give a negative kinetic energy")


# the commands ---------------------------------------------------------------------------------------------------------


def simulated(path, capsys, *words):
    out = path.with_suffix(".csv")
    words = ["simulate", str(path), "--turn", "35", "--duration", "5", "--out", str(out), *words]
    return main(words), capsys.readouterr().err, out


def test_a_command_says_what_is_doubtful_and_goes_on(with_slip, capsys):
    path = with_slip("kvlcc2", "nominal_speed", "15.5")
    status, message, out = simulated(path, capsys)
    assert status == 0
    assert f"{path}: particulars.nominal_speed = 15.5 gives" in message
    assert out.exists()
    assert simulated(path, capsys, "--quiet")[1] == ""


def test_a_command_says_what_was_derived(with_slip, capsys):
    path = with_slip("kvlcc2", "m", "0.019081")
    path.write_text(path.read_text().replace("m = 0.019081\n", ""))
    message = "Estimated, because the vessel file does not state it: inertia.m = 0.019081 (2 volume/L^3)."
    assert remarks(ps.load_vessel(path)) == [message]
    assert f"{path}: {message}" in simulated(path, capsys)[1]


def test_a_command_refuses_what_is_impossible(with_slip, capsys):
    status, message, out = simulated(with_slip("kvlcc2", "n", "90.8"), capsys)
    assert status == 2
    assert "propeller.n = 90.8 gives the advance ratio" in message
    assert "Traceback" not in message
    assert not out.exists()


def test_a_command_that_needs_a_model_asks_for_it_before_it_writes(with_slip, capsys):
    path = with_slip("kvlcc2", "kappa", "0.5")
    path.write_text(path.read_text().split("[coefficients.sway]")[0])
    status, message, out = simulated(path, capsys, "--quiet")
    assert status == 2
    assert message.startswith(
        "pymc-ship: The model of 'kvlcc2' needs coefficients of sway, found none; identify them with"
    )
    folder = path.with_name("study")
    assert main(["study", "--vessel", str(path), "--out", str(folder), "--quiet"]) == 2
    assert not out.exists()
    assert not folder.exists()
