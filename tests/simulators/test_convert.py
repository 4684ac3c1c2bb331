"""Models of gz-sim: signs, frames, contradictions, and the way there and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import VehicleError
from seatrial.simulators import ImportedModel, export_model, import_model

FULL = """
format = 1
name = "full"
controllable = []
[environment]
rho_kg_m3 = 1020.0
g_m_s2 = 9.81
[geometry]
shape = "box"
length_m = 1.2
diameter_m = 0.6
height_m = 0.4
[coefficients]
m = 120.0
B = 1190.0
x_g = 0.02
y_g = -0.01
z_g = 0.05
x_b = 0.01
y_b = 0.005
z_b = -0.03
I_x = 6.0
I_y = 14.0
I_z = 15.0
I_xy = 0.3
I_xz = -0.4
I_yz = 0.2
X_udot = -20.0
Y_vdot = -60.0
Z_wdot = -90.0
K_pdot = -2.0
M_qdot = -8.0
N_rdot = -7.0
Y_rdot = 1.5
Z_qdot = -2.5
X_qdot = -0.7
X_u = -10.0
Y_v = -20.0
Z_w = -30.0
K_p = -1.0
M_q = -2.0
N_r = -3.0
Y_r = 2.0
M_w = -4.0
X_uu = -40.0
Y_vv = -80.0
Z_ww = -90.0
K_pp = -5.0
M_qq = -6.0
N_rr = -7.0
"""


def _write(tmp_path: Path, text: str, name: str = "model.sdf") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_law_a_vehicle_that_goes_there_and_back_moves_the_same(tmp_path: Path) -> None:
    """Every term with all cross terms; the numbers are written with nine digits."""
    vehicle = st.Vehicle.from_toml(FULL)
    made = export_model(vehicle)
    back = import_model(_write(tmp_path, made.text)).vehicle
    rng = np.random.default_rng(1)
    for _ in range(5):
        nu, tau = rng.normal(size=6), 50 * rng.normal(size=6)
        attitude = rng.normal(size=3)
        np.testing.assert_allclose(
            back.acceleration(nu, attitude, tau), vehicle.acceleration(nu, attitude, tau), rtol=0, atol=1e-6
        )


def test_frames_are_turned_and_not_copied(tmp_path: Path) -> None:
    """Cross terms of forward-left-up and forward-right-down differ in sign by axis pairs."""
    text = export_model(st.Vehicle.from_toml(FULL)).text
    assert "<yR>2</yR>" in text  # y and r both turn: the same sign
    assert "<mW>-4</mW>" in text
    assert "<xq>-0.7</xq>" in text  # -X_qdot = 0.7, x stays and q turns
    assert "<pose>0.02 0.01 -0.05 0 0 0</pose>" in text
    assert "<pose>0.01 -0.005 0.03 0 0 0</pose>" in text


GZ = """
<sdf version="1.9"><model name="rov">
  <link name="base_link">
    <inertial><mass>{mass}</mass><pose>0 0 -0.02 0 0 0</pose>
      <inertia><ixx>0.3</ixx><iyy>0.4</iyy><izz>0.5</izz></inertia></inertial>
    <collision name="hull"><pose>0 0 {cob} 0 0 0</pose>
      <geometry><box><size>0.4 0.3 0.1</size></box></geometry></collision>
  </link>
  <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
    <link_name>base_link</link_name><water_density>1000</water_density>
    {terms}
  </plugin>
