"""The bench test that a campaign names: of the same vehicle, evaluated once for all variants of the campaign.

Held by ``test_a_bench_record_that_changes_is_read_again`` and tests/test_bad_input.py.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.errors import CampaignError

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test import BenchTest

__all__ = ["bench_test"]


def bench_test(path: Path, vehicle: Vehicle, where: str) -> BenchTest:
    """Bench test of a campaign's vehicle from its file; the same records are evaluated once.

    Parameters
    ----------
    path : Path
        Bench file.
    vehicle : Vehicle
        The campaign's, before the test.
    where : str
        Beginning of messages.

    Raises
    ------
    CampaignError
        There is no such file, or it tests another vehicle.
    """
    from seatrial.bench_test.evaluate import fingerprint, vehicle_of

    if not path.is_file():
        raise CampaignError(f"{where}: there is no file {path}; correct the path or remove the key")
    tested = vehicle_of(path)
    if tested.name != vehicle.name:
        raise CampaignError(
            f"{where}: {path} tests the vehicle {tested.name}, and the campaign"
            f" identifies {vehicle.name}; name the same vehicle in both"
        )
    return _benched(str(path.resolve()), fingerprint(path), vehicle.to_toml())


@functools.lru_cache(maxsize=4)
def _benched(path: str, _fingerprint: str, vehicle: str) -> BenchTest:
    from seatrial._core import Vehicle
    from seatrial.bench_test import bench

    return bench(path, vehicle=Vehicle.from_toml(vehicle, path))
