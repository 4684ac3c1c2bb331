"""What every number of a campaign, bench or other file of sections may be, and what to do about another.

A key carries its unit, and the unit says how large a number of a vehicle may be; a key with bounds of its own
stands in `KEYS`. What one number demands of another is the model's (`seatrial.campaign.file`,
`seatrial.bench_test.file`). The files of vehicle, autopilot and mission have their rows in the core
(``src/ranges/rows.rs``). Held by ``tests/campaign/test_file_ranges.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TextLimits:
    """How long and how deep the text of a file may be."""

    most_entries: int = 2_000  #: Most entries of a list or a table: more is no file that a person wrote.
    most_characters: int = 4_096  #: Most characters of a text: the longest path on Linux (PATH_MAX).
    most_depth: int = 20  #: Most tables within each other: our deepest file has five.


LIMITS = TextLimits()

LONGEST = {"name": 200, "label": 200, "description": 20_000}
"""Most characters of the text of a key; of another one, `most_characters`: a path, a requirement."""

Where = tuple[str | int, ...]


@dataclass(frozen=True)
class Range:
    """From `least` to `most`, both included; `remedy` says what to do about another number."""

    least: float
    most: float
    remedy: str

    def complaint(self, x: float) -> str | None:
        """What was expected, what was found and what to do; None within the range."""
        if self.least <= x <= self.most:
            return None
        expected = f"a number from {self.least:g} to {self.most:g}" if math.isfinite(x) else "a finite number"
        return f"expected {expected}, found {x:g}; {self.remedy}"


def _sized(most: float, remedy: str) -> Range:
    return Range(-most, most, remedy)


ANY = _sized(1e12, "no vehicle has a number of this size; check the unit")
"""Of a key without a row."""

UNITS = {
    "_kg_m3": Range(1.0, 2e4, "give the density in kg/m3: 1025 in the sea, 1000 in a lake"),
    "_m_s2": Range(0.1, 100.0, "give it in m/s2; gravity is 9.81"),
    "_m_s": _sized(100.0, "give it in m/s"),
    "_deg": _sized(3_600.0, "give it in degrees"),
    "_hz": Range(1e-6, 1e5, "give it in Hz"),
    "_percent": Range(0.0, 1e4, "give it in percent"),
    "_db": _sized(200.0, "give it in dB"),
    "_kg": Range(0.0, 1e9, "give it in kg"),
    "_m3": Range(0.0, 1e9, "give it in m3"),
    "_m": _sized(1e6, "give it in metres"),
    "_n": _sized(1e9, "give it in N"),
    "_v": Range(0.0, 1e5, "give it in V"),
    "_s": _sized(1e11, "give it in seconds"),
}
"""By the unit that ends a key, longer units first."""

KEYS = {
    "seed": Range(0.0, 2.0**63 - 1.0, "a seed is a whole number from 0"),
    "rate_hz": Range(1e-6, 1e4, "give the rate of the common time base in Hz, 10 for most logs"),
    "segment_s": Range(1e-3, 1e7, "give the length of a segment in seconds, 10 for most trials"),
    "horizon_s": Range(0.0, 60.0, "give seconds; 0 predicts one sample ahead"),
    "horizons_s": Range(1e-3, 60.0, "give seconds, of the order of the vehicle's time constants"),
    "overlap_s": Range(0.0, 1e7, "give it in seconds, shorter than segment_s"),
    "duration_s": Range(1e-3, 1e7, "give the length of the trial in seconds"),
    "settle_s": Range(0.0, 1e6, "give it in seconds"),
    "until_s": Range(0.0, 1e6, "give it in seconds"),
    "rise_s": Range(0.0, 1e6, "give it in seconds"),
    "settling_s": Range(0.0, 1e6, "give it in seconds"),
    "dead_s": Range(0.0, 1e6, "give it in seconds"),
    "delay_s": Range(0.0, 1e3, "give it in seconds"),
    "max_time_s": Range(1e-3, 31_557_600.0, "give the longest flight in seconds"),
    "population": Range(2.0, 1e5, "16 candidates a generation do for most stages"),
    "generations": Range(1.0, 1e6, "200 generations do for most stages"),
    "simplex_rounds": Range(0.0, 1e6, "leave it out for the default"),
    "starts": Range(1.0, 1e4, "a handful of random starts show whether there are several optima"),
    "rounds": Range(0.0, 1e5, "10 rounds do for most vehicles"),
    "knots": Range(4.0, 1e3, "a table of thrust has some ten knots"),
    "samples": Range(0.0, 1e4, "3 drawn vehicles do for most tunings"),
    "runs": Range(1.0, 1e6, "300 runs show a failure rate of 1 %"),
    "supply_v": Range(0.1, 1e4, "give the supply voltage in V"),
    "trim": _sized(1e6, "give the value of the channel at rest, 1500 for pulse widths"),
    "min": _sized(1e6, "give the least value of the channel, 1100 for pulse widths"),
    "max": _sized(1e6, "give the largest value of the channel, 1900 for pulse widths"),
    "dead_zone": Range(0.0, 1e6, "give it in the channel's unit, less than from trim to min or max"),
    "full": _sized(1e6, "give the command at full deflection in its unit"),
    "drift": _sized(0.01, "a clock drifts by less than 1 %: give the ratio less one, 40e-6 for 40 ppm"),
    "peakedness": Range(1.0, 7.0, "3.3 for a young sea, 1 for a grown one (Pierson-Moskowitz)"),
    "spreading_deg": Range(0.0, 60.0, "give the standard deviation of the directions in degrees"),
    "keep_worst": Range(0.0, 1e4, "keep the logs of a handful"),
    "nitrate_mg_l": Range(0.0, 1e5, "give it in mg/L; the sea holds less than 3"),
    "salinity": Range(0.0, 42.0, "give practical salinity: 35 in the ocean, 0 in a river"),
    "temperature_c": Range(-2.0, 40.0, "give it in degrees Celsius"),
    "nitrate_per_m": _sized(1e3, "give the change per metre of depth in mg/L"),
    "salinity_per_m": _sized(10.0, "give the change per metre of depth"),
    "temperature_per_m": _sized(10.0, "give the change per metre of depth in degrees"),
    "discharge_m3_s": Range(1e-9, 1e4, "give it in m3/s; 1 L/s is 0.001"),
    "horizontal_m2_s": Range(0.0, 1e4, "give the diffusivity in m2/s, 0.01 to 1 in coastal water"),
    "vertical_m2_s": Range(0.0, 10.0, "give the diffusivity in m2/s, 1e-4 to 1e-2 in coastal water"),
    "response_s": Range(0.0, 1e4, "give the time constant of the sensor in seconds"),
    "noise": Range(0.0, 1e4, "give the standard deviation in the unit of the channel"),
}
"""By their own bounds."""

ENTRIES = {
    "signs": Range(-1.0, 1.0, "a sign is 1 or -1"),
    "delay_s": _sized(1e3, "give it in seconds"),
    "tilt_deg": _sized(360.0, "give it in degrees"),
    "scale": Range(1e-6, 1e6, "a factor is positive; give a sign under signs"),
    "bias": _sized(1e3, "check the unit that ends the key"),
}
"""Tables of corrections by channel or sensor: every number in one has its row."""

OPEN = {
    "actuators",
    "columns",
    "commands",
    "channels",
    "mix",
    "coefficients",
    "factors",
    "values",
    "nuisances",
    "trials",
}
"""Tables whose keys are names of the user's: their numbers have the range `ANY`."""


