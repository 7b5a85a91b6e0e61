"""Films of episodes as mp4 or GIF, several policies side by side, and contact sheets of a push."""

import io
import re
from collections.abc import Sequence
from functools import cache
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ...controllers.errors import MissingExtraError
from ...controllers.files import write_atomically
from ...envs.biped.view import COP_COLOUR, DCM_COLOUR, FOOTHOLD_COLOUR, PUSH_COLOUR
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars, say
from ..rollout.episodes import GymRobot, planning_period, rollout
from ..rollout.policy_source import acting_in, policy_sources
from ..score.evaluate import Evaluation
from .words import EpisodeWords

Frame = NDArray[np.uint8]  # (height, width, 3)
FILM_RATE = 25.0  # frames per simulated second


PANEL = (330, 330)  # width, height of a policy's picture [pixels]
HEAD, FOOT, LINE = 78, 34, 24  # heights above and below the pictures, and of a line of text [pixels]
GAP = 4  # between two pictures [pixels]
PAPER, INK, GOOD, BAD = (255, 255, 255), (25, 25, 25), (0, 120, 70), (200, 30, 25)
LEGEND = {
    name: (round(255 * red), round(255 * green), round(255 * blue))
    for name, (red, green, blue) in {
        "push": PUSH_COLOUR, "foothold": FOOTHOLD_COLOUR[:3], "DCM": DCM_COLOUR[:3], "CoP": COP_COLOUR[:3],
    }.items()
}  # fmt: skip
COLOURS = (PAPER, INK, GOOD, BAD, *LEGEND.values())  # that must stay apart in a small palette


