"""What logs hold and what their fields are taken for: one pass over each file, no sample is kept.

Of several fields that may be one quantity the best is chosen: documented before guessed, moving before
constant, and all components of a vector from one topic (``tests/intake/test_import.py``). A driver may fill a
message in the axes of its chip instead of those that the format states: an accelerometer at rest shows -g
(Titterton and Weston 2004, section 3.4), so its mean tells which way z points
(``tests/logs/test_gravity.py``).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from os.path import realpath
from pathlib import Path
from typing import Any, NamedTuple

from seatrial.base.budget import Budget, guarded, size_of
from seatrial.base.errors import TrialError, printable
from seatrial.base.report import Reported
from seatrial.base.work import callers_errors_pass
from seatrial.logs.log import FORMATS, Event, Field, Log, Note, Share, Topic, open_log
from seatrial.logs.recognise import RECOGNITION_SETTINGS, Proposal, named_but_empty, propose, unknown_unit

_VERTICAL = re.compile(
    r"(.*\.)?(linear_acceleration\.z|accel(eration)?\.z|AccZ|zacc|accelerometer_m_s2\[2\])", re.IGNORECASE
)
"""Fields of documented messages that hold the accelerometer's z."""

_G = 9.81  # m/s^2


@dataclass(frozen=True)
class SurveySettings:
    """When the mean of an accelerometer tells which way its axis points."""

    least_g: float = 0.7  #: g: a smaller mean has another unit, or tells of no upright vehicle
    most_g: float = 1.3  #: g: a larger one, too
    steady_share: float = 0.5  #: of the mean: with a larger deviation the vehicle tumbles


SETTINGS = SurveySettings()


_BODY = ("p_deg_s", "q_deg_s", "r_deg_s", "u_m_s", "v_m_s", "w_m_s")

_Q = ("q_w", "q_x", "q_y", "q_z")

_DOCUMENTED = ("dataflash", "mavlink", "ulog", "rosbag", "mcap")
"""Formats whose messages state the sense of their accelerometer; in a table it may be gravity itself."""


def points_down(field: Field) -> bool | None:
    """Whether the z of an accelerometer points down; None where its mean is not that of gravity.

    Examples
    --------
    >>> points_down(Field("linear_acceleration.z", "", 500, -10.4, -9.2, -9.79, 0.2, 0.0))
    True
    """
    for unit in (_G, 1.0, 1000.0):  # m/s^2, g, mg
        size = abs(field.mean) / unit
        if SETTINGS.least_g < size < SETTINGS.most_g and field.deviation < SETTINGS.steady_share * abs(
            field.mean
        ):
            return field.mean < 0.0
    return None


def by_gravity(format: str, topics: Sequence[Topic], proposals: Iterable[Proposal]) -> Iterator[Proposal]:
    """The proposals with the body frame and the vertical of an attitude that gravity shows in the message."""
    fields = {topic.name: {field.name: field for field in topic.fields} for topic in topics}
    down = {name: _down(own) for name, own in fields.items()} if format in _DOCUMENTED else {}
    for proposal in proposals:
        shown = down.get(proposal.topic)
        if shown is None or not (proposal.canonical in _BODY or proposal.canonical in _Q):
            yield proposal
            continue
        body = "FRD" if shown else "FLU"
        if proposal.canonical in _BODY:
            frame, stated = ("" if shown else "FLU"), proposal.frame or "FRD"
            differs = stated != body
        else:
            stated = proposal.frame or "FRD/NED"
            frame = f"{body}/{_earth(fields[proposal.topic], proposal, found_down=shown, stated=stated)}"
            differs = frame != stated
            frame = "" if frame == "FRD/NED" else frame
        if not differs:
            yield proposal
            continue
        sense = "down" if shown else "up"
        why = f"{proposal.why} in {stated}, but its accelerometer's z points {sense}: {frame or 'FRD, NED'}"
        yield replace(proposal, frame=frame, why=why, certain=False)


def _down(fields: Mapping[str, Field]) -> bool | None:
    vertical = [field for name, field in fields.items() if _VERTICAL.fullmatch(name)]
    return points_down(vertical[0]) if len(vertical) == 1 else None


