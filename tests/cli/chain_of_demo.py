"""What `seatrial demo --json` has to show of CWolf's chain from logs to verdict, for `make test-wheel-demo`.

python tests/cli/chain_of_demo.py demo.json
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

NEARLY_S = 0.05
"""Seconds outside the corridors over all responses that another processor's rounding may leave: the start
gains diverge."""


def _seconds(found: float | None) -> float:
    """Seconds outside; a response that diverges has none."""
    return math.inf if found is None else found


def complaints(found: dict[str, Any]) -> list[str]:
    """What of the chain does not hold."""
    performance = {row["name"]: _seconds(row["nominal_s"]) for row in found["cwolf_tuning"]["performance"]}
    on_truth = _seconds(found["cwolf_tuned_on_truth"]["nominal_s"])
    checks = {
        f"the start gains leave their corridors, found {performance['start']} s outside": performance["start"]
        > 100.0,
        f"the tuned gains keep to them, found {performance['tuned']} s outside": performance["tuned"]
        < NEARLY_S,
        f"they do so on the truth, found {on_truth} s outside": on_truth < NEARLY_S,
        "the verdict on drawn vehicles is held": found["cwolf_verification"]["outcome"] == "held",
        "the verdict on the truth is held": found["cwolf_verification_on_truth"]["outcome"] == "held",
    }
    return [f"expected: {words}" for words, holds in checks.items() if not holds]


if __name__ == "__main__":
    wrong = complaints(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    sys.exit("\n".join(wrong) or 0)
