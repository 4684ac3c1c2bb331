"""What kind of data a trial is, in a few sentences, the worst first.

Contact, saturated commands, closed loops, waves, axes that hardly move, then what was done and what to hold
out. Held by ``tests/intake/test_kind_of_data.py``.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from seatrial.base.channels import readable
from seatrial.intake.excitation import (
    Contact,
    Excess,
    Excitation,
    Saturation,
    contacts,
    excesses,
    excitation,
    saturation,
)
from seatrial.intake.manoeuvres import Manoeuvre, counted, drives, manoeuvres
from seatrial.intake.trial_windows import TrialWindows, windows
from seatrial.intake.wiring import Wiring, wiring
from seatrial.trial.feedback import Feedback, feedback
from seatrial.trial.verdict import Verdict, judge_trial
from seatrial.trial.waves import Waves, commanded, waves

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class KindOfData:
    """What a trial holds and what spoils it.

    Attributes
    ----------
    contacts, saturated, beyond, loops, waves, excitation
        What may spoil an identification: parts in which the vehicle was held, commands at their limits,
        commands beyond what an actuator can do, commands that follow measurements, waves, and how much each
        axis moves.
    verdicts
        Whether it tells how an axis answers its commands, the worst first; empty without a vehicle.
    manoeuvres, windows
        What was done, and the proposed hold-out.
    """

    contacts: tuple[Contact, ...]
    saturated: tuple[Saturation, ...]
    beyond: tuple[Excess, ...]
    loops: tuple[Feedback, ...]
    verdicts: tuple[Verdict, ...]
    waves: Waves | None
    excitation: tuple[Excitation, ...]
    manoeuvres: tuple[Manoeuvre, ...]
    windows: TrialWindows
    wiring: Wiring | None = None

    @property
    def impossible(self) -> tuple[str, ...]:
        """How commands contradict the vehicle: their wiring, and values that no actuator follows."""
        wired = () if self.wiring is None else (self.wiring.sentence,)
        return wired + tuple(
            f"command of {one.command} reaches {one.reached:g}, and its limit is {one.limit:g} (beyond it in"
            f" {100.0 * one.share:.0f} % of the samples); check the unit of the column and the limits in the"
            " vehicle file"
            for one in self.beyond
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What spoils the data, the worst first, with what to do about it."""
        held = [
            f"{one.sentence}. Leave this part out: split the trial or hold it out" for one in self.contacts
        ]
        said = [*self.impossible, *held]
        dominated = [one.sentence for one in self.verdicts if one.dominated]
        return tuple(said + dominated + _loops(self.loops) + _waves(self.waves) + _saturated(self.saturated))

    @property
    def weak(self) -> tuple[Excitation, ...]:
        """Axes that hardly move more than their noise."""
        return tuple(one for one in self.excitation if one.weak)

    @property
    def still(self) -> bool:
        """Whether no axis moves clearly."""
        return bool(self.excitation) and len(self.weak) == len(self.excitation)

    @property
    def done(self) -> str:
        """What was done and what moved, in a sentence."""
        moved = ", ".join(one.channel for one in self.excitation if not one.weak)
        return f"{counted(self.manoeuvres) or 'no manoeuvre found'}; {moved or 'nothing'} moved clearly"

    @property
    def sentences(self) -> tuple[str, ...]:
        """`warnings`, then what was done and the proposed hold-out."""
        return (*self.warnings, self.done, self.windows.sentence)

    @property
    def details(self) -> tuple[str, ...]:
        """What its loops tell, how much each axis moves, and every manoeuvre."""
        return (
            *(one.sentence for one in self.verdicts if not one.dominated),
            *(one.sentence for one in self.excitation),
            *(one.sentence for one in self.manoeuvres),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "contacts": [asdict(one) for one in self.contacts],
            "saturated": [asdict(one) for one in self.saturated],
            "beyond": [asdict(one) for one in self.beyond],
            "wiring": None if self.wiring is None else self.wiring.to_dict(),
            "closed_loops": [asdict(one) for one in self.loops],
            "feedback": [asdict(one) | {"sentence": one.sentence} for one in self.verdicts],
            "waves": None if self.waves is None else asdict(self.waves),
            "excitation": [asdict(one) for one in self.excitation],
            "manoeuvres": [asdict(one) for one in self.manoeuvres],
            "windows": asdict(self.windows),
            "sentences": list(self.sentences),
        }


def kind_of_data(trial: Trial, vehicle: Vehicle | None = None) -> KindOfData:
    """What a trial holds and what spoils it.

    Parameters
    ----------
    trial
        On its uniform time base.
    vehicle
        Gives the wrench and the limits of recorded commands.
    """
    driving = drives(trial, vehicle)
    found = manoeuvres(trial, vehicle)
    every = feedback(trial)
    loops = tuple(one for one in every if one.closed)
    swell = waves(trial)
    if swell is not None and not loops and commanded(trial, swell):
        swell = None  # a row of preset steps has harmonics
    return KindOfData(
        contacts=tuple(contacts(trial, driving)),
        saturated=tuple(saturation(trial, vehicle)),
        beyond=tuple(excesses(trial, vehicle)),
        loops=loops,
        verdicts=() if vehicle is None else tuple(judge_trial(trial, vehicle).values()),
        waves=swell,
        excitation=tuple(excitation(trial)),
        manoeuvres=tuple(found),
        windows=windows(trial, found),
        wiring=None if vehicle is None else wiring(trial, vehicle, loops=every),
    )


def _loops(loops: tuple[Feedback, ...]) -> list[str]:
    if not loops:
        return []
    follows = "; ".join(
        f"{one.command} follows {one.channel} ({100.0 * one.explained:.0f} % of its changes)"
        for one in sorted(loops, key=lambda one: -one.explained)
    )
    return [
        f"recorded in closed loop: {follows}. A fit on such data may bias gains and damping, and its score"
        " also rates the controller: add a trial with preset steps of these commands"
    ]


def _waves(found: Waves | None) -> list[str]:
    if found is None:
        return []
    sizes = ", ".join(f"{c} {readable(c)[0] * a:.2g} {readable(c)[1]}" for c, a in found.amplitude.items())
    if not found.line:
        return [
            f"motion about a period of {found.period_s:.1f} s (amplitude {sizes}) that a crude regression on"
            " state and commands leaves unexplained: perhaps waves, which a model takes for its own error,"
            " perhaps motion that the vehicle's model explains. In calm water ignore it"
        ]
    return [
        f"an oscillation with a period of {found.period_s:.1f} s, as of waves (amplitude {sizes}), which"
        " no command explains; the model takes it for its own error"
    ]


def _saturated(found: tuple[Saturation, ...]) -> list[str]:
    if not found:
        return []
    parts = ", ".join(f"{one.command} at {one.limit:g} in {100.0 * one.share:.0f} %" for one in found)
    return [
        f"commands at their limits, where the loop is open and the motor tells no more: {parts} of the time"
    ]
