"""A session in a browser: the scene, the panel, and the loop that keeps both in step with the clock."""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from ...controllers.errors import MissingExtraError, PushRecoveryError
from ...envs.scenario.scenario import FASTEST_TURN
from ..record.record import Array
from .gate import Gate, open_server
from .scene import CAMERA, COLOURS, GROUND, LOOK_AT, SEEN, Ground, PushArrow, RobotView, StripCharts
from .session import (
    CLICK,
    IMPULSE_MAX,
    KINDS,
    FirstPush,
    Session,
    answer_words,
    dragged_impulse,
    limits_words,
    polar_impulse,
    status_words,
)

NOBODY = "nobody"
TIED = "\N{NO-BREAK SPACE}"
SMALL = '<div style="font-size:0.75em;padding:0 1em 0.5em">{}</div>'
HOW = """<b>Drag the robot and let go</b> to push it: the thick arrow is the push.
Drag beside it to turn the view."""
HOW_MUCH = """The impulse says how hard: of an impactor and a payload it is the momentum, of a force or a
weight what it gives; a waist pull goes the further. A slip takes the stance foot, a trip the next step."""
MARK = '<span style="color:rgb{};white-space:nowrap">&#9632; {}</span>'  # colour and name of an overlay
SPEEDS = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1}
VELOCITY = 0.6  # of the sliders, both ways [m/s]
Do = Callable[[Callable[[], object]], None]  # has something done between two planning periods


class Panel:
    """Everything that is not the scene.

    `do` hands an action to the loop that runs the session; `first` is the push that it offers at first.
    """

    def __init__(self, server: Any, session: Session, policies: Sequence[str], do: Do, first: FirstPush):
        self._session, self._do, gui = session, do, server.gui
        self._status = gui.add_markdown("")
        gui.add_html(SMALL.format(HOW))
        marks = " ".join(MARK.format(colour, name) for name, colour in COLOURS.items())
        gui.add_html(SMALL.format(marks))
        with gui.add_folder("Push"):
            self._kind = gui.add_dropdown("kind", tuple(KINDS), hint=HOW_MUCH)
            self._size = gui.add_slider(
                "impulse [N s]", 0.0, IMPULSE_MAX / 2, 0.5, min(first.impulse, IMPULSE_MAX / 2),
                hint="A push acts for 0.1 s as a constant force.",
            )  # fmt: skip
            self._psi = gui.add_slider(
                "direction [deg]", -180, 180, 1, round(first.psi),
                hint="0 is forward at the start of the walk, 90 to the left, -90 to the right.",
            )  # fmt: skip
            self._body = gui.add_dropdown("on the", ("pelvis", "trunk"), initial_value=first.body)
            self._button(gui, "Push", "space", self._push)
            self._button(gui, "Replay the last push", "R", self._replay)
        with gui.add_folder("Walk"):
            now = session.first.command
            most = max(VELOCITY, abs(float(now.vx)), abs(float(now.vy)))
            self._command = [
                gui.add_slider("forward [m/s]", -most, most, 0.05, now.vx),
                gui.add_slider("to the left [m/s]", -most, most, 0.05, now.vy),
                gui.add_slider("turn [rad/s]", -FASTEST_TURN, FASTEST_TURN, 0.05, now.turn),
            ]
            for slider in self._command:
                slider.on_update(lambda _: self._do(self._set_command))
            self._stand = gui.add_checkbox(
                "stand at rest", session.stands,
                hint="Without a velocity the robot stands on both feet instead of stepping in place.",
            )  # fmt: skip
            self._stand.on_update(lambda _: self._do(lambda: session.stand_at_rest(self._stand.value)))
        with gui.add_folder("Who acts"):
            self._policy = gui.add_dropdown("policy", tuple(policies), initial_value=session.first.name)
            self._beside = gui.add_dropdown(
                "beside it", (NOBODY, *policies), initial_value=session.beside or NOBODY
            )
            self._policy.on_update(lambda _: self._do(self._switch))
            self._beside.on_update(lambda _: self._do(self._put_beside))
        with gui.add_folder("Time"):
            self._speed = gui.add_dropdown("speed", tuple(SPEEDS))
            self._speed.on_update(lambda _: self._do(lambda: session.set_speed(SPEEDS[self._speed.value])))
            self._button(gui, "Pause or go on", "P", session.pause_or_go_on)
            self._button(gui, "One period (10 ms)", "F", session.step_once)
            self._button(gui, "Start anew", "N", session.restart)
        with gui.add_folder("Show", expand_by_default=False):
            self._shown = {name: gui.add_checkbox(name, True) for name in COLOURS}

    @property
    def visible(self) -> dict[str, bool]:
        """Whether each overlay is to be seen."""
        return {name: box.value for name, box in self._shown.items()}

    def draw(self) -> None:
        """Status of the robots, and the limits that they meet."""
        lines = []
        for lane in self._session.lanes:
            met = ", ".join(limits_words(lane)) or "none"
            said = [f"**{lane.name}** {status_words(lane)}", answer_words(lane), f"limits met: {met}"]
            lines.append("  \n".join(filter(None, said)))
        text = "\n\n".join([*lines, *(["*paused*"] if self._session.paused else [])])
        text = text.replace(" N s", f"{TIED}N{TIED}s")  # no line ends within a unit
        if text != self._status.content:
            self._status.content = text

    def agree(self) -> None:
        """Let the fields show policies and command in force, where a choice has been refused or undone."""
        session, command = self._session, self._session.first.command
        self._stand.value = session.stands
        for slider, value in zip(self._command, (command.vx, command.vy, command.turn), strict=True):
            slider.value = value
        self._policy.value = session.first.name
        self._beside.value = session.beside or NOBODY

    def _button(self, gui: Any, label: str, key: str, action: Callable[[], object]) -> None:
        gui.add_button(f"{label}  [{key}]").on_click(lambda _: self._do(action))
        gui.add_command(label, hotkey=key).on_trigger(lambda _: self._do(action))

    def _push(self) -> None:
        impulse = polar_impulse(self._size.value, self._psi.value)
        self._session.push(impulse, self._body.value, self._kind.value)

    def _replay(self) -> None:
        self._session.replay()
        self.agree()  # the command is that of the moment of the push

    def _switch(self) -> None:
        if self._policy.value != self._session.first.name:
            self._session.switch(self._policy.value)

    def _set_command(self) -> None:
        vx, vy, turn = (float(slider.value) for slider in self._command)
        self._session.drive(vx, vy, turn)

    def _put_beside(self) -> None:
        chosen = None if self._beside.value == NOBODY else self._beside.value
        if chosen != self._session.beside:
            self._session.put_beside(chosen)


