"""The constraint criterion that the core adds up in flight, against that of the flight's log."""

from __future__ import annotations

import numpy as np

import seatrial as st
from seatrial.control_design.corridor import Corridor
from seatrial.tuning.criterion import normalised, time_weighted_error, violations
from tests.flight.flying import OUT

AT_S, BEFORE, AFTER = 10.0, 1.0, 1.4
# No surge loop stands still for 4 s and is there at once: both sides are violated.
CORRIDOR = Corridor(
    [(0.0, -0.1), (4.0, -0.1), (4.0, 0.9), (20.0, 0.99)], [(0.0, 0.1), (4.0, 0.1), (4.0, 1.01), (20.0, 1.01)]
)


def test_core_and_front_add_up_the_same_areas() -> None:
    since = 0.1 * np.arange(350.0) - AT_S
    lower, upper = CORRIDOR.sampled(since)
    target = np.full(len(since), CORRIDOR.target)
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(OUT),
        water=st.Water(current=[[0.0, 0.0, 0.0], [0.0, 0.2, 0.0]]),
        set_points={"times": [0.0, AT_S], "speed": [BEFORE, AFTER]},
        corridors=[("u", [BEFORE] * 2, [AFTER - BEFORE] * 2, lower, upper, target, CORRIDOR.clock(since))],
        conditions=st.Conditions(max_time_s=34.0),
        logs=True,
    )
    for case in range(2):
        log = dict(zip(flights.columns, np.asarray(flights.log(case)).T, strict=True))
        t, y = flights.t(case) - AT_S, normalised(log["u"], BEFORE, AFTER)
        sums = [*violations(t, y, CORRIDOR), time_weighted_error(t, y, CORRIDOR)]
        assert min(sums) > 0.01
        # 200 terms that are added up in another order.
        np.testing.assert_allclose(flights.violations[case, 0], sums, rtol=1e-12)
