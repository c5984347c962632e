"""A real headless Chromium for the tests of pages: Debian's, driven by playwright, which downloads nothing."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

from tests.lacking import lacks

PROGRAMS = ("chromium-headless-shell", "chromium", "google-chrome")
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
IMAGES = Path(__file__).parents[1] / "docs" / "images"
PATIENCE_MS = 60_000
WIDE = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}


@contextmanager
def browser() -> Iterator[Browser]:
    """Chromium; where none is installed the test is skipped with the reason, in CI it fails."""
    found = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if found is None:
        lacks(f"no browser: install the Debian package {PROGRAMS[0]}")
    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=found, args=list(FLAGS), timeout=PATIENCE_MS)
        try:
            yield running
        finally:
            running.close()


class Tab:
    """A page of a console, and everything that the browser complained about."""

    def __init__(self, browser: Browser, url: str, size: dict[str, int] | None = None, **options: Any) -> None:
        self.context = browser.new_context(viewport=size or WIDE, **options)  # type: ignore[arg-type]
        self.page: Page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.complaints: list[str] = []
        self.page.on("console", lambda each: self.complaints.append(each.text) if each.type == "error" else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: self.complaints.append(f"dialog: {dialog.message}"))
        self.page.goto(url)

    def text(self, mark: str = "") -> str:
        """All text of the page, or of the element of this mark."""
        return self.page.locator(f".mark-{mark}" if mark else "body").inner_text()

    def until(self, happened: Callable[[], Any], what: str) -> Any:
        """The first result that is true."""
        deadline = time.monotonic() + PATIENCE_MS / 1e3
        while not (found := happened()):
            assert time.monotonic() < deadline, f"waited for {what}; the page says: {self.text()[:3000]}"
            self.page.wait_for_timeout(50)
        return found

    def says(self, text: str) -> None:
        """Wait until the page shows this text."""
        self.until(lambda: text in self.text(), repr(text))

    def quiet(self, text: str) -> None:
        """Wait until the page shows this text no more."""
        self.until(lambda: text not in self.text(), f"{text!r} to go")

    def picture(self, name: str) -> None:
        """Write a screenshot to docs/images when UPDATE_IMAGES=1 is set; in any case it can be taken."""
        taken = self.page.screenshot()
        assert len(taken) > 10_000
        if os.environ.get("UPDATE_IMAGES") == "1":
            (IMAGES / name).write_bytes(taken)

    def close(self) -> None:
        self.context.close()