FRAME = 1.0 / 30.0  # [s]
CHARTS_EVERY = 6  # frames
APART = 1.5  # of two robots [m]
PHONE = 0.7  # width over height of a window, below which viser's panel covers the lower 60 % of it
PHONE_CAMERA, PHONE_LOOK_AT = (-3.6, -3.3, 1.5), (0.0, 0.0, -1.4)  # the robot above that panel [m]
AIMED = (245, 95, 85)  # colour of the arrow of a drag; the pointer has an orange one of viser


class App:
    """One session and everybody who looks at it; `first` is as for `Panel`."""

    def __init__(self, session: Session, server: Any, policies: Sequence[str], first: FirstPush):
        self.session, self.server = session, server
        self._actions: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self.do: Do = self._actions.put
        self.ended = threading.Event()
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.set_panel_label("push-recovery play")
        server.on_client_connect(look_above_the_panel)
        self._ground = Ground(server)
        self._robots: list[RobotView] = []
        self.aimed, self.given = PushArrow(server, f"{GROUND}/aimed", AIMED), self._ground.given
        self.panel = Panel(server, session, policies, self.do, first)
        with server.gui.add_folder("Charts of the first robot"):
            self.charts = StripCharts(server)
        self._frames, self._pelvis = 0, np.zeros(3)
        self._aim: tuple[Any, Array] = None, np.zeros(2)  # pointer on the screen, impulse shown for it
        self.draw()

    def run(self) -> None:
        """Play until `ended` is set."""
        before = time.monotonic()
        while not self.ended.is_set():
            now = time.monotonic()
            self.frame(now - before)
            before = now
            self.ended.wait(max(0.0, FRAME - (time.monotonic() - now)))

    def frame(self, seconds: float) -> None:
        """Do what has been asked for, let the time go by that has, and draw."""
        while not self._actions.empty():
            action = self._actions.get()
            try:
                action()
            except PushRecoveryError as error:  # everybody who looks is told
                self.panel.agree()
                for client in self.server.get_clients().values():
                    client.add_notification("Not done", str(error), auto_close_seconds=6.0)
        self.session.advance(seconds)
        self.draw()

    def draw(self) -> None:
        """Bring the scene up to date."""
        self._match_robots()
        with self.server.atomic():
            lanes = zip(self._robots, self.session.lanes, strict=True)
            places = [robot.draw(lane.episodes, lane.name, self.panel.visible) for robot, lane in lanes]
            self._pelvis = places[0]
            self._ground.follow(self._pelvis)
            self._draw_given()
            self.panel.draw()
        if self._frames % CHARTS_EVERY == 0:
            self.charts.draw(self.session.first)
        self._frames += 1

    def grab(self, event: Any, part: str) -> None:
        """A drag on a body has gone on: aim, and where it is let go push with the impulse that is shown."""
        if event.end_screen_pos != self._aim[0] or event.phase == "start":  # else only the robot has moved
            way = np.subtract(event.end_position, event.start_position)
            impulse = dragged_impulse(way, camera_axes(event.client.camera.wxyz))
            self._aim = event.end_screen_pos, impulse
        impulse = self._aim[1]
        if event.phase == "end":
            self.do(lambda: self._let_go(impulse, part))
        else:
            tail = np.asarray(event.start_position) - np.asarray(self._ground.frame.position)
            self.do(lambda: self.aimed.show(tail, impulse, self.session.first.mass))

    def _let_go(self, impulse: Array, part: str) -> None:
        self.aimed.hide()
        if np.hypot(*impulse) >= CLICK:
            self.session.push(impulse, "trunk" if part == "trunk" else "pelvis")

    def _draw_given(self) -> None:
        """The latest push while it acts and shortly after."""
        lane = self.session.first
        push = lane.scenario.pushes[-1] if lane.scenario.pushes else None
        if push is not None and any(push.force[:2]) and 0.0 <= lane.time - lane.push_start <= SEEN:
            self.given.show_at(self._pelvis, push.impulse[:2], lane.mass)
        elif self.given.text:
            self.given.hide()

    def _match_robots(self) -> None:
        """As many robots in the scene as in the session, of the same shape."""
        while len(self._robots) > len(self.session.lanes):
            self._robots.pop().remove()
        while len(self._robots) < len(self.session.lanes):
            i = len(self._robots)
            body = self.session.lanes[i].episodes.core.body
            self._robots.append(RobotView(self.server, f"robot {i}", body, i * APART, self.grab))


