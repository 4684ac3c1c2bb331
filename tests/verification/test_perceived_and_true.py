"""Errors that guidance perceived, beside those of the vehicle itself: metrics, counts, and their note."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from seatrial._core import error_edges
from tests.verification.verifying import SHORT, campaign


def test_errors_that_guidance_saw_are_told_from_true_ones(tmp_path: Path) -> None:
    found = campaign(tmp_path).verify()
    metrics = found.flown.metrics
    perceived, true = metrics["cross_track_p95_m"], metrics["true_cross_track_p95_m"]
    settled = np.isfinite(perceived)
    assert np.isfinite(true).tolist() == settled.tolist()
    perceived, true = perceived[settled], true[settled]
    # The position is off by 1.5 m (1 sd) across the leg, as much as guidance itself.
    assert np.median(true) > 1.2 * np.median(perceived)
    (note,) = (one for one in found.notes if one.startswith("Errors that guidance perceived"))
    assert '"keeps its path" asks for' in note
    assert f"{np.median(perceived):.2g} m perceived, {np.median(true):.2g} m true" in note
    assert note in found.summary()
    names = [row.get("value") for row in ElementTree.fromstring(found.junit()).iter("property")]
    assert note in names
    # Counts are those of the metrics: above the p95 lies a twentieth of the samples, to the width of a bin.
    edges = np.asarray(error_edges())
    for counts, p95 in ((found.flown.perceived_counts, perceived), (found.flown.true_counts, true)):
        for row, value in zip(counts[settled], p95, strict=True):
            above = 1.0 - row.cumsum() / row.sum()  # above each edge
            place = int(np.searchsorted(edges, value))
            assert above[place] <= 0.05 + 1e-9
            assert place == 0 or above[place - 1] >= 0.05 - 1e-9
    perfect = campaign(tmp_path, SHORT.replace("runs = 24", 'runs = 4\nsensors = "perfect"')).verify()
    assert not any("guidance perceived" in note for note in perfect.notes)
    same = perfect.flown.metrics
    np.testing.assert_allclose(same["cross_track_rms_m"], same["true_cross_track_rms_m"], rtol=1e-9)
