"""What is counted of many flights: too near, on the bottom, above the surface, pitched too far."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.flight.excesses import excesses, unkept
from seatrial.report.results.flight_findings import excess_clauses


def _metrics(**changed: tuple[float, ...]) -> dict[str, np.ndarray]:
    calm = {
        "clearance_m": (np.inf, 6.0, 5.0),
        "clearance_reserve_m": (np.inf, 1.0, 0.0),
        "clearance_time_s": (np.nan, 10.0, 20.0),
        "altitude_smallest_m": (np.inf, 3.0, 0.1),
        "depth_largest_m": (4.0, 8.04, 5.0),
        "depth_smallest_m": (0.0, -0.05, 1.0),
        "depth_smallest_time_s": (0.0, 1.0, 2.0),
        "pitch_largest_deg": (5.0, 44.0, 10.0),
        "pitch_time_s": (3.0, 4.0, 5.0),
    }
    return {name: np.array(values) for name, values in (calm | changed).items()}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"clearance_m": (4.4, 6.0, -0.2), "clearance_reserve_m": (-0.6, 1.0, -5.2)},
            "2 of 3 flights came too near to an obstacle, the worst is c: 0.20 m inside"
            " (promised: 5 m) at 20.0 s",
        ),
        (
            {"clearance_m": (4.9, 6.0, -0.2), "clearance_reserve_m": (4.9, 1.0, -0.2)},
            "1 of 3 flights came too near to an obstacle, the worst is c: 0.20 m inside at 20.0 s",
        ),
        (
            {"altitude_smallest_m": (np.inf, -0.3, 0.0)},
            "2 of 3 flights touched the bottom, the worst is b: 0.30 m below it",
        ),
        (
            {"depth_smallest_m": (0.0, -0.4, 1.0)},
            "1 of 3 flights rose above the surface, the worst is b: 0.4 m",
        ),
        (
            {"pitch_largest_deg": (50.0, 70.0, np.nan)},
            "2 of 3 flights pitched beyond 45 deg, the worst is b: 70",
        ),
    ],
)
def test_each_kind_tells_how_many_and_the_worst(changed: dict[str, tuple[float, ...]], words: str) -> None:
    assert excesses(_metrics(), 5.0) == []
    (sentence,) = excess_clauses(excesses(_metrics(**changed), 5.0), "abc".__getitem__, "flights")
    assert sentence.startswith(words)


def test_limits_of_depth_and_altitude_are_broken_beyond_the_ripple_of_a_loop() -> None:
    limits = {"max_depth_m": 8.0, "min_altitude_m": 0.1}
    assert not any(broken.any() for broken in unkept(_metrics(), 5.0, limits).values())
    changed = {"depth_largest_m": (4.0, 9.5, 8.2), "altitude_smallest_m": (np.inf, 0.02, -0.1)}
    broken = unkept(_metrics(**changed), 5.0, limits)
    assert {kind: mask.tolist() for kind, mask in broken.items() if mask.any()} == {
        "bottom_touched": [False, False, True],
        "too_low": [False, True, False],
        "too_deep": [False, True, True],
    }
    found = excesses(_metrics(**changed), 5.0, **limits)
    assert excess_clauses(found, "abc".__getitem__, "flights")[1:] == [
        "1 of 3 flights came below the mission's least altitude of 0.1 m, the worst is b: 0.02 m",
        "2 of 3 flights went beyond the mission's largest depth of 8 m, the worst is b: 9.50 m",
    ]


def test_an_incomplete_flight_and_an_empty_battery_are_excesses() -> None:
    metrics = _metrics() | {"energy_wh": np.array([10.0, 90.0, 95.0])}
    found = excesses(metrics, 5.0, complete=np.array([True, False, True]), battery_wh=80.0)
    assert [(one.kind, one.count, one.worst) for one in found] == [("not_complete", 1, 1), ("battery", 2, 2)]
    assert found[1].to_dict()["share"] == pytest.approx(2 / 3)