async def look_above_the_panel(client: Any) -> None:
    """Keep the camera of a phone where the panel covers nothing of the robot, until somebody moves it.

    A page tells its first camera before it knows its size, and takes the scene's initial camera again after
    that; so whatever it tells is looked at, in the order in which it comes.
    """

    async def seen(camera: Any) -> None:
        untouched = np.allclose([camera.position, camera.look_at], [CAMERA, LOOK_AT], atol=1e-3)
        if untouched and camera.aspect < PHONE:
            with client.atomic():
                camera.position, camera.look_at = PHONE_CAMERA, PHONE_LOOK_AT

    client.camera.on_update(seen)


def camera_axes(wxyz: Any) -> Array:
    """Axes right, down and view of a camera in the world, (3, 3), from its orientation."""
    import viser.transforms

    turn = viser.transforms.SO3(np.asarray(wxyz, np.float64))
    return np.asarray(turn.as_matrix(), np.float64)


def require_play() -> None:
    """Raise MissingExtraError where viser or mjviser is not installed."""
    for package in ("viser", "mjviser"):
        if find_spec(package) is None:
            raise MissingExtraError(package, "play")


def open_app(session: Session, policies: Sequence[str], gate: Gate, port: int, first: FirstPush) -> App:
    """A session behind a gate, at the next port that is free; it does not move until it is run."""
    server = open_server(gate, port)
    try:
        return App(session, server, policies, first)
    except BaseException:
        server.stop()
        raise


def play(session: Session, policies: Sequence[str], gate: Gate, port: int, first: FirstPush) -> None:
    """Say where to look, and play until Ctrl-C."""
    description = session.first.episodes.core.body.description
    if description.looks is not None:
        print(f"reading the meshes of {description.name}, which takes some seconds", flush=True)
    app = open_app(session, policies, gate, port, first)
    try:
        print(f"the robot walks at {gate.address(app.server.get_port())}", flush=True)
        print("drag it and let go, or press space; Ctrl-C ends", flush=True)
        app.run()
    finally:
        app.server.stop()
        session.close()
