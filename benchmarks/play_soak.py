"""Minutes of play in a real browser, as fast as it draws: whether server or page keep memory.

python benchmarks/play_soak.py [--minutes 10] [--seed 0]

Needs the extra play, playwright and a Chromium. Somebody plays by a seed: pushes by key, drags, replays,
other policies, a second robot, commands, overlays, new walks. After every minute of the session, at rest and
after both have collected their garbage, it prints the memory of this process, the JavaScript heap of the page
and its nodes, and how many frames a second of the clock server and page came to. Exits with 1 where one of
the three grows by more than its bar over the second half.
"""

from __future__ import annotations

import argparse
import gc
import random
import shutil
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from playwright.sync_api import CDPSession, Page, sync_playwright
from push_recovery.eval.play.browser import FRAME, App, open_app
from push_recovery.eval.play.gate import Gate
from push_recovery.eval.play.session import Session

POLICIES = ("two-stage", "stage-1", "stage-1+momentum")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--js-flags=--expose-gc"]
PICTURE = {"width": 800, "height": 320}
ACTS_EVERY, CATCHES_UP_EVERY = 2.0, 1.0  # of the session's time [s]
PATIENCE = 600e3  # [ms]
BARS = {"server [MiB]": 1.0, "page's heap [MiB]": 0.5, "page's nodes": 50.0}  # growth a minute


class Sample(NamedTuple):
    """What server and page hold."""

    minute: float
    values: dict[str, float]  # of BARS


class Player:
    """Somebody who plays, by a seed.

    Args:
        app: that is played with.
        page: that looks at it.
        seed: of what is done.
    """

    def __init__(self, app: App, page: Page, seed: int):
        self._app, self._page, self._random = app, page, random.Random(seed)  # noqa: S311  # a stated sequence
        self._kinds = (self._key, self._key, self._drag, self._replay, self._policy, self._beside, self._walk)

    def act(self) -> None:
        """Do one thing; a robot that lies begins anew first."""
        if self._app.session.first.over:
            self._page.keyboard.press("n")
        self._random.choice(self._kinds)()

    def _key(self) -> None:
        self._app.panel._psi.value = self._random.randint(-180, 180)
        self._page.keyboard.press("Space")

    def _drag(self) -> None:
        mouse = self._page.mouse
        mouse.move(400, 150)
        mouse.down()
        for way in (8, 14, 20):
            mouse.move(400 + way, 150 + self._random.randint(-10, 10))
            self._app.frame(FRAME)
        mouse.up()

    def _replay(self) -> None:
        self._page.keyboard.press("r")

    def _policy(self) -> None:
        self._app.panel._policy.value = self._random.choice(POLICIES)

    def _beside(self) -> None:
        self._app.panel._beside.value = self._random.choice(("nobody", *POLICIES))

    def _walk(self) -> None:
        self._app.panel._command[0].value = self._random.choice((0.0, 0.2, 0.4))
        box = self._random.choice(list(self._app.panel._shown.values()))
        box.value = not box.value


def played(app: App, player: Player, page: Page, seconds: float) -> None:
    """Let the session's time go by; the page keeps up with it."""
    since_act = since_look = 0.0
    for _ in range(round(seconds / FRAME)):
        app.frame(FRAME)
        since_act, since_look = since_act + FRAME, since_look + FRAME
        if since_act >= ACTS_EVERY:
            player.act()
            since_act = 0.0
        if since_look >= CATCHES_UP_EVERY:
            caught_up(app, page)
            since_look = 0.0


def caught_up(app: App, page: Page) -> None:
    """Wait until the page shows what it was told last."""
    mark = f"soak {time.monotonic_ns()}"
    app.server.gui.set_panel_label(mark)
    app.server.flush()
    page.get_by_text(mark).first.wait_for(timeout=PATIENCE)


def sample(minute: float, devtools: CDPSession) -> Sample:
    """What is held, after garbage has been collected."""
    gc.collect()
    devtools.send("HeapProfiler.collectGarbage")
    metrics = {entry["name"]: entry["value"] for entry in devtools.send("Performance.getMetrics")["metrics"]}
    values = resident(), metrics["JSHeapUsedSize"] / 2**20, metrics["Nodes"]
    return Sample(minute, dict(zip(BARS, values, strict=True)))


def resident() -> float:
    """Memory of this process [MiB], of Linux."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if "VmRSS" in line)
    return int(line.split()[1]) / 1024


def growth(samples: list[Sample], name: str) -> float:
    """By a minute over the second half, the slope of a line through it."""
    late = samples[len(samples) // 2 :]
    return float(np.polyfit([s.minute for s in late], [s.values[name] for s in late], 1)[0])


def soak(minutes: int, seed: int) -> list[Sample]:
    """Play, and print what is held after every minute."""
    session = Session("PushRecovery/Biped-v0", POLICIES[0])
    app: Any = open_app(session, POLICIES, Gate("127.0.0.1"), 8890, (12.0, 90.0))
    app.server.scene.configure_default_lights(cast_shadow=False)  # drawn without a graphics card
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    samples: list[Sample] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS, timeout=PATIENCE)
        page: Any = browser.new_context(viewport=PICTURE).new_page()  # pyright: ignore[reportArgumentType]
        page.goto(f"http://127.0.0.1:{app.server.get_port()}/", timeout=PATIENCE)
        page.get_by_text("walks, ").first.wait_for(timeout=PATIENCE)
        devtools = page.context.new_cdp_session(page)
        devtools.send("Performance.enable")
        player = Player(app, page, seed)
        print(
            "| minute | " + " | ".join(BARS) + " | frames a second |\n|---" + "|---" * (len(BARS) + 1) + "|"
        )
        for minute in range(minutes + 1):
            began = time.monotonic()
            if minute:
                played(app, player, page, 60.0)
            rate = 60.0 / FRAME / (time.monotonic() - began) if minute else 0.0
            samples.append(sample(minute, devtools))
            cells = [f"{value:.1f}" for value in samples[-1].values.values()]
            print(f"| {minute} | " + " | ".join(cells) + f" | {rate:.0f} |", flush=True)
        browser.close()
    app.server.stop()
    session.close()
    return samples


def main() -> int:
    """Play, and hold the growth against its bars."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=int, default=10, help="of the session, 2 at least")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.minutes < 2:
        parser.error("--minutes must be at least 2: growth is that of the second half")
    samples, failed = soak(options.minutes, options.seed), False
    for name, bar in BARS.items():
        found = growth(samples, name)
        failed = failed or found > bar
        print(f"{name}: {found:+.3f} a minute over the second half, at most {bar:g}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