def _earth(fields: Mapping[str, Field], proposal: Proposal, *, found_down: bool, stated: str) -> str:
    """Earth frame of a quaternion whose body z points down or up: by the mean of the vertical's cosine.

    Of a unit quaternion that is the mean of w^2 - x^2 - y^2 + z^2, positive where both verticals point alike.
    """
    name = proposal.name
    stem = name[:-1]  # orientation.w: the last letter names the component
    parts = [fields.get(f"{stem}{axis}") for axis in "wxyz"]
    earth = stated.partition("/")[2]
    if not name.endswith(("w", "x", "y", "z")) or any(part is None for part in parts):
        return earth
    squares = [part.mean**2 + part.deviation**2 for part in parts if part is not None]
    alike = squares[0] - squares[1] - squares[2] + squares[3] > 0.0
    if found_down == alike:
        return "NED"
    return earth if earth in ("ENU", "NWU") else "ENU"


_VECTORS = (
    ("x_m", "y_m"),
    ("z_m",),
    ("q_w", "q_x", "q_y", "q_z"),
    ("roll_deg", "pitch_deg", "yaw_deg"),
    ("u_m_s", "v_m_s", "w_m_s"),
    ("u_water_m_s", "v_water_m_s", "w_water_m_s"),
    ("p_deg_s", "q_deg_s", "r_deg_s"),
    ("tau.X_n", "tau.Y_n", "tau.Z_n"),
    ("tau.K_nm", "tau.M_nm", "tau.N_nm"),
    ("current_north_m_s", "current_east_m_s", "current_down_m_s"),
)
"""Columns that one topic must give together."""


class Unused(NamedTuple):
    """A field whose name is that of a canonical column and that holds too few numbers: what, and why."""

    canonical: str
    topic: str
    name: str
    why: Note


