"""Terms and symbols of a page in words: those that its runs mention, and no others.

Held by ``tests/report/test_page_tables.py``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_ALWAYS = ""

_TERMS: tuple[tuple[str, str, str], ...] = (
    (
        "10 s ahead",
        r"\bahead\b",
        "Prediction from a measured state by the commands alone, for so long; then it begins anew"
        " from the next measured state.",
    ),
    (
        "baseline, best simple predictor",
        r"baseline|simple predictor|first order",
        "What a prediction must beat: the last value held, the mean, a first-order lag of each axis,"
        " a linear model.",
    ),
    ("breakpoint", r"breakpoint", "A speed at which the gains are given; between two they are interpolated."),
    ("clearance", r"clear", "Smallest distance of the hull from obstacles."),
    (
        "corridor",
        r"corridor",
        "Bounds of a step response over the time since the step: how soon it must rise, how far it"
        " may overshoot, from when on it must stay settled.",
    ),
    (
        "correlation",
        r"correlat",
        "How much two estimates depend on one another, -1 to 1; near either end the data tell a"
        " combination of both, not each by itself.",
    ),
    (
        "cross-track error",
        r"cross[- _]track",
        "Distance from the leg of the mission, to starboard positive, at right angles to it.",
    ),
    ("delay margin", r"delay", "Dead time that a loop bears beyond what is modelled before it is unstable."),
    (
        "disk margin",
        r"\bdisk\b",
        "Gain and phase at once: the size of the disk of changes that a loop bears; 2 is the largest,"
        " 0 the edge of stability (Seiler, Packard and Gahinet, 2020).",
    ),
    (
        "drawn vehicle",
        r"\bdrawn\b",
        "A vehicle whose coefficients are drawn at random from the covariance of the identification:"
        " as likely as the data leave it.",
    ),
    (
        "free run",
        r"free run",
        "One simulation over a whole trial from its first state, by the commands alone.",
    ),
    (
        "gain margin",
        r"\bgain margin|up, dB|gain,? dB",
        "Factor by which a loop's gain may grow (upwards) or fall (downwards) before the loop is"
        " unstable, in dB.",
    ),
    (
        "held out",
        r"[Hh]eld[- ]out|hold_out",
        "Data that nothing was fitted to; a score on them tells how the model predicts what it has not seen.",
    ),
    (
        "hover, cruise",
        r"\bhover\b|\bcruise\b",
        "Modes of the autopilot: which actuators hold depth, thrusters in hover, pitch in cruise.",
    ),
    (
        "identifiable",
        r"identifi(able|ed)",
        "The data fix the coefficient; else the value of the vehicle file is kept or the interval is wide.",
    ),
    (
        "interval, 95 %",
        r"95 %",
        "Range that holds the true value in 19 of 20 cases, if the model is right; that of a share of"
        " failures allows for the number of missions.",
    ),
    ("joint estimate", r"joint", "All coefficients estimated at once over all trials, after the stages."),
    (
        "lookahead",
        r"lookahead",
        "Distance ahead on the leg at which guidance aims: shorter holds the path more tightly and is"
        " nearer to oscillation.",
    ),
    (
        "log-likelihood",
        r"log-likelihood",
        "Mean gain in the logarithm of the likelihood over the best baseline; above zero the model"
        " predicts better.",
    ),
    (
        "navigation filter",
        r"filter",
        "Kalman filter that joins the sensors and the model into one estimate of the motion.",
    ),
    (
        "normalised innovation squared",
        r"innovation",
        "Squared difference of measured and expected over its expected variance: 1 where the filter"
        " is as sure as it should be.",
    ),
    (
        "nuisance parameter",
        r"nuisance",
        "Offset of a sensor or current of a trial, estimated with the coefficients so that they are"
        " not bent by it.",
    ),
    (
        "p, p value",
        r"(?<![\w/])p(?![\w/])",
        "As a test result: chance of a difference at least as large if there was none. As a channel:"
        " roll rate.",
    ),
    (
        "phase margin",
        r"phase",
        "Phase lag that a loop bears at the frequency where its gain is one before it is unstable.",
    ),
    (
        "R2, R²",
        r"R2|R²",
        "Share of the measured variance that a prediction explains: 1 is perfect, 0 no better than"
        " the mean, below zero worse.",
    ),
    (
        "requirement",
        r"requirement",
        "Condition on a mission with a probability; held where the interval of its share of failures"
        " is within what is allowed, undecided where more missions are needed.",
    ),
    ("residual", r"residual", "Measured minus simulated."),
    ("rms", r"\brms\b", "Root of the mean square."),
    (
        "robustness",
        r"robustness|reserve",
        "Distance of a mission from missing a requirement, in its unit or as a share; below zero it"
        " is missed.",
    ),
    (
        "saturated",
        r"saturated",
        "The loop asks for more than its actuators give: its demand or an actuator is at its limit.",
    ),
    ("SHA-256", _ALWAYS, "Fingerprint of a file: equal fingerprints, equal files."),
    ("seed", _ALWAYS, "Number that the random draws follow from; the same seed gives the same draws."),
    (
        "sensitivity",
        r"sensitivity",
        "Largest |1/(1 + L)| of a loop L: how much it amplifies disturbances; 1.4 to 2 is usual"
        " (Åström and Hägglund, 2006).",
    ),
    (
        "stage",
        r"\bstages?\b",
        "Step of the identification that frees some axes and estimates their coefficients from some"
        " of the trials.",
    ),
    ("step response", r"\bstep\b|responses", "What a loop does after its set point jumps."),
    ("trial", r"\btrials?\b", "A recording of commands and motion."),
    (
        "waves: significant height, peak period",
        r"[Ww]ave",
        "Mean of the highest third of the waves from trough to crest; period of the most energetic ones.",
    ),
)
"""Term, where the page mentions it (anywhere when empty), and what it means."""

_SYMBOLS = (
    ("x, y, z", "Forward, starboard, down on the vehicle; north, east, down where a position is told."),
    ("u, v, w", "Velocity forward, to starboard and down, m/s: surge, sway, heave."),
    ("p, q, r", "Rates of turn about x, y and z: roll, pitch, yaw."),
    ("X, Y, Z, K, M, N", "Forces along and moments about x, y and z."),
    (
        "N_rr, N_rdot",
        "A coefficient is named by the force or moment and what it grows with: N_rr is that of N with |r| r,"
        " N_rdot that with the acceleration of r. Damping and added mass are negative: they act against the"
        " motion (notation of SNAME, 1950; Fossen, 2021).",
    ),
    ("K_P, K_I, K_D", "Gains of a loop on its error, the error's integral, and its rate."),
    ("±", "One standard deviation of an estimate."),
)


def glossary(
    mentioned: str, vehicles: Iterable[Vehicle], *, coefficients: Iterable[str] = ()
) -> Mapping[str, list[tuple[str, str]]]:
    """Terms, symbols and coefficients with their meanings, of what a page mentions.

    Parameters
    ----------
    mentioned : str
        The text of the page.
    vehicles : iterable of Vehicle
        Whose coefficients are meant.
    coefficients : iterable of str, optional
        Coefficients that the page shows besides those in its text.

    Examples
    --------
    >>> import seatrial as st
    >>> found = glossary("N_rr has R2 0.9", [st.Vehicle.load("cwolf")])
    >>> [term for term, _ in found["Terms"]], [term for term, _ in found["Coefficients"]]
    (['R2, R²', 'SHA-256', 'seed'], ['N_rr'])
    """
    words = set(re.findall(r"[A-Za-z]\w*", mentioned)) | set(coefficients)
    facts: dict[str, tuple[str, str]] = {}
    for vehicle in vehicles:
        for name, one in vehicle.coefficient_info().items():
            if name in words and "_" in name:
                facts.setdefault(name, (name, f"{one['description']}, {one['unit']}"))
    return {
        "Terms": [(term, text) for term, where, text in _TERMS if not where or re.search(where, mentioned)],
        "Symbols": list(_SYMBOLS),
        "Coefficients": list(facts.values()),
    }