</model></sdf>
"""
GOOD = (
    "<xDotU>-5</xDotU><yDotV>-6</yDotV><zDotW>-7</zDotW><kDotP>-0.1</kDotP><mDotQ>-0.2</mDotQ><nDotR>-0.3</nDotR>"
    + "".join(
        f"<{force}{velocity}abs{velocity}>-10</{force}{velocity}abs{velocity}>"
        for force, velocity in zip("xyzkmn", "UVWPQR", strict=True)
    )
)


def _gz(tmp_path: Path, terms: str = GOOD, mass: float = 12.0, cob: float = 0.01) -> ImportedModel:
    return import_model(_write(tmp_path, GZ.format(mass=mass, cob=cob, terms=terms)))


def test_derivatives_of_gz_sim_keep_their_signs(tmp_path: Path) -> None:
    model = _gz(tmp_path)
    given = model.vehicle.coefficients()
    assert (given["X_udot"], given["N_rdot"], given["X_uu"]) == (-5.0, -0.3, -10.0)
    assert given["z_g"] == pytest.approx(0.02)
    assert given["z_b"] == pytest.approx(-0.01)
    assert given["B"] == pytest.approx(1000 * 9.81 * 0.012)
    # About the link's origin: 12 kg at 2 cm.
    assert given["I_x"] == pytest.approx(0.3 + 12 * 0.02**2)
    assert model.contradictions == ()


def test_positive_added_mass_of_older_versions_is_understood_and_said(tmp_path: Path) -> None:
    model = _gz(
        tmp_path,
        GOOD
        .replace("Dot", "dot")
        .replace("-", "-")
        .replace("dot", "Dot")
        .replace("<xDotU>-5", "<xDotU>5")
        .replace("<yDotV>-6", "<yDotV>6")
        .replace("<zDotW>-7", "<zDotW>7")
        .replace("<kDotP>-0.1", "<kDotP>0.1")
        .replace("<mDotQ>-0.2", "<mDotQ>0.2")
        .replace("<nDotR>-0.3", "<nDotR>0.3"),
    )
    assert model.vehicle.coefficients()["X_udot"] == -5.0
    assert any("up to version 6" in sentence for sentence in model.left)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"terms": GOOD.replace("<xUabsU>-10", "<xUabsU>10")}, "quadratic damping in surge is +10"),
        ({"terms": GOOD.replace("<yDotV>-6", "<yDotV>6")}, "added mass in sway is -6"),
        (
            {"terms": GOOD + "<xDotV>-3</xDotV><yDotU>-1</yDotU>"},
            "added mass is not symmetric: entry 1,2 is -3, entry 2,1 -1",
        ),
        ({"terms": GOOD + "<xDotV>-9</xDotV><yDotU>-9</yDotU>"}, "added mass is not positive"),
        ({"mass": 15.0}, "differ by 20 %: the vehicle sinks"),
        ({"mass": 10.0}, "differ by 20 %: the vehicle rises"),
        ({"cob": -0.05}, "the centre of buoyancy is 0.03 m below that of gravity"),
        ({"terms": "<xU>-4</xU>"}, "there is no damping in sway, heave, roll, pitch, yaw"),
    ],
)
def test_contradictions_are_told(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    model = _gz(tmp_path, **change)
    assert any(words in sentence for sentence in model.contradictions), model.contradictions
    assert words.split(":")[0] in model.text.replace("\n", " ")
    # What feeds energy was turned.
    assert all(model.vehicle.coefficients().get(name, 0.0) <= 0.0 for name in ("X_uu", "X_u", "Y_vdot"))


def test_a_good_model_has_no_contradiction_and_its_report_says_so(tmp_path: Path) -> None:
    good, worst, _ = _gz(tmp_path).report().lines()
    assert "0 contradictions" in good
    assert "No contradiction was found" in worst


def test_products_of_velocities_and_other_plugins_are_said(tmp_path: Path) -> None:
    text = GZ.format(mass=12, cob=0.01, terms=GOOD + "<xVW>-3</xVW><xUU>-2</xUU>").replace(
        "</model>", '<plugin name="Thruster" filename="t"/></model>'
    )
    left = " ".join(import_model(_write(tmp_path, text)).left)
    assert "xUU, xVW" in left
    assert "Thruster" in left


def test_what_is_lost_is_said() -> None:
    lost = " ".join(export_model("lauv").lost)
    assert "Lift of the vehicle file" in lost
    assert "actuators with their motors" in lost
    head, _, rest = st.Vehicle.load("lauv").to_toml().partition("[coefficients]")
    table = "[tether]\nposition_m = [-1.0, 0.0, 0.0]\n[coefficients]\nA_tether = 0.1\n"
    assert (
        "The tether of the vehicle file (A_tether) has no counterpart."
        in export_model(st.Vehicle.from_toml(head + table + rest)).lost
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<sdf><model name='a'/></sdf>", "expected an SDF model with the plugin Hydrodynamics of gz-sim"),
        ("<robot><link name='a'/></robot>", "found <robot> without it; convert a URDF with gz sdf -p"),
        (GZ.format(mass="heavy", cob=0, terms=""), "<mass>: expected 1 finite numbers, found 'heavy'"),
        (GZ.format(mass="nan", cob=0, terms=""), "<mass>: expected 1 finite numbers"),
        (GZ.format(mass=-3, cob=0, terms=""), "expected a positive mass, found -3 kg"),
        (GZ.format(mass=1, cob=0, terms="").replace(">base_link<", ">hull<"), "expected a link 'hull'"),
    ],
)
def test_models_that_cannot_be_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        import_model(_write(tmp_path, text))


def test_the_verbs_write_a_vehicle_and_a_model(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from seatrial.cli import app

    run = CliRunner()
    model, vehicle = tmp_path / "rov.sdf", tmp_path / "rov.toml"
    made = run.invoke(app, ["export", "sdf", "bluerov2-heavy", "--out", str(model)])
    assert made.exit_code == 0
    assert made.stdout.startswith("bluerov2-heavy: written for gz-sim.")
    read = run.invoke(app, ["import", str(model), "--out", str(vehicle)])
    assert read.exit_code == 0
    assert "0 contradictions" in read.stdout
    assert st.Vehicle.load(vehicle).coefficients()["m"] == 13.5
    again = run.invoke(app, ["import", str(model), "--out", str(vehicle)])
    assert again.exit_code == 2
