"""The words of what is known before a search, and of what draws of the coefficients do.

Held by ``tests/check/test_check_campaign.py`` and ``tests/identification/test_coefficient_covariance.py``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seatrial.base.channels import MOTIONS
from seatrial.base.finding import Finding
from seatrial.base.report import listed
from seatrial.report.results import scale


def sentence(finding: Finding) -> str:
    """A finding in words."""
    return _SENTENCES[finding.kind](finding)


def _repeated(finding: Finding) -> str:
    count = len(finding["trials"])
    return (
        f"trials {listed(finding['trials'])} hold the same recording, which counts {count} times: deviations"
        f" come out up to {np.sqrt(count):.2g} times too small; keep one of them"
    )


def _held(finding: Finding) -> str:
    names = finding["names"]
    example = next((name for name in names if "." in name), names[0])
    return (
        f"{', '.join(names)}: not identified, dominated by feedback; draws keep the vehicle file's values. To"
        f' vary them, give percent: coefficients = {{ "{example}" = 20.0 }} under [verification].'
    )


_SENTENCES: dict[str, Callable[[Finding], str]] = {
    "start diverges": lambda f: (
        f"stage {f.subject!r}: the vehicle that the search starts from diverges on its trials; give damping"
        " to its free axes, check the signs and units of its coefficients, or narrow the bounds"
    ),
    "axis without commands": lambda f: (
        f"{MOTIONS[f.subject]} is driven by {', '.join(f['drivers'])}, of which no trial records a command:"
        f" {', '.join(f['kept'])} not identified, kept at the vehicle file's values. Map their columns, or"
        " add columns of zeros if they stood still"
    ),
    "columns missing": lambda f: (
        f"no column {f.subject} in {', '.join(f['trials'])}: taken to stand still there"
    ),
    "recording repeated": _repeated,
    "draws of a stage": lambda f: (
        f"{', '.join(f['names'])}: set by a stage and not in the joint estimate, so there is no standard"
        " deviation; draws keep the estimate."
    ),
    "draws of held": _held,
    "draws within a class": lambda f: (
        f"{f['warning']}. Draws stay within that class; to cover what it lacks, add deviations such as"
        ' coefficients = { "*_uu" = 10.0 } under [verification].'
    ),
    "draws of one scale": lambda f: (
        f"{scale.rests_on(f['homogeneity'])}; draws do not vary it, all forces and masses together may be"
        " larger or smaller."
    ),
    "draws at a bound": lambda f: f"{', '.join(f['names'])}: ended at a bound, and draws keep it there.",
    "draws between bounds": lambda f: (
        f"{', '.join(f['names'])}: constrained less by the data than by the campaign's bounds; draws have the"
        " spread of a uniform distribution between them (standard deviation 0.29 of their width), and"
        " correlated coefficients vary less as a result."
    ),
}
