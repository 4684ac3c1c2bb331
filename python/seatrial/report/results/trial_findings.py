"""Findings about recordings in words: the problem as a clause, and what to do about it.

A wording per kind. Held by ``tests/inspect/test_wiring.py`` and ``tests/inspect/test_consistency_trials.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from seatrial.base.finding import Finding, Severity
from seatrial.base.report import listed
from seatrial.trial.signals import RecordingFinding


def problem(finding: Finding) -> str:
    """The problem, a clause; it names the trial where the finding does."""
    return _PROBLEMS[finding.kind](finding)


def remedy(finding: Finding) -> str:
    """What to do about a finding."""
    return _REMEDIES[finding.kind](finding)


def _trial(finding: Finding) -> str:
    return f"trial {finding.subject}: " if finding.subject else ""


def _wiring(finding: Finding) -> str:
    reversed_, faults = finding["reversed"], []
    if reversed_:
        acts = "act against their signs" if len(reversed_) > 1 else "acts against its sign"
        faults.append(f"{listed(reversed_)} {acts}")
    faults += [f"{a} and {b} act in one another's place" for a, b in finding["exchanged"]]
    shares = ", ".join(
        f"{100.0 * after:.0f} % instead of {100.0 * max(before, 0.0):.0f} % of {axis}"
        for axis, (before, after) in finding["explained"].items()
    )
    return (
        f"{_trial(finding)}wiring: {' and '.join(faults)}: so the commands explain {shares} beyond damping"
        f" (log-likelihood {finding['evidence']:.0f} higher)"
    )


def _wiring_remedy(finding: Finding) -> str:
    reversed_, cures = finding["reversed"], []
    if reversed_:
        these = "these actuators" if len(reversed_) > 1 else "this actuator"
        columns = listed([f"cmd.{name}" for name in reversed_])
        cures.append(
            f"toggle the key reversed of {these} in the vehicle file, or give sign = -1 to {columns} in the"
            " column map"
        )
    cures += [
        f"exchange the columns of cmd.{a} and cmd.{b} in the column map" for a, b in finding["exchanged"]
    ]
    return f"{' and '.join(cures)}; check in the water"


def _beyond(finding: Finding) -> str:
    return (
        f"{_trial(finding)}command of {finding['command']} reaches {finding['reached']:g}, and its limit is"
        f" {finding['limit']:g} (beyond it in {100.0 * finding['share']:.0f} % of the samples)"
    )


def _late(finding: Finding) -> str:
    word = "late" if finding["delay_s"] > 0.0 else "early"
    return (
        f"the velocity of trial {finding.subject} is {abs(finding['delay_s']):.2f} s {word} (it differs from"
        f" the rate of depth by {finding['before']:.3g} m/s rms, without the delay by"
        f" {finding['after']:.3g}), and the log has too few positions to correct this on reading,"
        " so forces are fitted at the wrong times"
    )


def _late_remedy(finding: Finding) -> str:
    return (
        f"run seatrial check {finding['problem']} and paste its proposal ({finding['line']} under"
        " [corrections])"
    )


_PROBLEMS: dict[str, Callable[[Finding], str]] = {
    "wiring": _wiring,
    "command beyond limit": _beyond,
    "late velocity": _late,
}

_REMEDIES: dict[str, Callable[[Finding], str]] = {
    "wiring": _wiring_remedy,
    "command beyond limit": lambda _: "check the unit of the column and the limits in the vehicle file",
    "late velocity": _late_remedy,
}


def message(finding: RecordingFinding) -> str:
    """What reading found about a channel, to follow its name and the number of samples that it concerns."""
    if finding.kind in _MASKED:
        after = "the value before is held" if finding.values.get("held") else "masked"
        return f"{_MASKED[finding.kind](finding)}; {after}"
    return _MESSAGES[finding.kind](finding)


def _many(finding: RecordingFinding, noun: str) -> str:
    return noun if finding.count == 1 else f"{noun}s"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _unit_quaternions(finding: RecordingFinding) -> str:
    what = "sample is no unit quaternion" if finding.count == 1 else "samples are no unit quaternions"
    return (
        f"{what} (length {finding['shortest']:.2f} to {finding['longest']:.2f}), as linear interpolation over"
        " a sign flip leaves them"
    )


def _codes(finding: RecordingFinding) -> str:
    named = ", ".join(f"{code:.10g}" for code in finding["codes"])
    more = f" and {finding['more']} more" if finding["more"] else ""
    return f"samples of {named}{more} stand for no sample"


_MASKED: dict[str, Callable[[RecordingFinding], str]] = {
    "rows repeated": lambda f: (
        "rows repeat the row before in every sensor: gaps that the logger filled, the longest"
        f" {f['longest_s']:.2f} s"
    ),
    "frozen": lambda f: (
        f"{_many(f, 'frozen sample')} in {f['drop_outs']} drop-out{'' if f['drop_outs'] == 1 else 's'}"
    ),
    "zeros": lambda f: "samples of zeros stand for no sample",
    "no unit quaternion": _unit_quaternions,
    "codes": _codes,
    "not finite": lambda f: _many(f, "NaN or infinite sample"),
    "gaps in time": lambda f: f"{_many(f, 'gap')} in time, the longest {f['longest_s']:.2f} s",
    "only fixes": lambda f: f"known in {_percent(f['share'])} of the record only, as fixes at the surface",
}
"""Why samples are masked, a clause of each kind."""


def _cause_of_masks(finding: RecordingFinding) -> str:
    cause = finding.cause
    if not isinstance(cause, RecordingFinding):
        return "missing samples"
    words = _CAUSES.get(cause.kind) or _MASKED[cause.kind]
    return f"{cause.count or ''} {words(cause)} ({cause.subject})".strip()


def _jumps(finding: RecordingFinding) -> str:
    return f"{_many(finding, 'jump')} faster than any ordinary motion"


def _uncommanded(finding: RecordingFinding) -> str:
    spans = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in finding["longest"])
    more = f" and {finding['shorter']} shorter ones" if finding["shorter"] else ""
    return (
        f"{', '.join(finding['actuators'])}: no command from {spans}{more}, otherwise one every"
        f" {finding['usual_s']:.2g} s"
    )


_CAUSES: dict[str, Callable[[RecordingFinding], str]] = {
    "clock jumped": _MASKED["gaps in time"],
    "jumps": _jumps,
    "spikes": lambda f: _many(f, "spike"),
    "uncommanded": _uncommanded,
}
"""The same of kinds that say more than that."""


def convention(finding: Mapping[str, Any]) -> str:
    """The convention that an attitude has instead of the one mapped, and what to write in the column map."""
    faults = []
    if finding["scalar_last"]:
        faults.append(
            "its four columns hold x y z w, the scalar last (give q_x the column of q_w, q_y that of q_x, q_z"
            " that of q_y, and q_w that of q_z)"
        )
    if finding["inverse"]:
        faults.append("it turns the earth into the body (give sign = -1 to q_x, q_y and q_z)")
    if finding["frames"]:
        named = " or ".join(f'frame = "{frame}"' for frame in finding["frames"])
        faults.append(f"its axes have z up (give {named} to each column of the attitude)")
    gyro = ', or the gyro has them (give frame = "FLU" to p_deg_s, q_deg_s and r_deg_s)'
    return (
        f"the attitude has another convention than the map says: {', and '.join(faults)}"
        f"{gyro if finding['gyro_instead'] else ''}; so it explains {_percent(finding['share'])} of the"
        f" motion that gyro and velocity show, and {_percent(finding['before'])} as mapped"
    )


def _no_latency(finding: RecordingFinding) -> str:
    if "searched_s" in finding.values:
        return (
            "latency not estimated: what fits best lies at the end of the range of +/-"
            f" {finding['searched_s']:g} s that is searched"
        )
    return "latency not estimated: too little motion or too few valid samples"


def _latency_removed(finding: RecordingFinding) -> str:
    late = "late" if finding["delay_s"] > 0.0 else "early"
    return f"{abs(finding['delay_s']):.3f} s (+/- {finding['sd_s']:.3f} s) {late} against the pose; removed"


def _latency_uncertain(finding: RecordingFinding) -> str:
    return (
        f"latency {finding['delay_s']:.3f} s (+/- {finding['sd_s']:.3f} s, correlation"
        f" {finding['correlation']:.2f}) is not certain or negligible; left as recorded"
    )


def _opposite(finding: RecordingFinding) -> str:
    return f"runs opposite to the recorded pose ({finding['follows']})"


def _entry(finding: RecordingFinding) -> str:
    return f"in the column map: {finding['column']} = {finding['entry']}"


def _sign_reversed(finding: RecordingFinding) -> str:
    if "like" in finding.values:
        runs = f"runs as {finding['like']} did before its sign was reversed"
    else:
        runs = _opposite(finding)
    return f"{runs}; sign reversed here. State it {_entry(finding)}"


def _sign_doubtful(finding: RecordingFinding) -> str:
    return (
        f"seems to run opposite to the recorded pose ({finding['follows']}), too weakly to be corrected; left"
        f" as recorded. If its sign is wrong, state it {_entry(finding)}"
    )


def _unit_of_reference(finding: RecordingFinding) -> str:
    unit = finding["unit"]
    words = (
        f"moves by {finding['moved']:.2g} {unit} rms where the {finding['sensor']} shows"
        f" {finding['shown']:.2g} {unit}, {finding['scale']:.3g} times as much; no vehicle moves so little or"
        f" so much: check the unit of the {finding['moving']}"
    )
    pressure = finding["pressure"]
    return f"{words}. A pressure in {pressure} that is read as Pa would do that" if pressure else words


def _unit_of_sensor(finding: RecordingFinding) -> str:
    moving = finding["moving"]
    words = f"{finding['scale']:.3g} times what the derivative of the recorded {moving} shows"
    if finding["unit"]:
        return f"{words}: {finding['unit']}? State it {_entry(finding)}"
    return f"{words}; check its unit, and that of the {moving}"


def _unit_changes(finding: RecordingFinding) -> str:
    larger, factor = finding["larger"], finding["factor"]
    before, after = finding["units"] if larger else finding["units"][::-1]
    several = "s" if len(finding.subject.split()) > 1 else ""
    return (
        f"the unit changes within the channel{several}: from row {finding['row']} (t ="
        f" {finding['t_s']:.6g} s) on, values are {factor if larger else 1.0 / factor:.3g} times"
        f" {'larger' if larger else 'smaller'}, as {after} after {before} would be"
        f" ({finding['ratio']:.4g} times); convert one part, or cut the recording there into two trials, each"
        " with its unit"
    )


def _current(finding: RecordingFinding) -> str:
    numbers = ", ".join(
        f"{name} {mean:+.3f} (+/- {sd:.3f})"
        for name, mean, sd in zip(("north", "east", "down"), finding["mean"], finding["sd"], strict=True)
    )
    manner = "steady" if finding["steady"] else "changing, its mean"
    words = f"{manner} {numbers} m/s, from velocity over ground less that through water"
    doubt = "; the velocities do not agree on one current: check sign, unit and frame of both"
    return f"{words}{doubt}" if finding.severity > Severity.NOTE else words


def _tilt(finding: RecordingFinding) -> str:
    after = "position and attitude turned upright" if finding["turned"] else "left as recorded"
    return (
        f"the earth frame is tilted by {finding['angle_deg']:.1f} deg (+/- {finding['sd_deg']:.1f} deg)"
        f" against gravity, as the measured attitude at different headings shows; {after}"
    )


def _above_surface(finding: RecordingFinding) -> str:
    return (
        f"above the surface in {_percent(finding['share'])} of the record ({finding['median_m']:.3g} m at the"
        " median; z counts downwards from the surface): if the sensor counts upwards, give its column"
        ' sign = -1, or the whole position frame = "ENU" or "NWU"; if its zero is not the surface, shift it'
    )


def _constant(finding: RecordingFinding) -> str:
    at = f" at {finding['value']:.6g}" if "value" in finding.values else ""
    return f"constant{at} over the whole recording; a sensor that is off?"


def _degrees(finding: RecordingFinding) -> str:
    extremes = ", ".join(f"{angle} {largest:.3g} rad" for angle, largest in finding["largest_rad"].items())
    entries = ", ".join(
        f'{column} = {{ from = "{source}", unit = "deg" }}' for column, source in finding["columns"].items()
    )
    return (
        f"angles reach {extremes}, more than any vehicle's: they look like degrees; state the unit in the"
        f" column map: {entries}"
    )


def _time_unit(finding: RecordingFinding) -> str:
    unit = finding["unit"]
    return (
        f"read as s, {finding['rate_hz']:.3g} Hz, and looks like {unit} ({finding['how']}); state the unit in"
        f' the column map: t_s = {{ from = "{finding["column"]}", unit = "{unit}" }}'
    )


def _arm(finding: RecordingFinding) -> str:
    where = ", ".join(f"{x:g}" for x in finding["arm_m"])
    return f"moved to O from the {finding['sensor']} sensor at ({where}) m"


def _given(finding: RecordingFinding) -> str:
    if finding["recorded"]:
        return f"{finding['value']}, as given under corrections"
    return f"{finding['value']}, given under corrections, but not recorded"


_MESSAGES: dict[str, Callable[[RecordingFinding], str]] = {
    # Columns of the recording and their units.
    "columns unused": lambda f: "not used: " + ", ".join(f'"{column}"' for column in f["columns"]),
    "column of another unit": lambda f: (
        f'"{f["column"]}" is not used: called as {f["canonical"]}, and {f["unit"]} is no unit of it; map it,'
        " or rename it"
    ),
    "column empty": lambda f: f"no sample of {', '.join(f['columns'])}: every cell is empty",
    "beyond any vehicle": lambda f: (
        f"samples beyond {f['most']:g}{f['unit']}, as no vehicle has them, count as NaN; state the column's"
        " unit, or leave cells without a sample empty"
    ),
    "looks like degrees": _degrees,
    "angles missing": lambda f: f"{', '.join(f['angles'])} not recorded and taken as zero",
    "sign flips": lambda f: f"{_many(f, 'sign flip')} of the quaternion made continuous",
    "unit changes": _unit_changes,
    "time unit": _time_unit,
    # Stamps and the time base.
    "components apart": lambda f: "components have stamps of their own; brought to those of the busiest",
    "rows of slower sensors": lambda f: (
        "the rows repeat the samples of slower sensors; each is taken at its first row"
    ),
    "stamps uneven": lambda f: (
        f"stamps are {f['step_s']:.3g} to {f['usual_s']:.3g} s apart; put on {1.0 / f['step_s']:.3g} Hz,"
        " which keeps all samples"
    ),
    "stamps of several sensors": lambda f: (
        f"the sensors have stamps of their own; put on {f['rate_hz']:g} Hz, the rate of the {f['fastest']}"
    ),
    "bursts": lambda f: (
        f"samples came in {f['bursts']} bursts with nearly one stamp each; spread evenly,"
        f" {f['step_s']:.3g} s apart"
    ),
    "clock jumped": lambda f: (
        f"{_MASKED['gaps in time'](f)}; masked; across it the vehicle moved no further than in one interval:"
        " the clock may have jumped. If it did, take the jump out of the stamps, or import the parts before"
        " and after it as trials of their own"
    ),
    # Defects of sensors and commands.
    "held samples": lambda f: (
        f"samples repeat the one before: a sensor of about {f['rate_hz']:.2g} Hz in a table of"
        f" {f['table_hz']:.3g} Hz"
    ),
    "jumps": lambda f: (
        f"{_jumps(f)}; {f['samples']} samples beside them, or away between two less than {f['apart_s']:g} s"
        " apart, masked"
    ),
    "spikes": lambda f: f"{_many(f, 'spike')} masked",
    "constant": _constant,
    "angle constant": lambda f: (
        f"constant at {f['value']:.6g} rad over the whole recording while another angle changes; a sensor"
        " that is stuck? Map the right column, or leave this one out of the map"
    ),
    "above the surface": _above_surface,
    "pulses too long": lambda f: (
        f"{_many(f, 'pulse width')} above {f['most_us']:g} us; the one before is held instead"
    ),
    "commands constant": lambda f: (
        f"never change, so nothing about them can be identified: {', '.join(f['actuators'])}"
    ),
    "commands at extremes": lambda f: (
        "stay at their extreme values, perhaps saturated: "
        + ", ".join(f"{name} {extreme:.6g} ({_percent(share)})" for name, extreme, share in f["extremes"])
    ),
    "uncommanded": lambda f: (
        f"{_uncommanded(f)}; all channels are masked there. If a command was held there, add rows with its"
        " value to the log"
    ),
    "mostly masked": lambda f: (
        f"{_percent(f['share'])} of the samples are masked, most of them for {_cause_of_masks(f)}; look at"
        " these samples, and give another column or a part of the log if they are wrong"
    ),
    # Sensors against the pose.
    "attitude convention": lambda f: f"{convention(f.values)}; left as recorded",
    "frame tilted": _tilt,
    "latency not estimated": lambda f: (
        f"latency not estimated: a position every {f['interval_s']:.2g} s is too slow for it"
    ),
    "latency unclear": _no_latency,
    "latency removed": _latency_removed,
    "latency uncertain": _latency_uncertain,
    "not following": lambda f: f"does not follow the recorded pose ({f['follows']}); check the column map",
    "sign on a lever arm": lambda f: (
        f"{_opposite(f)}, as a sensor with a lever arm does; left as recorded. Give the position of the"
        " sensor"
    ),
    "sign left": lambda f: (
        f"{_opposite(f)}; left as recorded. Reverse it with signs.{f.subject} = -1 under corrections"
    ),
    "sign doubtful": _sign_doubtful,
    "sign reversed": _sign_reversed,
    "unit of the reference": _unit_of_reference,
    "unit of the sensor": _unit_of_sensor,
    # What was corrected, derived, or is not there.
    "correction given": _given,
    "lever arm": _arm,
    "lever arm ignored": lambda f: (
        f"lever arm ignored: moving the sensor to O needs the {f['needed']}, not recorded"
    ),
    "not recorded": lambda f: f"not recorded: {' '.join(f['channels'])}",
    "derived": lambda f: (
        f"derived from {'the attitude' if f['origin'] == ('attitude',) else 'position and attitude'} by"
        " smoothing differentiation"
    ),
    "current derived": _current,
    "current not derived": lambda f: (
        "not derived: too few samples have both velocity over ground and velocity through the water"
    ),
}
"""What was found about a channel of a recording, by kind."""