@dataclass(frozen=True)
class SurveyedLog:
    """One log: what its topics hold, what its fields may be, what it says besides."""

    #: The file and its format (`seatrial.logs.log`).
    path: Path
    format: str
    topics: tuple[Topic, ...]  #: With samples; stamps in s of the log's own clock.
    proposals: tuple[Proposal, ...]  #: For all fields, the better one of each canonical column first.
    notes: tuple[str, ...]  #: What could not be read.
    remarks: tuple[str, ...]  #: How something was read that the log does not state.
    events: tuple[Event, ...]  #: Changes of mode and messages.
    parameters: Mapping[str, float]  #: Of the vehicle, by name.
    epoch_s: float | None  #: Unix time of the log's time zero, s; None where it does not say.
    unused: tuple[Unused, ...] = ()  #: Fields that hold too few numbers.

    def field(self, proposal: Proposal) -> tuple[Topic, Field]:
        """Topic and field of a proposal."""
        topic = next(topic for topic in self.topics if topic.name == proposal.topic)
        return topic, next(field for field in topic.fields if field.name == proposal.name)

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last stamp of any topic, s."""
        known = [topic for topic in self.topics if topic.end_s >= topic.start_s]
        if not known:
            return 0.0, 0.0
        return min(topic.start_s for topic in known), max(topic.end_s for topic in known)

    @property
    def not_underwater(self) -> str:
        """Why the vehicle is none under water, by what the log says; "" where it does not."""
        for event in self.events:
            named = re.search(r"\b(Ardu)?(Copter|Plane|Rover)\b", event.text)
            if event.kind == "message" and named:
                return f"the autopilot is {named[0]}"
        kind = self.parameters.get("MAV_TYPE")
        if self.format == "ulog" and kind is not None and kind != _SUBMARINE:
            return f"MAV_TYPE is {kind:g}{_MAV_TYPES.get(int(kind), '')}, not {_SUBMARINE} (submarine)"
        airborne = {"vehicle_land_detected", "vehicle_air_data", "airspeed"}
        if self.format == "ulog" and airborne & {topic.name for topic in self.topics}:
            return "PX4 logged a land detector or air data"
        return ""


_SUBMARINE = 12  # MAV_TYPE_SUBMARINE of MAVLink
_MAV_TYPES = {1: " (aeroplane)", 2: " (quadrotor)", 10: " (ground rover)", 11: " (boat)", 13: " (hexarotor)"}


@dataclass(frozen=True, repr=False)
class Survey(Reported):
    """Logs surveyed, in the order given."""

    logs: tuple[SurveyedLog, ...]

    def lost(self, files: Sequence[str], sources: Sequence[str] | None = None) -> list[str]:
        """Sentences on columns that no log of a recording gives, though a field has their name, and why.

        `sources` are the fields that a map takes; by their names when omitted.
        """
        logs = [log for log in self.logs if log.path.name in files]
        given = {canonical for log in logs for canonical in chosen(log)}
        given |= {"roll_deg", "pitch_deg", "yaw_deg"} if "q_w" in given else set()
        sentences = []
        for log in logs:
            for field in log.unused:
                mapped = {field.name, f"{field.topic}.{field.name}"} & set(sources or ())
                if mapped if sources is not None else field.canonical not in given:
                    sentences.append(f"{printable(log.path.name)}: {field.why}")
        return list(dict.fromkeys(sentences))

    def rows(self) -> Iterator[dict[str, Any]]:
        """Every field of every topic of every log as plain data."""
        for log in self.logs:
            taken = {
                (proposal.topic, proposal.name): (canonical, proposal)
                for canonical, proposal in chosen(log).items()
            }  # an increment and its time are one
            other = {(proposal.topic, proposal.name): proposal for proposal in reversed(log.proposals)}
            for topic in log.topics:
                for field in topic.fields:
                    key = (topic.name, field.name)
                    canonical, proposal = taken.get(key, ("", other.get(key)))
                    yield {
                        "file": log.path.name,
                        "topic": topic.name,
                        "field": field.name,
                        "samples": field.samples,
                        "rate_hz": topic.rate_hz,
                        "longest_s": topic.longest_s,
                        "minimum": field.minimum,
                        "maximum": field.maximum,
                        "stated_unit": field.unit,
                        "unit": proposal.unit if proposal else field.unit,
                        "taken_for": canonical,
                        "could_be": proposal.canonical if proposal and not canonical else "",
                        "why": proposal.why if proposal else "",
                        "certain": proposal.certain if proposal else None,
                    }

    def to_dict(self) -> dict[str, Any]:
        """Logs and fields as plain data for JSON."""
        return {
            "logs": [
                {
                    "file": str(log.path),
                    "format": log.format,
                    "topics": len(log.topics),
                    "start_s": log.span_s[0],
                    "end_s": log.span_s[1],
                    "notes": list(log.notes),
                    "remarks": list(log.remarks),
                    "not_underwater": log.not_underwater,
                    "modes": [
                        {"t": event.t, "mode": event.text} for event in log.events if event.kind == "mode"
                    ],
                }
                for log in self.logs
            ],
            "fields": list(self.rows()),
        }


_IMPORT = Budget(cpu_s=40.0, cpu_s_per_mb=40.0, memory_mb=700.0, memory_mb_per_mb=25.0)
"""What an import may cost beside the reading of its logs, which has budgets of its own: alignment,
corrections and manoeuvres took 8 s per MB of the tests' recordings at most, of which this is five times.
The constant part is as much for libraries, figures and the fits that take the same time whatever the size."""


def importing(paths: Iterable[str | Path]) -> AbstractContextManager[None]:
    """What holds an import of some logs to its budget, and makes one sentence of all that it raises."""
    files = [Path(path) for path in paths]
    return guarded(
        ", ".join(printable(file.name) for file in files[:6]),
        "the import",
        "list the fields with seatrial import LOG, leave out those that hold no measurements: write map.toml",
        size=sum(map(size_of, files)),
        budget=_IMPORT,
    )


@callers_errors_pass
def survey(paths: Iterable[str | Path], *, share: Callable[[float, str], None] | None = None) -> Survey:
    """Survey of some logs: a pass over each.

    `paths`: files; a folder of a ROS 2 bag counts as one. `share`: called with the share of all files that is
    done, and the name of the file.
    """
    files = [Path(path) for path in paths]
    if not files:
        raise TrialError("expected a log or several, found none; give the path of a file")
    for k, path in enumerate(files):
        # Path.resolve raises on a link that leads back to itself.
        if any(realpath(path) == realpath(other) for other in files[:k]):
            raise TrialError(f"{path}: given twice; give each log once")
    logs = []
    for k, path in enumerate(files):

        def part(done: float, k: int = k, path: Path = path) -> None:
            if share is not None:
                share((k + done) / len(files), f"survey of {path.name}")

        with importing([path]):
            logs.append(_surveyed(path, part))
    return Survey(tuple(logs))


def _surveyed(path: Path, share: Share) -> SurveyedLog:
    log = open_log(path)
    topics = log.topics(share)
    if not topics:
        notes = f" ({'; '.join(log.notes)})" if log.notes else ""
        raise TrialError(
            f"{path}: no topic with samples was found in this {FORMATS[log.format].description}{notes};"
            " fetch the file from the vehicle again"
        )
    made = SurveyedLog(
        path,
        log.format,
        tuple(topics),
        tuple(by_gravity(log.format, topics, propose(log.format, topics, log.parameters))),
        tuple(log.notes),
        tuple(log.remarks),
        tuple(log.events()),
        dict(log.parameters),
        log.epoch_s,
        tuple(_unused(log, topics)),
    )
    return replace(made, notes=(*made.notes, *map(str, _unknown_units(made, log.units_in))))


def _unused(log: Log, topics: Sequence[Topic]) -> Iterator[Unused]:
    """Fields with a known name and too few numbers; formats with documented messages have many."""
    if log.format not in ("csv", "parquet", "matlab"):
        return
    for canonical, topic, field in named_but_empty(topics):
        values: dict[str, Any] = {"rows": topic.samples, "fewest": RECOGNITION_SETTINGS.fewest}
        if topic.samples < RECOGNITION_SETTINGS.fewest:
            why = Note.of("rows too few", "", **values)
        else:
            text = log.words.get((topic.name, field.name), "")
            values |= {"canonical": canonical, "numbers": field.samples, "text": text}
            why = Note.of("numbers too few", field.name, **values)
        yield Unused(canonical, topic.name, field.name, why)


def _unknown_units(log: SurveyedLog, where: str) -> Iterator[Note]:
    """Notes on columns that are taken and state a unit that is not known."""
    names: dict[tuple[str, str], list[str]] = {}
    for proposal in chosen(log).values():
        field = log.field(proposal)[1]
        if unknown_unit(proposal, field):
            names.setdefault((field.unit, proposal.unit), []).append(field.name)
    for (stated, taken), columns in names.items():
        yield Note.of("unit not known", where, unit=stated, columns=columns, taken=taken)


def chosen(log: SurveyedLog) -> dict[str, Proposal]:
    """The best proposal of each canonical column, components of a vector from one topic."""
    alive = _one_velocity([proposal for proposal in log.proposals if not _dead(log, proposal)])
    best: dict[str, Proposal] = {}
    for columns in _VECTORS:
        candidates = [proposal for proposal in alive if proposal.canonical in columns]
        if candidates:
            topic = min(candidates, key=lambda proposal: proposal.rank).topic
            for proposal in sorted(candidates, key=lambda proposal: proposal.rank):
                if proposal.topic == topic:
                    best.setdefault(proposal.canonical, proposal)
    for proposal in alive:
        if not any(proposal.canonical in columns for columns in _VECTORS):
            best.setdefault(proposal.canonical, proposal)
    _one_attitude(best)
    if len({"x_m", "y_m"} & set(best)) == 1:  # north without east is no position
        best.pop("x_m", None)
        best.pop("y_m", None)
    return best


_VELOCITY = ("u_m_s", "v_m_s", "w_m_s")


def _one_velocity(proposals: Sequence[Proposal]) -> list[Proposal]:
    """The proposals without the velocities of the other kind: in the body's axes or the earth's.

    Velocities north, east and down become those of the body together, or not at all; a speed alone is the
    worse one. Those of an estimator stand behind what an instrument measured.
    """
    own = [proposal for proposal in proposals if proposal.canonical in _VELOCITY]
    earth = [proposal for proposal in own if proposal.convert]
    plain = [proposal for proposal in own if not proposal.convert]
    whole = {proposal.canonical for proposal in earth} == set(_VELOCITY)
    measured = not any(proposal.estimated for proposal in earth)
    few = len({proposal.canonical for proposal in plain}) < len(_VELOCITY) and measured
    dropped = plain if whole and (not plain or few) else earth
    return [proposal for proposal in proposals if proposal not in dropped]


def _dead(log: SurveyedLog, proposal: Proposal) -> bool:
    """Whether a sensor stands still: no field of the topic that makes its vector ever changes."""
    if proposal.canonical.startswith(("cmd.", "meas.", "voltage")):
        return False  # a command that is held and a steady supply tell something, too
    columns = next((c for c in _VECTORS if proposal.canonical in c), (proposal.canonical,))
    alike = [p for p in log.proposals if p.topic == proposal.topic and p.canonical in columns]
    fields = [log.field(p)[1] for p in alike]
    return all(not field.samples or field.minimum == field.maximum for field in fields)


def _one_attitude(best: dict[str, Proposal]) -> None:
    """Keep quaternion or angles, whichever is better; in place."""
    q = [best[c] for c in ("q_w", "q_x", "q_y", "q_z") if c in best]
    angles = [best[c] for c in ("roll_deg", "pitch_deg", "yaw_deg") if c in best]
    if len(q) < 4 or (angles and len(angles) == 3 and angles[0].rank < q[0].rank):
        drop: Sequence[str] = ("q_w", "q_x", "q_y", "q_z")
    else:
        drop = ("roll_deg", "pitch_deg", "yaw_deg")
    for column in drop:
        best.pop(column, None)
