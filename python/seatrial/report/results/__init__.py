"""The words of all results: which module writes those of which class.

Results lie in rooms below and know no words; `seatrial.base.report.report_of` comes here. Each module has a
function ``report``, and ``junit`` where a result is a verdict. Held by ``tests/report/test_report.py``.
"""

from __future__ import annotations

import importlib
from types import ModuleType

WRITERS = {
    "AutopilotCheck": "check_autopilot",
    "BenchTest": "bench_test",
    "CampaignCheck": "check_campaign",
    "FailureBoundary": "surveys",
    "Falsification": "surveys",
    "Flight": "flight",
    "Identification": "identification",
    "Imported": "imported",
    "LogTuning": "ardusub",
    "LogVerdict": "mission_log",
    "Plan": "plan",
    "RareFailures": "surveys",
    "Tuning": "tuning",
    "VehicleCheck": "check_vehicle",
    "Verification": "verification",
}
"""Module of this folder by the name of the result's class."""


def writer_of(result: object) -> ModuleType:
    """Module that writes the words of a result.

    Parameters
    ----------
    result : object
        Of a class named in `WRITERS`, or of one derived from it.

    Raises
    ------
    TypeError
        No report is written of such an object.
    """
    for kind in type(result).__mro__:
        if name := WRITERS.get(kind.__name__):
            return importlib.import_module(f"{__name__}.{name}")
    raise TypeError(f"expected a result that has a report, found {type(result).__name__}")
