"""Write one episode as a film, a strip of pictures, arrays or a figure."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import MissingExtraError, UnknownNameError
from ...controllers.files import write_atomically
from ...envs.scenario.scenario import Scenario
from ..output.place import require_place
from ..record.files import LOG_FORMATS, write_log
from ..record.plot import PLOT_FORMATS, write_plot
from ..record.record import record_episode
from ..rollout.one import GymRobot, planning_period, rollout
from ..rollout.outcome import Outcome
from ..rollout.policy_source import acting_in

FORMATS = (".mp4", ".gif", ".png")
FILM_RATE = 25.0  # frames per simulated second
STRIP = (0.05, 0.25, 0.5, 0.8, 1.3, 2.0)  # moments of a strip, after the push began [s]
PANEL = (11, 12)  # width to height of one picture of a strip


class Written(NamedTuple):
    """The files that an episode is written to, each where it is asked for."""

    out: Path | None = None  # film or contact sheet
    log: Path | None = None  # time histories
    plot: Path | None = None  # their figure

    def check(self) -> str:
        """Refuse other formats and places that can't be written to; returns the suffix of `out`.

        Raises:
            UnknownNameError: a suffix is no known format.
            InvalidValueError: a file can't be written.
            MissingExtraError: a film is asked for and imageio is not installed.
        """
        suffix = "" if self.out is None else output_suffix(self.out, FORMATS)
        for path, valid in ((self.log, LOG_FORMATS), (self.plot, PLOT_FORMATS)):
            if path is not None:
                output_suffix(path, valid)
        if suffix in {".mp4", ".gif"}:
            _imageio()
        for path in filter(None, self):
            require_place(path)
        return suffix

    @property
    def render_mode(self) -> str | None:
        """What the environment is to draw."""
        return None if self.out is None else "rgb_array"


class _Camera:
    """Watches an episode: keeps a frame at FILM_RATE of simulated time, and when the push began."""

    def __init__(self, period: float):
        """Take the planning period [s]."""
        self.frames: list[NDArray[np.uint8]] = []
        self.times: list[float] = []  # of the frames, since reset [s]
        self.push_start = 0.0  # [s]
        self._period = period
        self._every = max(1, round(1.0 / (FILM_RATE * period)))
        self._count = 0

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        if self._count % self._every == 0 or robot.ended:
            self.frames.append(np.array(robot.env.render(), dtype=np.uint8))
            self.times.append(float(robot.info.get("time", self._count * self._period)))
        self._count += 1
        start = (robot.info.get("push") or {}).get("start")
        self.push_start = self.push_start if start is None else float(start)


def show_episode(env_id: str, policy: str, scenario: Scenario, written: Written) -> Outcome:
    """Run a scenario and write what has been asked for; returns its outcome.

    Raises:
        PushRecoveryError: as `Written.check`, before the episode begins.
    """
    suffix = written.check()
    with acting_in(env_id, policy, render_mode=written.render_mode) as (env, acting, _):
        camera = None if written.out is None else _Camera(planning_period(env))
        if written.log is None and written.plot is None:
            outcome = rollout(env, acting, scenario, policy, camera)
        else:
            found = record_episode(env, acting, scenario, policy, camera)
            outcome = found.outcome
            if written.log is not None:
                write_log(found, written.log)
            if written.plot is not None:
                write_plot(found, written.plot)
    if camera is not None and written.out is not None:
        write_atomically(written.out, _strip(camera) if suffix == ".png" else _film(camera.frames, suffix))
    return outcome


def _imageio() -> Any:
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("imageio", "view") from error
    return imageio


def _film(frames: list[NDArray[np.uint8]], suffix: str) -> bytes:
    """Frames as mp4 or gif."""
    buffer = io.BytesIO()
    options: dict[str, Any] = {"macro_block_size": 1} if suffix == ".mp4" else {}
    with _imageio().get_writer(buffer, format=suffix[1:], mode="I", fps=FILM_RATE, **options) as writer:
        for frame in frames:
            writer.append_data(frame)
    return buffer.getvalue()


def _moments(camera: _Camera) -> list[int]:
    """Frames nearest to the moments of STRIP, all of them earlier where the episode ends before the last."""
    times = np.array(camera.times)
    squeeze = min(1.0, (times[-1] - camera.push_start) / STRIP[-1])
    return [int(np.argmin(np.abs(times - camera.push_start - squeeze * after))) for after in STRIP]


def _strip(camera: _Camera) -> bytes:
    """The push and what follows: six frames side by side with their times after its begin, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = 2.3, 2.3 * PANEL[1] / PANEL[0]  # of a panel [inch]
    figure = Figure(figsize=(width * len(STRIP), height + 0.25), dpi=100)
    for column, index in enumerate(_moments(camera)):
        axes = figure.add_axes((column / len(STRIP), 0.0, 0.995 / len(STRIP), height / (height + 0.25)))
        axes.imshow(_crop(camera.frames[index]), aspect="auto")
        axes.set_title(f"{camera.times[index] - camera.push_start:+.2f} s", fontsize=10, pad=3)
        axes.set_axis_off()
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def _crop(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The middle of a frame, in the proportions of PANEL."""
    rows, columns = frame.shape[:2]
    kept = min(columns, rows * PANEL[0] // PANEL[1])
    left = (columns - kept) // 2
    return frame[:, left : left + kept]


def output_suffix(path: Path, valid: tuple[str, ...]) -> str:
    """The suffix of an output file; raises UnknownNameError listing the valid ones."""
    suffix = path.suffix.lower()
    if suffix not in valid:
        raise UnknownNameError("output format", suffix or str(path), valid)
    return suffix
