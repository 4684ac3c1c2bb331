"""The table [verification]: its defaults, its short forms, and what it refuses in a sentence."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from seatrial.base.errors import CampaignError
from seatrial.verification.table import DistributionTable, VerificationTable, parse_verification


def parsed(text: str, *, missions: str = '"farm.toml"') -> VerificationTable:
    return parse_verification(f"[verification]\nmissions = [{missions}]\n{text}", "campaign.toml")


def test_missions_alone_suffice() -> None:
    table = parsed("")
    assert (table.runs, table.sensors, table.coefficients) == (1000, "typical", "covariance")
    assert (table.faults, table.outages, table.requirements) == ((), (), ())
    assert table.current.direction_deg.uniform == (0.0, 360.0)
    assert table.obstacles[0].from_mission


def test_the_whole_table_is_read() -> None:
    table = parsed(
        """
        runs = 2000
        sensors = "perfect"
        confidence = 0.99
        keep_worst = 0
        coefficients = { "*_uu" = 10.0 }
        seabed = 30
        voltage_v = 48
        max_time_s = 2000
        obstacles = [{ from_mission = true }, { north_m = 1.0, east_m = 2.0, radius_m = 0.0 }]
        [verification.current]
        speed_m_s = { rayleigh = 0.1 }
        direction_deg = [80, 100]
        vertical_m_s = 0.02
        turbulence_m_s = 0.05
        turbulence_times_s = [30.0, 1.0]
        [[verification.faults]]
        actuator = "stern"
        kind = "stuck"
        probability = 0.05
        between_s = [10.0, 20.0]
        [[verification.outages]]
        sensor = "dvl"
        probability = 0.1
        duration_s = [5, 30]
        [verification.start]
        position_m = 2.0
        heading_deg = "any"
        speed_m_s = { normal = [1.0, 0.2] }
        [[verification.requirements]]
        name = "keeps its path"
        holds = "cross_track_p95_m <= 1.0"
        probability = 0.99
        """,
        missions='"a/farm.toml", { file = "b/farm.toml", name = "second", weight = 3 }',
    )
    assert [mission.title for mission in table.missions] == ["farm", "second"]
    assert table.current.direction_deg.uniform == (80.0, 100.0)
    assert table.seabed is not None
    assert table.seabed.depth_m == 30.0
    assert table.start.heading_deg.uniform == (-180.0, 180.0)
    assert table.outages[0].duration_s.uniform == (5.0, 30.0)
    assert table.requirements[0].probability == 0.99


def test_one_entry_needs_no_list() -> None:
    table = parse_verification('[verification]\nmissions = "farm.toml"\nfaults = { probability = 0.1 }', "c")
    assert [mission.file for mission in table.missions] == ["farm.toml"]
    assert table.faults[0].actuator == "any"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("run = 3", "unknown key 'run'; did you mean \"runs\"?"),
        ("runs = 0", "key runs: expected greater than 0, found 0"),
        ("confidence = 95", "key confidence: expected less than 1, found 95"),
        ('coefficients = "covarience"', 'did you mean "covariance"'),
        ("coefficients = { X_u = true }", "'X_u': expected percent above 0 and below 100, found True"),
        ("current = { speed = 0.3 }", "unknown key 'speed'; did you mean \"speed_m_s\""),
        ("current = { speed_m_s = -1.0 }", "key speed_m_s: expected values from 0 on, found -1"),
        ("current = { speed_m_s = { normal = [-0.1, 0.2] } }", "expected a mean from 0 on, found -0.1"),
        ("current = { speed_m_s = { norml = [0.1, 0.2] } }", "unknown key 'norml'; did you mean \"normal\""),
        ("current = { speed_m_s = { fixed = 1.0, rayleigh = 0.2 } }", "found fixed and rayleigh"),
        ("current = { speed_m_s = [0.4, 0.1] }", r"from <= to, found \[0.4, 0.1\]"),
        ('current = { speed_m_s = "fast" }', r"expected a number, \[from, to\], or one of uniform"),
        ("current = { speed_m_s = true }", "found true"),
        ('current = { direction_deg = "north" }', 'expected degrees, \\[from, to\\] or "any", found'),
        ("current = { direction_deg = { rayleigh = 1.0 } }", "an angle is a number, uniform or normal"),
        ("start = { heading_deg = -3.0 }", "expected a standard deviation from 0 on, found -3"),
        ('start = { heading_deg = "all" }', 'expected a standard deviation in degrees or "any"'),
        ("faults = { probability = 2.0 }", "expected less than or equal to 1, found 2.0"),
        ("faults = { probability = 0.1, command = 3.0 }", 'add kind = "stuck" or leave it out'),
        ("faults = { probability = 0.1, between_s = [3.0, 1.0] }", r"from <= to, found \[3, 1\]"),
        ('outages = { sensor = "gps", probability = 0.1 }', "duration_s: this key is required and missing"),
        ("obstacles = [{ north_m = 1.0 }]", "expected north_m, east_m and radius_m, or from_mission = true"),
        ("obstacles = [{ from_mission = true, north_m = 1.0 }]", "found north_m beside it"),
        ("seabed = { depth = 3.0 }", "unknown key 'depth'; did you mean \"depth_m\""),
        ('requirements = [{ name = "x", hold = "a < 1" }]', "unknown key 'hold'; did you mean \"holds\""),
        (
            'requirements = [{ name = "x", holds = "a < 1" }, { name = "x", holds = "b < 1" }]',
            "requirements: the name 'x' stands twice",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_by_its_key(text: str, message: str) -> None:
    with pytest.raises(CampaignError, match=message):
        parsed(text)


def test_missions_of_one_name_are_refused() -> None:
    with pytest.raises(CampaignError, match="missions: the name 'farm' stands twice"):
        parsed("", missions='"a/farm.toml", "b/farm.toml"')


def test_missing_missions_are_asked_for() -> None:
    with pytest.raises(CampaignError, match="missions: this key is required and missing"):
        parse_verification("[verification]\nruns = 5", "campaign.toml")
    with pytest.raises(CampaignError, match="expected at least one entry"):
        parsed("", missions="")


@given(
    u=some.floats(1e-6, 1.0 - 1e-6),
    entry=some.sampled_from([
        {"uniform": (0.2, 0.7)},
        {"normal": (0.3, 0.2)},
        {"rayleigh": 0.4},
        {"weibull": (0.4, 1.7)},
    ]),
)
def test_law_quantiles_are_the_inverse_of_the_distribution(u: float, entry: dict[str, object]) -> None:
    from scipy import stats

    frozen = {
        "uniform": stats.uniform(0.2, 0.5),
        "normal": stats.norm(0.3, 0.2),
        "rayleigh": stats.rayleigh(scale=0.4),
        "weibull": stats.weibull_min(1.7, scale=0.4),
    }[next(iter(entry))]
    value = DistributionTable.model_validate(entry).quantiles(np.array([u]))[0]
    assert frozen.cdf(value) == pytest.approx(u, rel=1e-9)  # special functions, not samples


def test_speeds_and_times_are_cut_at_zero() -> None:
    from scipy import stats

    u = np.array([1e-9, 0.5, 1.0 - 1e-9])
    values = DistributionTable(normal=(0.1, 0.2)).quantiles(u, above_zero=True)
    expected = stats.truncnorm(-0.5, np.inf, 0.1, 0.2).ppf(u)
    np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-12)
    assert (values >= 0.0).all()


def test_the_format_imports_no_heavy_library() -> None:
    code = (
        "import sys; before = set(sys.modules); import seatrial.verification.table;"
        "print([name for name in ('scipy', 'polars', 'matplotlib', 'control') if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
