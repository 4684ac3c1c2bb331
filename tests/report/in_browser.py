"""Pages in the system's Chromium: how a test opens one, and a look at a whole one as a program of its own.

python -m tests.report.in_browser report.html

A browser may wait for ever, and with it whoever asks it: who starts this program can end it.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

# No sandbox for a browser that may run as root; it opens files of these tests only. Containers have little
# shared memory.
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"]


@contextmanager
def chromium() -> Iterator[Browser]:
    """The browser at work."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        found = play.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield found
        found.close()


class Opened:
    """Opens pages whose vehicle flies, and keeps what went wrong in them."""

    def __init__(self, browser: Browser) -> None:
        self.browser, self.made = browser, list[Any]()
        self.errors: list[str] = []

    def __call__(self, path: Path, **settings: Any) -> Page:
        page = self.browser.new_context(**settings).new_page()
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda told: self.errors.append(told.text) if told.type == "error" else None)
        page.on(
            "request", lambda asked: self.errors.append(asked.url) if asked.url.startswith("http") else None
        )
        page.goto(path.as_uri())
        self.made.append(page)
        return page

    def close(self) -> None:
        """Close all pages; an error of a script is one of the test."""
        for page in self.made:
            page.context.close()
        assert self.errors == []


def assert_same_bits(page: Page, which: str, flights: Any) -> None:
    """Every column, row and figure of a flight in the page is that of Python to the last bit."""
    columns = page.evaluate(f"seatrial.{which}.columns")
    values = np.array(page.evaluate(f"Array.from(seatrial.{which}.values)"), float).reshape(-1, len(columns))
    expected = np.asarray(flights.log(0))
    assert columns == flights.columns
    assert values.shape == expected.shape
    other = {columns[k]: int(np.argmax(_differ(values, expected)[:, k])) for k in range(len(columns))}
    differing = {
        name: row for name, row in other.items() if _differ(values, expected)[row, columns.index(name)]
    }
    assert differing == {}, "columns that differ, from row"
    figures = page.evaluate(f"seatrial.{which}.figures")
    # The page counts waypoints reached besides; consistency of a filter it leaves out.
    of_both = [name for name in flights.figures if name in figures]
    assert set(figures) - set(of_both) == {"reached", "legs"}
    for name in of_both:
        expected = np.asarray(flights.figures[name], float)[:1]
        assert not _differ(np.array([figures[name]], float), expected), (name, figures[name], expected)


def _differ(values: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Whether the bits differ, the sign of zero included; all that is not a number is one."""
    same = values.view(np.int64) == expected.view(np.int64)
    return np.asarray(~(same | (np.isnan(values) & np.isnan(expected))))


def settled(page: Page, condition: str) -> None:
    """Waits for a condition; the page forbids to evaluate text, so the browser's own way fails."""
    for _ in range(200):
        if page.evaluate(f"Boolean({condition})"):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"{condition}; status: {page.text_content('[data-part=status]')}")


def assert_accessible(page: Page, options: str = "{}") -> None:
    """Nothing that axe-core calls serious or critical, with all that can be opened open."""
    package = find_spec("axe_playwright_python")
    assert package is not None
    assert package.origin is not None
    page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    page.evaluate("for (const one of document.querySelectorAll('.away')) one.classList.remove('away')")
    page.evaluate((Path(package.origin).parent / "axe.min.js").read_text(encoding="utf-8"))
    found = page.evaluate(f"axe.run({options})")
    assert found["passes"]
    bad = [
        (one["id"], one["help"], [node["html"][:200] for node in one["nodes"][:3]])
        for one in found["violations"]
        if one["impact"] in ("serious", "critical")
    ]
    assert bad == []


def look(path: Path) -> None:
    """A whole page, wide and light, then narrow and dark: it flies, answers, can be read and printed."""
    with chromium() as browser:
        opened = Opened(browser)
        for width, theme in ((1280, "light"), (390, "dark")):
            page = opened(path, viewport={"width": width, "height": 900}, color_scheme=theme)
            settled(page, "window.seatrial && seatrial.changed && seatrial.core.idle")
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            gain = page.locator('input[data-control^="gain "]').first
            gain.focus()
            for _ in range(5):
                page.keyboard.press("ArrowRight")
            settled(page, "seatrial.core.idle && !seatrial.core.waiting.size && !seatrial.untouched()")
            assert (page.text_content("[data-part=status]") or "").startswith("Re-flown")
            print(theme, "re-flown", flush=True)
            page.locator("a[href='#both']").click()
            for name in page.evaluate(
                "[...document.querySelector('[data-control=loop]').options].map((x) => x.value)"
            ):
                page.locator("[data-control=loop]").select_option(name)
                assert page.locator("[data-part=margins] path.second").count() == 3, name
            # What a theme changes are colours.
            assert_accessible(page, "{}" if theme == "light" else "{runOnly: ['color-contrast']}")
            print(theme, "accessible", flush=True)
            if theme == "light":
                assert len(page.pdf()) > 10_000
                print(theme, "printed", flush=True)
            page.locator("button[data-act=reset]").click()
            settled(page, "seatrial.core.idle && seatrial.changed && seatrial.untouched()")
        opened.close()


if __name__ == "__main__":
    look(Path(sys.argv[1]))