def middle(frame: Frame, proportions: tuple[int, int]) -> Frame:
    """The middle of a frame, at most as wide as width to height say."""
    rows, columns = frame.shape[:2]
    kept = min(columns, rows * proportions[0] // proportions[1])
    left = (columns - kept) // 2
    return frame[:, left : left + kept]


def rendered(robot: GymRobot) -> Frame:
    """A picture of the present moment."""
    return np.array(robot.env.render(), dtype=np.uint8)


class Shot(EpisodeWords):
    """One policy's episode as a camera sees it: frames at a rate of simulated time, and how it ends.

    `period` is that of planning [s], `rate` in frames per simulated second.
    """

    def __init__(self, policy: str, period: float, rate: float = FILM_RATE):
        super().__init__()
        self.policy = policy
        self.frames: list[Frame] = []
        self.times: list[float] = []  # of the frames, since reset [s]
        self._period, self._count = period, 0
        self._every = max(1, round(1.0 / (rate * period)))
        self.rate = 1.0 / (self._every * period)  # of the frames, in the robot's time [1/s]

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        self.look(robot.info)
        if self._count % self._every == 0 or robot.ended:
            self.frames.append(rendered(robot))
            self.times.append(float(self.info.get("time", self._count * self._period)))
        self._count += 1

    @property
    def pushed_for(self) -> float:
        """From the start of the first push to that of the last one [s]."""
        return float(self.pushes[-1]["start"]) - self.push_start if self.pushes else 0.0

    def frame_at(self, after: float) -> int:
        """Index of the frame nearest to a time after the first push [s]; the first or last one beyond."""
        return int(np.argmin(np.abs(np.array(self.times) - self.push_start - after)))

    @property
    def fell(self) -> bool:
        """Whether it ended in a fall."""
        return bool(self.info.get("failure_reason"))

    @property
    def decided(self) -> float:
        """When it is decided whether the robot falls or recovers, after the first push began [s]."""
        settled = self.info.get("recovered_at")
        end = self.times[-1] if self.fell or settled is None else float(settled)
        return end - self.push_start


def compose(shots: Sequence[Shot], after: float, speed: float) -> Frame:
    """One picture of the film: every policy at a time after its first push began [s].

    The pushes are written over all of them, each policy's name over its own picture, and below the name how
    it has ended once that is decided; a robot that has fallen stays as it fell.
    """
    width, height = PANEL
    sheet = Image.new("RGB", (len(shots) * (width + GAP) - GAP, HEAD + height + FOOT), PAPER)
    draw = ImageDraw.Draw(sheet)
    push = max(shots, key=lambda shot: len(shot.pushes)).push
    draw.text((sheet.width / 2, 2), push, INK, font(19, True), anchor="ma")
    for column, shot in enumerate(shots):
        left = column * (width + GAP)
        frame = Image.fromarray(middle(shot.frames[shot.frame_at(after)], PANEL))
        sheet.paste(frame.resize(PANEL, Image.Resampling.LANCZOS), (left, HEAD))
        _title(draw, left + width / 2, shot, after)
    draw_legend(draw, sheet.size, f"{after:+.2f} s{'' if speed == 1.0 else f', {speed:g} of real speed'}")
    return np.asarray(sheet)


def _title(draw: Any, centre: float, shot: Shot, after: float) -> None:
    draw.text((centre, 2 + LINE), _fitting(draw, shot.policy), INK, font(18, False), anchor="ma")
    if after >= shot.decided:
        words = shot.ending.partition(" (")[0]
        colour = BAD if shot.fell else GOOD
        draw.text((centre, 2 + 2 * LINE), _fitting(draw, words), colour, font(18, True), anchor="ma")


def draw_legend(draw: Any, size: tuple[int, int], words: str) -> None:
    """The colours of the markers in the last line of a picture, and words at its right end."""
    letters, middle_line = font(13, False), size[1] - FOOT / 2
    left: float = 8
    for name, colour in LEGEND.items():
        draw.rectangle((left, middle_line - 5, left + 10, middle_line + 5), colour)
        draw.text((left + 14, middle_line), name, INK, letters, anchor="lm")
        left += 24 + letters.getlength(name)
    draw.text((size[0] - 8, middle_line), words, INK, letters, anchor="rm")


def _fitting(draw: Any, text: str) -> str:
    """A text cut at its front to the width of a picture: paths of files differ at their ends."""
    while draw.textlength(text, font(18, True)) > PANEL[0] - 8:
        text = "\N{HORIZONTAL ELLIPSIS}" + text.lstrip("\N{HORIZONTAL ELLIPSIS}")[1:]
    return text


@cache
def font(size: int, bold: bool) -> Any:
    """DejaVu Sans, which comes with matplotlib."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    data: Any = matplotlib.get_data_path()
    return ImageFont.truetype(str(Path(data) / "fonts" / "ttf" / name), size)


GIF_LIMIT = 1_000_000  # [bytes]
GIF_COLOURS = 24  # of a GIF besides those that are kept; few make small files
SAMPLES = 6  # pictures, about, that the palette is made from
SHRINK = 0.85  # of width and height, until the file is below its limit
SMALLEST = 64  # width at which nothing is shrunk any more [pixels]
Colour = tuple[int, int, int]  # red, green, blue in 0-255


def require_imageio() -> Any:
    """Imageio with ffmpeg.

    Raises:
        MissingExtraError: one of the two is not installed.
    """
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("imageio", "view") from error
    return imageio


def mp4_bytes(frames: Sequence[Frame], rate: float) -> bytes:
    """Frames of one even width and height as H.264, at so many a second."""
    buffer = io.BytesIO()
    options: dict[str, Any] = {"format": "mp4", "mode": "I", "fps": rate, "macro_block_size": 1}
    with require_imageio().get_writer(buffer, **options) as writer:
        for frame in frames:
            writer.append_data(frame)
    return buffer.getvalue()


def gif_bytes(
    frames: Sequence[Frame], rate: float, keep: Sequence[Colour] = (), limit: int = GIF_LIMIT
) -> bytes:
    """Frames of one shape as a GIF that loops, so many a second; smaller ones to stay below a limit [bytes].

    All pictures share one palette without dithering, so that what stands still costs nothing; the colours to
    `keep` stay what they are, however small the things that have them.
    """
    pictures = [Image.fromarray(frame) for frame in frames]
    palette = _palette(frames, keep)
    width, height = map(float, pictures[0].size)
    while True:
        size = round(width), round(height)
        small = [picture.resize(size, Image.Resampling.LANCZOS) for picture in pictures]
        first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in small]
        buffer = io.BytesIO()
        first.save(buffer, "GIF", save_all=True, append_images=rest, duration=round(1000 / rate), loop=0)
        if buffer.tell() < limit or width * SHRINK < SMALLEST:
            return buffer.getvalue()
        width, height = width * SHRINK, height * SHRINK


def _palette(frames: Sequence[Frame], keep: Sequence[Colour]) -> Any:
    """A picture that holds the palette of pictures from all over the film."""
    samples = Image.fromarray(np.concatenate(frames[:: max(1, len(frames) // SAMPLES)]))
    found = samples.quantize(GIF_COLOURS, Image.Quantize.FASTOCTREE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*found[: 3 * GIF_COLOURS], *(value for colour in keep for value in colour)])
    return palette


STRIP = (0.05, 0.25, 0.5, 0.8, 1.3, 2.0)  # times of the pictures, after the push began [s]
STRIP_PANEL = (228, 250)  # width, height of one picture [pixels]


def strip(shot: Shot) -> bytes:
    """The pushes and what follows: six frames with their times after the first push began, as PNG.

    Below them stand what the markers mean, the push, and how it has ended.
    """
    width, height = STRIP_PANEL
    sheet = Image.new("RGB", (len(STRIP) * (width + GAP) - GAP, LINE + height + FOOT), PAPER)
    draw = ImageDraw.Draw(sheet)
    # The times of STRIP, stretched over several pushes, and squeezed where the episode ends before the last
    stretch = min(STRIP[-1] + shot.pushed_for, shot.times[-1] - shot.push_start) / STRIP[-1]
    for column, index in enumerate(shot.frame_at(stretch * after) for after in STRIP):
        left = column * (width + GAP)
        frame = Image.fromarray(middle(shot.frames[index], STRIP_PANEL))
        sheet.paste(frame.resize(STRIP_PANEL, Image.Resampling.LANCZOS), (left, LINE))
        time = f"{shot.times[index] - shot.push_start:+.2f} s"
        draw.text((left + width / 2, LINE / 2), time, INK, font(13, False), anchor="mm")
    draw_legend(draw, sheet.size, f"{shot.policy}: {shot.push}, {shot.ending}")
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


SLOW = 0.5  # speed of a film of two policies against time
RATE = 25.0  # pictures a second of an mp4; a GIF has every second one
BEFORE, LONGEST = 0.4, 3.2  # seen before the first push began and at most after the last one did [s]
LINGER = 0.6  # seen after all is decided [s]


def shoot(env_id: str, policy: Any, scenario: Scenario, rate: float) -> Shot:
    """Run a scenario before a camera, at so many frames per simulated second.

    Raises:
        PushRecoveryError: the policy can't act, or nothing can be drawn here.
    """
    with acting_in(env_id, policy, render_mode="rgb_array") as (env, acting, label):
        shot = Shot(label, planning_period(env), rate)
        rollout(env, acting, scenario, label, shot)
    return shot


def side_by_side(shots: Sequence[Shot], speed: float, rate: float) -> list[Frame]:
    """The pushes and what follows, until it is decided for all and a little longer."""
    longest = LONGEST + max(shot.pushed_for for shot in shots)
    last = min(max(shot.decided for shot in shots) + LINGER, longest)
    return [compose(shots, float(after), speed) for after in np.arange(-BEFORE, last, speed / rate)]


def write_pair(shots: Sequence[Shot], stem: Path) -> list[Path]:
    """STEM.gif and STEM.mp4 of the same push under several policies; returns their paths."""
    frames = side_by_side(shots, SLOW, RATE)
    contents = {".gif": gif_bytes(frames[::2], RATE / 2, COLOURS), ".mp4": mp4_bytes(frames, RATE)}
    paths = [stem.with_name(stem.name + suffix) for suffix in contents]
    for path, content in zip(paths, contents.values(), strict=True):
        write_atomically(path, content)
    return paths


def episode_film(shot: Shot, suffix: str) -> bytes:
    """One episode as mp4 or GIF, at the speed of time."""
    frames = [compose([shot], time - shot.push_start, 1.0) for time in shot.times]
    if suffix == ".mp4":
        return mp4_bytes(frames, shot.rate)
    return gif_bytes(frames[::2], shot.rate / 2, COLOURS)


WIDTH = 1.5  # of a picture [inch]
DPI, QUALITY = 100, 82  # dots an inch, of JPEG in per cent


class StripCamera:
    """Watches an episode, and draws it only at the times of STRIP after its first push began.

    An episode that ends before all of them ends with a picture of its end.
    """

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.after: list[float] = []  # the push began [s], of each frame
        self.start: float | None = None  # of the first push, since reset [s]

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        start = (robot.info.get("push") or {}).get("start")
        if self.start is None and start is not None:
            self.start = float(start)
        if self.start is None or len(self.frames) == len(STRIP):
            return
        after = float(robot.info["time"]) - self.start
        if robot.ended or after >= STRIP[len(self.frames)] - 1e-9:
            self.frames.append(rendered(robot))
            self.after.append(after)


def watch(env_id: str, policy: str, scenario: Scenario) -> StripCamera:
    """Run a scenario and draw it at the times of STRIP.

    Raises:
        PushRecoveryError: the policy can't act, or nothing can be drawn here.
    """
    with acting_in(env_id, policy, render_mode="rgb_array") as (env, acting, label):
        camera = StripCamera()
        rollout(env, acting, scenario, label, camera)
    return camera


def sheet(rows: Sequence[tuple[str, StripCamera]]) -> bytes:
    """Rows of pictures under their titles, as JPEG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns, height, head = len(STRIP), WIDTH * STRIP_PANEL[1] / STRIP_PANEL[0], 0.5  # [inch]
    figure = Figure(figsize=(columns * WIDTH, len(rows) * (height + head)), dpi=DPI)
    figure.set_facecolor("white")
    share = 1.0 / len(rows)
    for index, (title, camera) in enumerate(rows):
        top = 1.0 - index * share
        figure.text(0.003, top - 0.1 * share, title, fontsize=10, fontweight="bold", va="center")
        for column, (frame, after) in enumerate(zip(camera.frames, camera.after, strict=True)):
            place = (column / columns, top - share, 0.99 / columns, share * height / (height + head))
            axes = figure.add_axes(place)
            axes.imshow(middle(frame, STRIP_PANEL), aspect="auto")
            axes.set_title(f"{after:+.2f} s", fontsize=8, pad=2)
            axes.set_axis_off()
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_jpg(buffer, pil_kwargs={"quality": QUALITY, "optimize": True})
    return buffer.getvalue()


FOLDER = "films"  # below the results
SECONDS = 12.0  # that a film takes, about


class Disagreement(NamedTuple):
    """A push that one policy recovers from and another one does not."""

    place: int  # in the suite, from 0
    scenario: Scenario
    policies: tuple[str, str]  # in the order of the evaluation


def disagreements(evaluation: Evaluation) -> list[Disagreement]:
    """Pushes on which policies disagree; of many, the first that recovers and the first that does not.

    Who recovers takes turns, so that a few from the front show both sides.
    """
    turns: dict[tuple[str, str], list[Disagreement]] = {}
    order = list(evaluation.rows)
    for index, (scenario, rows) in enumerate(evaluation.by_scenario()):
        ends = {bool(row["recovered"]): name for name, row in reversed([*zip(order, rows, strict=True)])}
        if len(ends) == 2:
            first, second = sorted(ends.values(), key=order.index)
            turns.setdefault((ends[True], ends[False]), []).append(
                Disagreement(index, scenario, (first, second))
            )
    return [found for found in chain.from_iterable(zip_longest(*turns.values())) if found is not None]


def film_discordant(evaluation: Evaluation, count: int, policies: Any) -> list[Path]:
    """Film at most `count` of the pushes on which the policies disagree, as GIF and mp4; returns the paths.

    `policies` are those that were scored, which their names alone do not say where they were trusted.

    Raises:
        PushRecoveryError: nothing can be drawn here.
    """
    found = disagreements(evaluation)
    chosen, folder, paths = found[:count], evaluation.directory / FOLDER, []
    what = f"films of {len(chosen)} of the {len(found)} pushes on which the policies disagree"
    if not chosen:
        say(Work(what, about(0.0)))
        return []
    folder.mkdir(parents=True, exist_ok=True)
    scored = {name: {name: source.origin} for name, source in policy_sources(policies).items()}
    work = Work(what, about(SECONDS * len(chosen)), folder)
    with progress_bars([FOLDER], len(chosen), work) as bars:
        for done, (index, scenario, names) in enumerate(chosen):
            shots = [shoot(evaluation.env_id, scored[name], scenario, RATE / SLOW) for name in names]
            paths += write_pair(shots, folder / film_name(index, scenario.id))
            bars.set(FOLDER, done + 1)
    return paths


def film_name(index: int, scenario_id: str) -> str:
    """Stem of a film's files: place in the suite and id, without what the name of a file can't hold."""
    return f"{index:04d}-{re.sub(r'[^A-Za-z0-9.+-]+', '_', scenario_id)[:80]}"
