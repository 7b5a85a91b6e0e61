"""A session in MuJoCo's own window: pushes by mouse and key, until the window is closed.

Ctrl and the mouse drag a body as in any MuJoCo window; its way along the floor is the push, given where it is
let go.
"""

import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from ...controllers.errors import PushRecoveryError
from ...envs.biped.view import add_markers, set_posture
from ...envs.scenario.push import Body
from .session import CLICK, FirstPush, Session, floor_impulse, polar_impulse, status_words

FRAME = 1.0 / 60.0  # [s]
KEYS = "space: push, S: stand or step at rest, R: replay, P: pause, F: one period, N: start anew, -/=: speed"
SLOWER = 0.5  # of the speed, a key press


class Desktop:
    """Keys and mouse of a window that act on a session; `first` is the push of a key."""

    def __init__(self, session: Session, first: FirstPush):
        self.session, self._impulse = session, polar_impulse(first.impulse, first.psi)
        self._body: Body = first.body
        self._keys: list[int] = []
        self.key = self._keys.append  # a key that is pressed is answered between two planning periods
        self._way: np.ndarray | None = None  # of the mouse, while it drags a body [m]
        self._held: Body = "pelvis"  # what it drags
        self._last_words = ""

    def answer_keys(self) -> None:
        """Do what the keys say; those without a meaning are left."""
        session = self.session
        actions: dict[str, Callable[[], object]] = {
            " ": lambda: session.push(self._impulse, self._body), "R": session.replay, "N": session.restart,
            "P": session.pause_or_go_on, "F": session.step_once, "-": lambda: session.faster(SLOWER),
            "=": lambda: session.faster(1.0 / SLOWER), "S": lambda: session.stand_at_rest(not session.stands),
        }  # fmt: skip
        while self._keys:
            code = self._keys.pop(0)  # below 0 for a key that GLFW does not know
            action = actions.get(chr(code)) if code > 0 else None
            if action is not None:
                self._try(action)

    def answer_mouse(self, perturb: Any, data: mujoco.MjData) -> None:
        """Aim while the mouse drags a body, and push where it lets go."""
        if perturb.active and perturb.select > 0:
            turn = data.xmat[perturb.select].reshape(3, 3)
            grabbed = data.xpos[perturb.select] + turn @ perturb.localpos
            self._way = np.array(perturb.refselpos - grabbed)[:2]
            trunk = self.session.first.episodes.core.body.indices.trunk
            self._held = "trunk" if perturb.select == trunk else "pelvis"
        elif self._way is not None:
            impulse, self._way = floor_impulse(self._way), None
            if np.hypot(*impulse) >= CLICK:
                self._try(lambda: self.session.push(impulse, self._held))

    def report(self) -> None:
        """Print a line where the robot has recovered or fallen."""
        words = status_words(self.session.first)
        if not words.startswith(("walks", "stands", "pushed")) and words != self._last_words:
            print(words, flush=True)
        self._last_words = words

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except PushRecoveryError as error:
            print(f"not done: {error}", flush=True)


def play_in_window(make: Callable[[], Session], first: FirstPush) -> None:
    """Open a window on a session, where there is a display, and play until it is closed."""
    from ...envs.rendering import require_display

    require_display()
    from mujoco import viewer

    session = make()
    desktop, core = Desktop(session, first), session.first.episodes.core
    model, data = core.body.picture, mujoco.MjData(core.body.picture)
    print(KEYS, flush=True)
    with viewer.launch_passive(
        model, data, key_callback=desktop.key, show_left_ui=False, show_right_ui=False
    ) as window:
        before = time.monotonic()
        while window.is_running():
            now = time.monotonic()
            with window.lock():
                desktop.answer_keys()
                desktop.answer_mouse(window.perturb, data)
                session.advance(now - before)
                core = session.first.episodes.core
                set_posture(model, data, core)
                window.cam.lookat[:2] = data.xpos[core.body.indices.pelvis, :2]
                window.user_scn.ngeom = 0
                add_markers(window.user_scn, data, core)
            window.sync()
            desktop.report()
            before = now
            time.sleep(max(0.0, FRAME - (time.monotonic() - now)))
    session.close()
