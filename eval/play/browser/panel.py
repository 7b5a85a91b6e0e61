"""The panel beside the scene: sliders, buttons and keys, and what the robots go through in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ....envs.scenario.command import FASTEST_TURN, Command
from ..drag import LARGEST, polar_impulse
from ..session import Session
from ..status import limits_words, status_words
from .floor_marks import COLOURS

NOBODY = "nobody"
TIED = "\N{NO-BREAK SPACE}"
HOW = (
    '<div style="font-size:0.75em;padding:0 1em 0.5em"><b>Drag the robot and let go</b> to push it: '
    "the thick arrow is the push. Drag beside it to turn the view.</div>"
)
SPEEDS = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1}
VELOCITY = 0.6  # of the sliders, both ways [m/s]
Do = Callable[[Callable[[], object]], None]  # has something done between two planning periods


class Panel:
    """Everything that is not the scene.

    Args:
        server: of viser.
        session: that its buttons act on.
        policies: to choose from.
        do: hands an action to the loop that runs the session.
        impulse: at first, size [N s] and direction, counter-clockwise from forward [deg].
    """

    def __init__(
        self, server: Any, session: Session, policies: Sequence[str], do: Do, impulse: tuple[float, float]
    ):
        self._session, self._do, gui = session, do, server.gui
        self._status = gui.add_markdown("")
        gui.add_html(HOW)
        gui.add_html(legend())
        with gui.add_folder("Push"):
            self._size = gui.add_slider(
                "impulse [N s]",
                0.0,
                LARGEST / 2,
                0.5,
                min(impulse[0], LARGEST / 2),
                hint="It acts for 0.1 s as a constant force.",
            )
            self._psi = gui.add_slider(
                "direction [deg]", -180, 180, 1, round(impulse[1]),
                hint="0 is forward at the start of the walk, 90 to the left, -90 to the right.",
            )  # fmt: skip
            self._body = gui.add_dropdown("on the", ("pelvis", "trunk"))
            self._button(gui, "Push", "space", self._push)
            self._button(gui, "Replay the last push", "R", self._replay)
        with gui.add_folder("Walk"):
            now = session.first.command
            self._command = [
                gui.add_slider("forward [m/s]", -VELOCITY, VELOCITY, 0.05, now.vx),
                gui.add_slider("to the left [m/s]", -VELOCITY, VELOCITY, 0.05, now.vy),
                gui.add_slider("turn [rad/s]", -FASTEST_TURN, FASTEST_TURN, 0.05, now.turn),
            ]
            for slider in self._command:
                slider.on_update(lambda _: self._do(self._tell))
        with gui.add_folder("Who acts"):
            beside = session.lanes[1].name if len(session.lanes) > 1 else NOBODY
            self._policy = gui.add_dropdown("policy", tuple(policies), initial_value=session.first.name)
            self._beside = gui.add_dropdown("beside it", (NOBODY, *policies), initial_value=beside)
            self._policy.on_update(lambda _: self._do(self._switch))
            self._beside.on_update(lambda _: self._do(self._put_beside))
        with gui.add_folder("Time"):
            self._speed = gui.add_dropdown("speed", tuple(SPEEDS))
            self._speed.on_update(lambda _: self._do(lambda: session.set_speed(SPEEDS[self._speed.value])))
            self._button(gui, "Pause or go on", "P", self._pause)
            self._button(gui, "One period (10 ms)", "F", self._step)
            self._button(gui, "Start anew", "N", session.restart)
        with gui.add_folder("Show", expand_by_default=False):
            self._shown = {name: gui.add_checkbox(name, True) for name in COLOURS}

    @property
    def visible(self) -> dict[str, bool]:
        """Which overlays are to be seen."""
        return {name: box.value for name, box in self._shown.items()}

    def draw(self) -> None:
        """Say what the robots go through."""
        lines = []
        for lane in self._session.lanes:
            met = ", ".join(limits_words(lane)) or "none"
            lines.append(f"**{lane.name}** {status_words(lane)}  \nlimits met: {met}")
        text = "\n\n".join([*lines, *(["*paused*"] if self._session.paused else [])])
        text = text.replace(" N s", f"{TIED}N{TIED}s")  # no line ends within a unit
        if text != self._status.content:
            self._status.content = text

    def agree(self) -> None:
        """Let the fields show who acts and what is told, where a choice has been refused or undone."""
        session, told = self._session, self._session.first.command
        for slider, value in zip(self._command, (told.vx, told.vy, told.turn), strict=True):
            slider.value = value
        self._policy.value = session.first.name
        self._beside.value = session.lanes[1].name if len(session.lanes) > 1 else NOBODY

    def _button(self, gui: Any, label: str, key: str, action: Callable[[], object]) -> None:
        gui.add_button(f"{label}  [{key}]").on_click(lambda _: self._do(action))
        gui.add_command(label, hotkey=key).on_trigger(lambda _: self._do(action))

    def _push(self) -> None:
        impulse = polar_impulse(self._size.value, self._psi.value)
        self._session.push(impulse, self._body.value)

    def _replay(self) -> None:
        self._session.replay()
        self.agree()  # the command is that of the moment of the push

    def _switch(self) -> None:
        if self._policy.value != self._session.first.name:
            self._session.switch(self._policy.value)

    def _tell(self) -> None:
        self._session.tell(Command(*(float(slider.value) for slider in self._command)))

    def _put_beside(self) -> None:
        chosen = self._beside.value
        now = self._session.lanes[1].name if len(self._session.lanes) > 1 else NOBODY
        if chosen != now:
            self._session.put_beside(None if chosen == NOBODY else chosen)

    def _pause(self) -> None:
        self._session.paused = not self._session.paused

    def _step(self) -> None:
        self._session.paused = True
        self._session.step()


def legend() -> str:
    """The colours of the overlays, as HTML."""
    marks = (
        f'<span style="color:rgb{colour};white-space:nowrap">&#9632; {name}</span>'
        for name, colour in COLOURS.items()
    )
    return f'<div style="font-size:0.75em;padding:0 1em 0.5em">{" ".join(marks)}</div>'
