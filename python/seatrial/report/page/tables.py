"""Tables that a page adds to those of a run's report: scores beside baselines, intervals with correlations.

Held by ``tests/report/test_page_tables.py``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from seatrial.base.report import Column, Table
from seatrial.report.page.run_folder import RunFolder

_STRONG = 0.3
"""Size of a correlation from which on it is named."""

_NAMED = 3


def baselines(run: RunFolder) -> list[dict[str, Any]]:
    """Per channel R2 on held-out data of the model and of the best simple predictor."""
    try:
        rivals = run.results["baselines"]
        ahead = run.results["scores"]["hold_out"]["ahead"]
        scores = (ahead["all"] if "all" in ahead else next(iter(ahead.values())))["channels"]
        rows = []
        for channel, score in scores.items():
            given = {name: rival[channel] for name, rival in rivals.items() if rival.get(channel) is not None}
            if not given or not isinstance(score, dict) or score.get("r2") is None:
                continue
            best = max(given, key=lambda name: float(given[name]))
            rows.append({"channel": channel, "model": score["r2"], "rival": best, "r2": given[best]})
    except (KeyError, TypeError, AttributeError):
        return []
    return rows


def intervals(run: RunFolder) -> Table | None:
    """Estimates of an identification with their 95 % intervals and the coefficients they depend on most.

    None for another run, or where no interval is known.
    """
    if run.kind != "identification":
        return None
    try:
        near = _correlated(run.results.get("covariance"))
        rows = [
            (
                coefficient["name"],
                coefficient["unit"],
                _digits(coefficient["estimate"]),
                *(_digits(end) for end in coefficient["interval"]),
                coefficient.get("verdict") or "",
                near.get(coefficient["name"], ""),
            )
            for coefficient in run.results.get("coefficients", ())
            if coefficient.get("interval") and None not in coefficient["interval"]
        ]
    except (KeyError, TypeError, ValueError):  # of another version
        return None
    heads = ("coefficient", "unit", "estimate", "95 % from", "to", "verdict", "depends most on (correlation)")
    columns = tuple(
        Column(head, align="right" if head in ("estimate", "95 % from", "to") else "left") for head in heads
    )
    title = "Intervals of the coefficients, and their correlations"
    note = f"Correlations of a size from {_STRONG:g} on, the {_NAMED} largest."
    return Table(title, columns, tuple(rows), note=note) if rows else None


def _correlated(covariance: Any) -> dict[str, str]:
    """Per coefficient the others that its estimate depends on most, with their correlations."""
    if not covariance or not covariance.get("names"):
        return {}
    names, matrix = list(covariance["names"]), np.array(covariance["matrix"], float)
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    correlations = matrix / np.outer(scale, scale) - np.eye(len(names))
    strongest = {}
    for name, row in zip(names, correlations, strict=True):
        order = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) >= _STRONG][:_NAMED]
        strongest[name] = ", ".join(f"{names[k]} {row[k]:+.2f}".replace("-", "\N{MINUS SIGN}") for k in order)
    return strongest


def _digits(value: float) -> str:
    return f"{value:.4g}".replace("-", "\N{MINUS SIGN}")
