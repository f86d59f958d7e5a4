"""How long `pushgraph view TRACK` takes until 10,000 frames of 9 bodies are seen, and how fast 60 bodies play.

In headless Chromium, graphics drawn in software:

    python benchmarks/view_opening.py [--size 640x360]

Timed are the command, from its start until the page can be opened; then, from the navigation on, the first picture that
holds the whole scene; and pictures a second of 60 bodies that all move in each of 30 frames a second. Where others keep
the machine busy, the processors' own time, which is told beside it, says more.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import AS_A_CARD, browser
from test_view_looks import wandering

from pushgraph.view.drawing import SceneDrawing
from pushgraph.view.server import start_server

COUNT = """
window.calls = window.pictures = window.whole = 0;
for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...all) { window.calls++; return draw.apply(this, all); };
}
let before = 0;
const look = () => {
  const calls = window.calls - before;
  before = window.calls;
  if (calls) window.pictures++;
  if (calls > 12 && !window.whole) requestAnimationFrame(() => { window.whole = performance.now() / 1000; });
  requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
"""`whole`: when the first picture of many parts was done (s after the navigation)."""
PLAYED = 8.0
"""So long 60 bodies play (s)."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="640x360")
    width, height = map(int, parser.parse_args().size.split("x"))
    viewport = {"width": width, "height": height}
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        wandering(9, 10_000).save(Path(folder) / "track.h5")
        begun = time.monotonic()
        command = [sys.executable, "-m", "pushgraph", "view", "track.h5", "--no-browser"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder) as serving:
            url = next(filter(None, (re.search(r"http://[\d.:]+", line) for line in serving.stdout)))[0]
            print(
                f"command until the page is there: {time.monotonic() - begun:.1f} s, {processor(serving.pid):.1f} s CPU"
            )
            for number in ("first", "again"):
                page = opened(chromium, url, viewport)
                page.wait_for_function("window.whole > 0", timeout=60_000)
                print(f"{number}: seen {page.evaluate('window.whole'):.1f} s after the navigation")
                page.context.close()
            serving.terminate()
        play(chromium, viewport)


def opened(chromium: object, url: str, viewport: dict[str, int]) -> object:
    context = chromium.new_context(viewport=viewport)
    context.add_init_script(AS_A_CARD + COUNT)
    page = context.new_page()
    page.goto(url)
    return page


def play(chromium: object, viewport: dict[str, int]) -> None:
    server = start_server()
    drawing = SceneDrawing(server)
    drawing.show_track(wandering(60, 600))
    page = opened(chromium, f"http://127.0.0.1:{server.get_port()}", viewport)
    page.wait_for_function("window.whole > 0", timeout=60_000)
    page.wait_for_timeout(3000)
    before, begun = page.evaluate("[window.pictures, window.calls]"), time.monotonic()
    while time.monotonic() - begun < PLAYED:
        drawing.set_frame(int(30 * (time.monotonic() - begun)))
        server.flush()
        time.sleep(1 / 30)
    pictures, calls = (
        now - old for now, old in zip(page.evaluate("[window.pictures, window.calls]"), before, strict=True)
    )
    print(f"60 bodies: {pictures / PLAYED:.1f} pictures a second, {calls / max(pictures, 1):.0f} calls each")
    server.stop()


def processor(process: int) -> float:
    """Time of the processor that a process has used (s)."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100


if __name__ == "__main__":
    main()
