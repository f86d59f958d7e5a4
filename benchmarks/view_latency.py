"""From the end of a drag to the new prediction on the screen of `pushgraph view`, for 9 bodies and a push of 30 cm.

A real browser (Chromium, driven by playwright) drags the end of the push; what is timed is the page's own clock, from
the release of the button to the second picture after everything that the new prediction changes has come:

    taskset -c 0 python benchmarks/view_latency.py [--graphics]

Without a graphics card, pictures are drawn in software, which is slow; so they are left out unless --graphics is given:
what is timed then is everything but the work of a graphics card. The server's own share is timed, too.
"""

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import browser, opened
from person import Person

import pushgraph as pg
from pushgraph.view.page import Page

WATCH = """
window.released = 0; window.shown = {};
addEventListener("pointerup", () => { window.released = performance.now(); }, true);
new MutationObserver(() => {
  const found = /drag (\\d+)\\./.exec(document.body.innerText);
  if (!found || window.shown[found[1]]) return;
  window.shown[found[1]] = -1;
  requestAnimationFrame(() => requestAnimationFrame(() => {
    window.shown[found[1]] = performance.now() - window.released;
  }));
}).observe(document, { subtree: true, childList: true, characterData: true });
"""


def nine_bodies() -> pg.Scene:
    """A loose grid, and a push through its middle row."""
    shapes = (pg.Cuboid(size=(0.1, 0.1)), pg.Cylinder(diameter=0.1))
    bodies = tuple(
        pg.Body(name=f"b{k}", shape=shapes[k % 2], pose_world_from_body=(0.13 * (k % 3), 0.13 * (k // 3), 0), mass=0.5)
        for k in range(9)
    )
    push = pg.Push(start=(-0.1, 0.13), end=(0.2, 0.13))
    return pg.Scene(bodies=bodies, tool=pg.Tool.round(0.05), pushes=(push,))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--graphics", action="store_true")
    parser.add_argument("--drags", type=int, default=21)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, Page(nine_bodies(), folder=folder) as page, browser() as chromium:
        page.ready()
        server_ms = _mark_answers(page)
        with opened(chromium, page.url, (1200, 800), drawing=arguments.graphics) as seen:
            person = Person(page, seen)
            seen.page.evaluate(WATCH)
            screen_ms = []
            for drag in range(arguments.drags + 1):
                end = person.knob("push/0/end")
                answered = len(server_ms)
                person.drag(end, np.array([0.2, 0.13 + 0.005 * (1 + drag % 2), end[2]]))
                person.until(lambda before=answered: len(server_ms) > before)
                ask = f"() => window.shown[{len(server_ms)}] > 0 && window.shown[{len(server_ms)}]"
                screen_ms.append(seen.page.wait_for_function(ask).json_value())
    for what, times in (("server", server_ms[1:]), ("screen", screen_ms[1:])):  # the first warms up
        low, middle, high = np.quantile(times, (0.05, 0.5, 0.95))
        print(f"{what}: median {middle:.0f} ms, 90 % between {low:.0f} and {high:.0f} ms, {len(times)} drags")
    print("below 150 ms" if statistics.median(screen_ms[1:]) < 150 else "above 150 ms")


def _mark_answers(page: Page) -> list[float]:
    """Number the answers, as a message on the page that comes with all else; returns the server's times (ms)."""
    session, server_ms = page.session, []
    move, show = session.workbench.move_push_end, session.show
    begun = [0.0]

    def moved(*arguments: object) -> None:
        begun[0] = time.perf_counter()
        move(*arguments)

    def shown() -> None:
        with session.server.atomic():
            session.say(f"drag {len(server_ms) + 1}.")
            show()
        session.server.flush()
        server_ms.append(1e3 * (time.perf_counter() - begun[0]))

    session.workbench.move_push_end, session.show = moved, shown
    return server_ms


if __name__ == "__main__":
    main()