def range_of(key: str) -> Range:
    """Range of the numbers of a key.

    Examples
    --------
    >>> range_of("depth_m").most, range_of("runs").most
    (1000000.0, 1000000.0)
    """
    return KEYS.get(key) or next((row for unit, row in UNITS.items() if key.endswith(unit)), ANY)


def number_complaints(data: Mapping[str, Any]) -> Iterator[tuple[Where, str]]:
    """Place and complaint of every number beyond its range."""
    for where, value, row in _numbers(data, (), None):
        if complaint := row.complaint(value):
            yield where, complaint


def _numbers(value: Any, where: Where, row: Range | None) -> Iterator[tuple[Where, float, Range]]:
    if isinstance(value, Mapping):
        table = where[-1] if where else ""
        every = ENTRIES.get(str(table)) or (ANY if table in OPEN else None)
        for key, entry in value.items():
            yield from _numbers(entry, (*where, key), every or range_of(key))
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from _numbers(entry, (*where, i), row)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        huge = isinstance(value, int) and abs(value) > 2**1000
        yield where, math.inf if huge else value, row or ANY


def text_complaints(data: Mapping[str, Any]) -> Iterator[tuple[Where, str]]:
    """Place and complaint of text that no terminal and no file name should meet, and of endless lists."""
    yield from _texts(data, ())


def _texts(value: Any, where: Where) -> Iterator[tuple[Where, str]]:
    if isinstance(value, str):
        yield from ((where, complaint) for complaint in _text(value, str(where[-1]) if where else ""))
    elif isinstance(value, Mapping | list):
        if len(value) > LIMITS.most_entries:
            yield where, f"expected at most {LIMITS.most_entries} entries, found {len(value)}; split the file"
        elif len(where) >= LIMITS.most_depth:
            yield (
                where[:3],
                f"expected at most {LIMITS.most_depth} tables or lists within each other; remove some",
            )
        else:
            items: Iterator[tuple[Any, Any]] = iter(
                value.items() if isinstance(value, Mapping) else enumerate(value)
            )
            for key, entry in items:
                wrong = list(_text(key, "name")) if isinstance(key, str) else []
                yield from ((where, f"a key of it: {complaint}") for complaint in wrong)
                if not wrong:
                    yield from _texts(entry, (*where, key))


def _text(value: str, key: str) -> Iterator[str]:
    """Complaints about the text of a key; a description may have several lines."""
    most = LONGEST.get(key, LIMITS.most_characters)
    allowed = "\n\r\t" if key == "description" else ""
    wrong = next((c for c in value if (ord(c) < 32 or 127 <= ord(c) < 160) and c not in allowed), None)
    if wrong is not None:
        yield f"expected text without control characters, found U+{ord(wrong):04X}; remove it"
    if len(value) > most:
        yield f"expected at most {most} characters, found {len(value)}; shorten it"
