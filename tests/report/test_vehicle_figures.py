"""Block diagrams and motor figures of a vehicle: they say what it has, in its numbers, and can be printed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.axes import Axes

from paper.actuators import actuator_diagram, rate_limiting, static_transfer
from paper.model import model_diagram, terms
from paper.plates import vehicle_plates
from seatrial._core import Vehicle
from seatrial.report.plot.performance import motors
from seatrial.report.plot.style import number, symbol
from tests.report.figures import CWOLF, MINUS, UNEVENLY, VEHICLES, assert_printable, texts


@pytest.mark.long
@pytest.mark.parametrize("name", VEHICLES)
def test_block_diagrams_of_any_vehicle_can_be_printed(name: str) -> None:
    assert_printable(model_diagram(VEHICLES[name]))
    if VEHICLES[name].actuators:
        assert_printable(actuator_diagram(VEHICLES[name]))


def test_model_diagram_names_what_the_vehicle_has_and_dashes_the_rest() -> None:
    values = CWOLF.coefficients()
    words = " ".join(texts(model_diagram(CWOLF)))
    for name in ("X_udot", "N_rdot", "K_p", "M_qq", "Y_uv", "N_ur"):
        assert symbol(name) in words
    assert f"$B$ = {number(values['B'], 4)} N" in words
    assert "(0, 0, 20) mm" in words  # z_g - z_b of the vehicle file
    assert "not given" not in words
    assert "lift: not given" in " ".join(texts(model_diagram(VEHICLES["beluga"])))
    absent = {term.key for term in terms(VEHICLES["bare"]) if term.absent}
    assert absent == {"added mass", "current", "damping", "lift"}
    assert terms(UNEVENLY)[-1].lines == ("constant bias: $X_{0}$",)


def test_signs_of_the_model_diagram_are_those_of_the_forces() -> None:
    signs = {term.key: -1.0 if term.sign == MINUS else 1.0 for term in terms(CWOLF)}
    values = CWOLF.coefficients()
    u, v = 1.5, 0.2
    forces = CWOLF.forces([u, v, 0.0, 0.0, 0.0, 0.0], [0.1, 0.0, 0.0])
    # D holds minus the derivatives, L the derivatives, g minus the restoring force and moment.
    damping = -(values["X_u"] * u + values["X_uu"] * abs(u) * u)
    assert signs["damping"] * damping == pytest.approx(forces["damping"][0], rel=1e-12)
    assert signs["lift"] * values["Y_uv"] * abs(u) * v == pytest.approx(forces["lift"][1], rel=1e-12)
    g_roll = (
        -values["B"] * values["z_b"] * math.sin(0.1)
    )  # equation 33 as corrected, x and y of the centres zero
    assert signs["restoring"] * g_roll == pytest.approx(forces["restoring"][3], rel=1e-12)
    # The Munk moment of -C_A nu_r in yaw: -(X_udot - Y_vdot) u v, destabilising for a slender hull.
    munk = -(-values["Y_vdot"] + values["X_udot"]) * u * v
    assert forces["added_mass"][5] == pytest.approx(munk, rel=1e-12)
    assert signs["rigid body"] == signs["added mass"] == -1.0
    assert signs["current"] == 1.0


def test_actuator_diagram_has_a_lane_per_group_with_the_numbers_of_the_chain() -> None:
    words = texts(actuator_diagram(CWOLF))
    for said in (
        *("stern", "vertical", f"$n_{{max}}$ {chr(177)}2000 rpm", f"$n_{{min}}$ {chr(177)}150 rpm"),
        *(
            "lifted to $n_{min}$",
            "$n_{acc}$ 2000 rpm/s",
            "$n_{dec}$ 4000 rpm/s",
            "$T_t$ 0.1 s",
            "$T_1$ 0.15 s",
        ),
        *(f"$p_2$ {MINUS}0.602 N s²/m", "$V_a = (1 - w)\\,u_a$, $w$ = 0.1"),
    ):
        assert said in words
    assert len(motors(CWOLF)) == 2
    uneven = " ".join(texts(actuator_diagram(UNEVENLY)))
    for said in (
        f"+300, {MINUS}250",
        f"+30, {MINUS}40",
        "dead band to $s_{min}$",
        "about 1500",
        "0.08, 0.0008",
    ):
        assert said in uneven
    # A gain that the identification changed is said, as a range where it is not the whole group's.
    assert "gain 1…1.1" in texts(actuator_diagram(CWOLF.with_coefficients({"SbU.gain": 1.1})))


def test_a_vehicle_without_actuators_has_no_diagram_of_them() -> None:
    with pytest.raises(ValueError, match="bare has no actuators"):
        actuator_diagram(VEHICLES["bare"])


def curves(axes: Axes) -> list[np.ndarray]:
    """Thick lines of a panel, as (n, 2)."""
    return [np.asarray(line.get_xydata()) for line in axes.get_lines() if line.get_linewidth() == 1.4]


@pytest.mark.parametrize(
    ("vehicle", "maximum", "minimum", "lifts"),
    [(CWOLF, (2000.0, 2000.0), (150.0, 150.0), True), (UNEVENLY, (300.0, 250.0), (30.0, 40.0), False)],
)
def test_static_transfer_is_the_papers(
    vehicle: Vehicle, maximum: tuple[float, float], minimum: tuple[float, float], lifts: bool
) -> None:
    figure = static_transfer(vehicle)
    panel = figure.axes[0]
    command, signal = np.concatenate(curves(panel)).T
    side = (command < 0.0).astype(int)
    top, low, size = np.array(maximum)[side], np.array(minimum)[side], np.abs(command)
    # Taubert et al. (2014), the cases beside figure 4; or zero inside a dead band.
    expected = np.where(size < low, low if lifts else 0.0, np.minimum(size, top))
    np.testing.assert_allclose(np.abs(signal), expected, rtol=1e-6)
    assert (signal * command >= 0.0).all()
    assert command.min() < -maximum[1]
    assert command.max() > maximum[0]
    words = " ".join(texts(figure))
    assert f"= {number(maximum[0], 4)}" in words
    assert f"= {number(-maximum[1], 4)}" in words
    assert ("lifted to" if lifts else "dead band to") in words


@pytest.mark.parametrize(("vehicle", "n_acc", "n_dec"), [(CWOLF, 2000.0, 4000.0), (UNEVENLY, 500.0, 900.0)])
def test_ramps_have_the_rates_of_the_motor_and_the_lag_follows(
    vehicle: Vehicle, n_acc: float, n_dec: float
) -> None:
    panel = rate_limiting(vehicle).axes[0]
    lines = {str(line.get_label()): np.asarray(line.get_xydata()) for line in panel.get_lines()}
    t, limited = lines["limited"].T
    slope, growing = np.diff(limited) / np.diff(t), np.diff(np.abs(limited)) > 0.0
    # Inside a ramp: the samples beside have the same slope, which those at a corner do not.
    inside = np.isclose(slope, np.roll(slope, 1)) & np.isclose(slope, np.roll(slope, -1)) & (slope != 0.0)
    assert min((inside & growing).sum(), (inside & ~growing).sum()) > 50
    np.testing.assert_allclose(np.abs(slope[inside & growing]), n_acc, rtol=1e-6)
    np.testing.assert_allclose(np.abs(slope[inside & ~growing]), n_dec, rtol=1e-6)
    motor = motors(vehicle)[0]
    late = np.argmax(lines["actual"][:, 1] > 0.5 * limited.max()) - np.argmax(limited > 0.5 * limited.max())
    # A ramp's lag behind PT1 and dead time is T_1 + T_t once it has settled, less at its beginning.
    assert motor.T_t < late * (t[1] - t[0]) < motor.T_t + 1.2 * motor.T_1
    words = " ".join(texts(panel.figure))  # type: ignore[arg-type]
    assert f"_{{acc}}$ =\n{number(n_acc)} {motor.printed_unit}/s" in words


def test_the_rates_of_ramps_stand_clear_of_each_other_and_of_the_next_step() -> None:
    figure = rate_limiting(CWOLF)
    figure.draw_without_rendering()
    for panel in figure.axes:
        boxes = [text.get_window_extent() for text in panel.texts if "=" in text.get_text()]
        assert len(boxes) == 3
        for k, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[k + 1 :])
        (desired,) = (line for line in panel.get_lines() if line.get_label() == "desired")
        t, command = np.asarray(desired.get_xydata()).T
        steps = [panel.transData.transform((t[k], 0.0))[0] for k in np.flatnonzero(np.diff(command))]
        assert boxes[0].x1 < steps[1]
        assert boxes[2].x1 < steps[2]


def test_motors_without_limits_or_lag_are_left_out_in_words() -> None:
    direct = VEHICLES["direct"]
    with pytest.raises(ValueError, match="no motor of direct has a static limit"):
        static_transfer(direct)
    with pytest.raises(ValueError, match="follows its command at once"):
        rate_limiting(direct)
    plates = {plate.name: plate for plate in vehicle_plates(direct, data="")}
    assert plates["static_transfer"].draw is None
    assert plates["rate_limiting"].draw is None
    assert plates["actuators"].draw is not None
