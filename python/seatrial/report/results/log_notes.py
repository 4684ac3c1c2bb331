"""What reading logs left out or assumed, in words, one template per kind.

Held by ``tests/logs/test_logs.py`` and ``tests/logs/test_senders.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from seatrial.base.errors import printable
from seatrial.base.finding import Finding
from seatrial.logs.delimited import shared_name
from seatrial.logs.names import KNOWN_UNITS


def note(finding: Finding) -> str:
    """A note of a reader, a clause."""
    return _NOTES[finding.kind](finding)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _bytes_lost(finding: Finding) -> str:
    """How much is no whole message; in how many places, where and since when, as far as the reader knows."""
    lost, size, places = finding["lost"], finding["size"], finding["places"]
    since = finding.values.get("since_s", math.nan)
    after = f" ({since:.1f} s after the start of the autopilot)" if math.isfinite(since) else ""
    if "longest" in finding.values:
        where = f"from byte {finding['byte']:,} on{after}"
        if places > 1:
            where = f"in {places:,} places, the longest of {finding['longest']:,} bytes {where}"
    else:
        where = f"in {places:,} place{'s' if places > 1 else ''}"
        where += f", the first from byte {finding['byte']:,} on" if "byte" in finding.values else ""
    what = "are damaged" if finding["records"] else "are no whole messages"
    return (
        f"{lost:,} of {size:,} bytes ({100.0 * lost / size:.2g} %) {what}, {where}; they were skipped, the"
        " others read"
    )


def _text_cells(finding: Finding) -> str:
    count = finding["count"]
    many = f"{count} cells hold text, the first" if count > 1 else "a cell holds text,"
    return (
        f'column "{printable(finding.subject)}": {many} "{printable(finding["text"], 30)}" in line'
        f" {finding['line']}; read as empty"
    )


def _lines(count: int) -> str:
    return "a line has" if count == 1 else f"{count:,} lines have"


def _names_shared(finding: Finding) -> str:
    called = ", ".join(f'"{printable(name)}"' for name in finding["called"])
    shared = shared_name(finding.subject, finding["places"])
    return f"{shared}; here they are called {called}: rename them in the file"


def _sender_clock(finding: Finding) -> str:
    way = "behind" if finding["late_s"] > 0.0 else "ahead of"
    return (
        f"{finding.subject}: the clock of the sender is {abs(finding['late_s']):g} s {way} the recorder's;"
        " its stamps are moved by their shortest delay"
    )


def _system_clock(finding: Finding) -> str:
    way = "behind" if finding["late_s"] > 0.0 else "ahead of"
    return (
        f"the clock of system {finding.subject} is {abs(finding['late_s']):.1f} s {way} the vehicle's; its"
        " stamps are moved by their shortest delay"
    )


def _component_clock(finding: Finding) -> str:
    way = "after" if finding["began_s"] > 0.0 else "before"
    return (
        f"clock of component {finding.subject} ({', '.join(finding['kinds'])}): it began"
        f" {abs(finding['began_s']):,.1f} s {way} that of the autopilot; its stamps are put on the ground"
        " station's clock by their shortest delay"
    )


def _time_taken(finding: Finding) -> str:
    why = str(finding["why"] or "") or "no column is called time"
    return f'{why}; taken: the first, "{printable(finding.subject)}", which rises'


def _unknown_type(finding: Finding) -> str:
    why = f" ({finding['error']})" if finding["error"] else ""
    return f"{finding.subject}: messages of the unknown type {finding['type']}{why}; left out"


def _stamps_far(finding: Finding) -> str:
    rows = finding["rows"]
    return (
        f"{finding.subject}: the stamps of {rows} row{'s' if rows > 1 else ''} are far from those around"
        f" them, the first in row {finding['row']:,} ({finding['t_s']:.6g} s); left out"
    )


def _time_again(finding: Finding) -> str:
    begin, end = finding["taken"]
    before, after = finding["from_s"], finding["to_s"]
    return (
        f"{finding.subject}: time begins again {_times(finding['times'])}, the first in row"
        f" {finding['row']:,} (from {before:.6g} to {after:.6g} s), as in recordings one after another;"
        f" taken: the longest, rows {begin:,} to {end:,}; split the file to use the others"
    )


def _depth(finding: Finding) -> str:
    low, surface = finding["lowest_pa"], finding["surface_pa"]
    note = f"{surface:g} Pa is the surface"
    if finding["surface"] == "lowest":
        note = "the lowest one is taken for the surface"
    elif finding["surface"] == "gauge":
        note = f"less than the air's, {low:.3g} Pa, so taken as above it"
    return (
        f"depth from pressure: {note}, {finding['rho_kg_m3']:g} kg/m3; in fresh water depths are 2.5 % more"
    )


def _small_pressure(finding: Finding) -> str:
    depth = finding["depth_m"]
    guesses = ", ".join(f"{size * depth:.3g} m if {unit}" for unit, size in finding["units"].items())
    return (
        f"pressures reach {finding['highest_pa']:.3g} Pa, {depth:.2g} m of water: expected a pressure in Pa,"
        f" found one in another unit ({guesses}); give its unit in map.toml"
    )


def _velocity_turned(finding: Finding) -> str:
    words = "velocity: north, east and down turned into the body's axes by the attitude"
    if field := finding["estimated"]:
        return (
            f"{words}; velocity of the estimator, {field}: no measurement: it has the delay and the model of"
            " its filter; add a Doppler log"
        )
    return words


def _rows(count: int) -> str:
    return f"{count:,} row{'s' if count != 1 else ''}"


def _numbers_too_few(finding: Finding) -> str:
    count = f"{finding['numbers']} numbers" if finding["numbers"] else "no number"
    content = f"{count} in {_rows(finding['rows'])} ({finding['text'] or 'empty cells or NaN'})"
    return (
        f'column "{printable(finding.subject)}" ({finding["canonical"]} by its name) is not used: {content};'
        f" expected at least {finding['fewest']} numbers: write them, or remove the column"
    )


def _unit_not_known(finding: Finding) -> str:
    where = f"{finding.subject}: " if finding.subject else ""
    columns = ", ".join(f'"{printable(name)}"' for name in finding["columns"])
    return (
        f'{where}the unit "{printable(finding["unit"], 20)}" of {columns} is not known,'
        f" {finding['taken'] or 'none'} was taken; known are {', '.join(KNOWN_UNITS)}: correct it in the"
        ' file, or give unit = "..." in map.toml'
    )


def _time_form(finding: Finding) -> str:
    return (
        f'column "{printable(finding.subject)}" holds "{printable(finding["cell"], 40)}" in line'
        f" {finding['line']}, whose form is not known; expected seconds or a date such as"
        " 2024-06-01T12:58:30.25+02:00 or 06/01/2024 02:58:30 PM: write it so"
    )


def _time_falls(finding: Finding) -> str:
    (x, first), (y, second) = finding["falls"]
    return (
        f'column "{printable(finding.subject)}" runs backwards, from {x:.10g} in line {first} to {y:.10g} in'
        f" line {second}, and goes on so; expected times that rise: sort the rows of the file by time"
    )


def _metres(finding: Finding) -> str:
    longitude = finding["longitude_deg"]
    place = f"latitude {finding['latitude_deg']:.7f}"
    place += "" if longitude is None else f", longitude {longitude:.7f} deg"
    return f"north and east from latitude and longitude: metres from the first fix, {place}"


_NOTES: dict[str, Callable[[Finding], str]] = {
    # Damage.
    "bytes lost": _bytes_lost,
    "cut within message": lambda f: (
        f"cut off within its last {f.subject}: its {f['bytes']} bytes are left out"
    ),
    "cut within record": lambda f: (
        f"cut off: the last {f['bytes']:,} bytes are no whole record; what is whole was read"
    ),
    "cut within line": lambda f: "cut off: its last line has no end, its last value may be cut short",
    "cut within variable": lambda f: (
        f"cut off within its last variable, {f['bytes']:,} bytes before the end of the file; what is whole"
        " was read; save or copy the file again"
    ),
    "last line cut": lambda f: "the last line is cut short; left out",
    "packing damaged": lambda f: (
        f"its packing is cut short or damaged ({f['error']}); what came before was read"
    ),
    "stopped": lambda f: f"stopped at a damaged {f.subject} ({f['error']}); what came before was read",
    "null bytes": lambda f: (
        f"it ends with null bytes ({f['bytes']:,}), as a file that was given its size in advance and not"
        " filled; what comes before them was read"
    ),
    "no packets": lambda f: f"{f['bytes']:,} bytes are no whole packets; they were skipped, the others read",
    "packets damaged": lambda f: (
        f"{f['damaged']} packets are damaged and {f['unknown']} of unknown kind; the others were read"
    ),
    "parts damaged": lambda f: "parts of the file are damaged; the others were read",
    "no index": lambda f: (
        "has no index, as after a recorder that was cut off: read from the front, up to the damaged part"
    ),
    "variable damaged": lambda f: f"the variable at byte {f['byte']:,} is damaged ({f['error']}); left out",
    "column damaged": lambda f: f'column "{printable(f.subject)}" is damaged ({f["error"]}); read as empty',
    "promised too much": lambda f: (
        f"{f.subject}: {f['count']} values promised, more than the file can hold; left out"
    ),
    "drop-outs": lambda f: (
        f"{f['count']} drop-out{'s' if f['count'] > 1 else ''} of the logger, {f['lost_s']:.3g} s in all"
    ),
    "stamps astray": lambda f: f"{f['count']:,} messages are stamped unlike those around them; left out",
    # Messages and columns that are not read.
    "columns and values differ": lambda f: (
        f"{f.subject}: {f['values']} values for {f['columns']} columns; left out"
    ),
    "length differs": lambda f: (
        f"{f.subject}: {f['expected']} bytes expected, {f['stated']} stated; left out"
    ),
    "types without format": lambda f: (
        "messages of types without a format message, number (count):"
        f" {', '.join(f'{number} ({count:,})' for number, count in f['counts'].items())}; left out"
    ),
    "lines of no type": lambda f: (
        f"{f['count']:,} lines are no whole messages of a type with a format; left out or read in part"
    ),
    "lines of no entry": lambda f: f"{f['count']} lines are no entries of an alog; the others were read",
    "undescribed channel": lambda f: "messages of a channel that nothing describes; left out",
    "unknown type": _unknown_type,
    "unknown encoding": lambda f: (
        f'{f.subject}: messages encoded as "{f["encoding"]}", which is not read; left out'
    ),
    "definition damaged": lambda f: (
        f"{f.subject}: its message definition is damaged ({f['error']}); left out"
    ),
    "not decoded": lambda f: f"{f.subject}: a message cannot be decoded ({f['error']}); left out",
    "no timestamp": lambda f: f"{f.subject}: its samples have no timestamp; left out",
    "no signal of time": lambda f: f"{f.subject}: no signal of its length is a time",
    "link": lambda f: f"{f.subject}: a link to elsewhere, not followed",
    "object": lambda f: (
        f"{printable(f.subject)}: an object of MATLAB, not read; save its data as plain arrays"
    ),
    "no numbers": lambda f: (
        f'column "{printable(f.subject)}" is not read: expected a number in each cell, found'
        f" {printable(f['found'], 40)}; write a column for each number"
    ),
    "text cells": _text_cells,
    "too many cells": lambda f: (
        f"{_lines(f['count'])} more than {f['cells']} cells, as a thousands separator makes them: which cell"
        " was cut is not known; left out"
    ),
    "too few cells": lambda f: (
        f"{_lines(f['count'])} fewer than {f['cells']} cells: the missing ones are empty"
    ),
    "names shared": _names_shared,
    "no names": lambda f: "no row of names: the columns are called column_1, column_2, ...",
    "no definitions": lambda f: "the bag has no message definitions; those of ROS 2 Humble were taken",
    # Time.
    "no time": lambda f: (
        str(f["why"] or "") or "no column is a time: name one in the map, or this file cannot be used"
    ),
    "time taken": _time_taken,
    "time empty": lambda f: (
        f'column "{printable(f.subject)}" is empty{f["where"]}; expected times that rise: write the time of'
        " each row"
    ),
    "time of unknown form": _time_form,
    "time constant": lambda f: (
        f'column "{printable(f.subject)}" is {f["value"]:.10g} in all of the first {f["rows"]} rows; expected'
        " times that rise: write the time of each row"
    ),
    "time falls": _time_falls,
    "days without time": lambda f: (
        f'column "{printable(f.subject)}" holds days without a time, the first {f["first"]}; expected'
        " seconds, or dates with the time of day: write them so"
    ),
    "scale of time": lambda f: f"{f.subject}: {f['how']}",
    "time zone": lambda f: f"clock: time zone offset {f['offset_s']} s as logged, not applied",
    "system clock": _system_clock,
    "component clock": _component_clock,
    "sender clock": _sender_clock,
    "late stamps": lambda f: (
        f"{f.subject}: the stamps are {f['late_s']:g} s and more before the reception; taken as they are: if"
        " this is a clock that is wrong and no delay, correct the header stamps"
    ),
    "no Unix time": lambda f: (
        f"{f.subject}: no Unix time; taken to begin with the others': check, or give its clock"
    ),
    "rows without time": lambda f: f"{f.subject}: {f['rows']} rows without a time left out",
    "stamps far": _stamps_far,
    "time begins again": _time_again,
    "time backwards": lambda f: f"{f.subject}: time runs backwards {_times(f['times'])}; rows sorted",
    "bursts": lambda f: (
        f"{f.subject}: samples came in {f['bursts']} bursts with nearly one stamp each; spread evenly,"
        f" {f['step_s']:.3g} s apart"
    ),
    "equal stamps": lambda f: f"{f.subject}: {f['rows']} rows with the stamp of the next one left out",
    "short": lambda f: f"{f.subject}: covers {f['covered_s']:.4g} s of {f['of_s']:.4g} s",
    # What an import makes of the fields.
    "rows too few": lambda f: (
        f"{_rows(f['rows'])}, expected at least {f['fewest']}: none of its columns is used"
    ),
    "numbers too few": _numbers_too_few,
    "unit not known": _unit_not_known,
    "of file": lambda f: f"{f.subject}: {f['note']}",
    "velocity not used": lambda f: (
        "velocity over the earth is not used: expected"
        f" {'an attitude' if f['components'] == 3 else 'all of north, east and down'} to turn it into the"
        " body's axes"
    ),
    "velocity turned": _velocity_turned,
    "depth": _depth,
    "pressure too small": _small_pressure,
    "metres": _metres,
}
"""The note of each kind."""
