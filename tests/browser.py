"""A real browser for tests: Chromium, headless, with graphics drawn in software; without one the test is skipped."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

SWITCHES = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
NAMES = ("chromium", "chromium-browser", "google-chrome")
AS_A_CARD = """
const asked = WebGL2RenderingContext.prototype.getParameter;
WebGL2RenderingContext.prototype.getParameter = function (name) {
  return name === 0x9246 ? "a graphics card" : asked.call(this, name);
};
"""
"""viser warns of graphics drawn in software, which is what a test has: the warning would cover the page."""
WITHOUT_DRAWING = """
for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"])
  WebGL2RenderingContext.prototype[name] = () => { window.drawn = (window.drawn || 0) + 1; };
"""
"""Leaves out what a graphics card does: what remains is the page's own work. `window.drawn` counts it."""
PATIENCE = 60_000
"""Milliseconds: software graphics are slow on a busy machine."""


@dataclass
class Opened:
    """A page, what its console called an error, and the addresses it asked for beyond its own server."""

    page: object
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@contextmanager
def browser() -> Iterator[object]:
    """Start Chromium; skip the test where it or playwright is not installed."""
    sync_api = pytest.importorskip("playwright.sync_api")
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip("no Chromium: apt-get install chromium")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found, headless=True, args=list(SWITCHES))
        try:
            yield chromium
        finally:
            chromium.close()


@contextmanager
def opened(
    chromium: object,
    address: str | Path,
    size: tuple[int, int] = (900, 640),
    *,
    drawing: bool = True,
    shows: str = "canvas",
    **context,
) -> Iterator[Opened]:
    """Open a server's address, or a file with the network cut off. drawing: False to leave out the graphics. shows: the
    element that is waited for."""
    offline = isinstance(address, Path)
    url = address.resolve().as_uri() if offline else address
    with_context = chromium.new_context(viewport={"width": size[0], "height": size[1]}, offline=offline, **context)
    with_context.add_init_script(AS_A_CARD)
    if not drawing:
        with_context.add_init_script(WITHOUT_DRAWING)
    page = with_context.new_page()
    page.set_default_timeout(PATIENCE)
    seen = Opened(page)
    page.on("console", lambda line: seen.errors.append(line.text) if line.type == "error" else None)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("request", lambda asked: seen.requests.append(asked.url) if not _own(asked.url, url) else None)
    try:
        page.goto(url)
        page.wait_for_selector(shows)
        yield seen
    finally:
        with_context.close()


def _own(asked: str, url: str) -> bool:
    return asked.startswith((url.split("?")[0].rstrip("/"), "data:", "blob:"))
