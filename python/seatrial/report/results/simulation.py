"""The words of a simulated run: how far and fast it went, and what it does not show.

Held by ``tests/trial/test_simulation.py``.
"""

from __future__ import annotations

from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table
from seatrial.trial.simulation import SETTINGS, SimulatedTrial

_DECIMALS = {"s": 1, "m": 2, "m/s": 3, "deg": 1}


def report(made: SimulatedTrial, title: str, next_step: str) -> Report:
    """Three lines and a table of the whole run."""
    summary = made.summary()
    rows = [(name, _cell(name, value)) for name, value in summary.items()]
    return Report(
        title=title,
        outcome="simulated",
        good=(
            f"{summary['distance, m']:.1f} m in {summary['duration, s']:.1f} s, largest speed"
            f" {summary['largest speed, m/s']:.3f} m/s"
        ),
        worst="; ".join(map(problem, made.findings()))
        or "nothing stands out: the run is finite and stays below the surface",
        next_step=next_step,
        sections=(Section(tables=(Table.of("Whole run", ("quantity", "value"), rows),)),),
    )


def problem(finding: Finding) -> str:
    """A finding of a simulated run, a clause."""
    if finding.kind == "leaves the water":
        return (
            f"the vehicle rises {finding['rise_m']:.2f} m above the surface, of which the run knows nothing;"
            " state it (--surface 0), or start deeper, with a column z_m"
        )
    if finding.kind == "no load cell":
        return "the pull of the tied vehicle is not in the log: these sensors have no load_cell"
    return _clipped(finding)


def _clipped(finding: Finding) -> str:
    unit, neutral = finding["unit"], finding["neutral"]
    at = f" about {neutral:g}" if neutral else ""
    others = finding["others"]
    return (
        f"{100.0 * finding['share']:.0f} % of the commands of {finding.subject} are beyond its limit of"
        f" {finding['limit']:g} {unit}{at} and are held there, the largest is"
        f" {neutral + finding['largest']:g} {unit}{_other_unit(finding)}"
        + (f"; so are commands of {', '.join(others)}" if others else "")
    )


def _other_unit(finding: Finding) -> str:
    """Which unit a command may be in that no actuator of this one takes."""
    largest = abs(finding["largest"])
    if finding["unit"] == "rad" and largest > SETTINGS.no_angle_rad:
        return ": are these degrees?"
    if finding["unit"] == "N" and largest > SETTINGS.no_force * finding["limit"]:
        return ": are these revolutions per minute?"
    return ""


def _cell(name: str, value: float) -> str:
    """A quantity of the summary with the decimals that its unit deserves; no minus before zero."""
    decimals = _DECIMALS[name.rsplit(", ", 1)[1]]
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
