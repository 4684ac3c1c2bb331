"""A thousand mutated files of each kind: see `tests.check.fuzzed_files`."""

from __future__ import annotations

import pytest

from tests.check.fuzzed_files import USES, fuzz, seeds

pytestmark = pytest.mark.long


@pytest.mark.parametrize("kind", USES)
def test_the_files_that_ship_are_accepted(kind: str) -> None:
    texts = seeds()[kind]
    assert texts
    for seed, text in texts.items():
        USES[kind](text, seed)


@pytest.mark.parametrize("kind", USES)
def test_mutated_files_are_refused_or_give_finite_numbers(kind: str) -> None:
    counts, wrong = fuzz(kind, 600)
    assert wrong == []
    # Neither all nor none: the mutations are small, and most of them are mistakes.
    assert counts["accepted"] > 30
    assert counts["refused"] > 300
