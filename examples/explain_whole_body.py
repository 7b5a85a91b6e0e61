"""Draw the pictures of docs/whole-body.md from the robot: python examples/explain_whole_body.py [DIR].

It prints the figures of the page, too, settings first.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.whole_body.limits import driving_share
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.biped.posture import leg_geometry
from push_recovery.envs.biped.view import set_posture
from push_recovery.envs.rendering import Canvas
from push_recovery.envs.robots.biped import biped, biped_model
from push_recovery.eval.record.style import (
    COM_COLOUR,
    COP_COLOUR,
    PUSH_COLOUR,
    WIDTH,
    new_figure,
    print_style,
    save,
)
from whole_body_record import KNEES, Recorder, Walk, leg_momentum

FORCE, DURATION = 800.0, 0.1  # of the push, backward [N], [s]
THIGH, SHANK, *_ = leg_geometry(biped().model, biped().indices)  # [m]
BEFORE, AFTER = 0.1, 1.1  # of the time shown about the onset [s]
SHOT = 0.28  # of the rendered picture, from the onset [s]
BLUE, ORANGE, GREY = "#0064a8", "#c44601", "#777777"
MOTORS = biped().motors  # torque [N m], speed without load [rad/s]
CROP = 130  # of the rendered picture, left and right [pixels]


def render(core: Any) -> tuple[np.ndarray, dict[str, tuple[float, float]]]:
    """The robot, and where its parts are in the picture [pixels]."""
    model = biped_model()
    data, scene, camera = mujoco.MjData(model), mujoco.MjvScene(model, maxgeom=200), mujoco.MjvCamera()
    set_posture(model, data, core)
    camera.type, camera.distance = mujoco.mjtCamera.mjCAMERA_FREE, 2.35
    camera.azimuth, camera.elevation = 120.0, -10.0
    camera.lookat[:] = (*data.body("pelvis").xpos[:2], 0.74)
    for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
        scene.flags[flag.value] = 0
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, scene)
    canvas = Canvas(model, 640, 480)
    image = canvas.draw(scene)
    canvas.close()
    eyes = scene.camera
    eye, forward, up = eyes[0].pos / 2 + eyes[1].pos / 2, np.array(eyes[0].forward), np.array(eyes[0].up)
    scale = eyes[0].frustum_near / eyes[0].frustum_top * image.shape[0] / 2
    stance = int(core.gait.stance[0])
    names = ("left_foot", "right_foot")
    points = {
        "com": data.subtree_com[0], "pelvis": data.body("pelvis").xpos, "waist": data.body("trunk").xpos,
        "stance": data.body(names[stance]).xpos, "swing": data.body(names[1 - stance]).xpos,
    }  # fmt: skip
    marks = {}
    for name, point in points.items():
        ray = np.array(point) - eye
        depth = ray @ forward
        right = np.cross(forward, up)
        x = image.shape[1] / 2 + scale * (ray @ right) / depth
        marks[name] = float(x), float(image.shape[0] / 2 - scale * (ray @ up) / depth)
    return image, marks


class Shot:
    """The picture of the robot once SHOT has passed since the push."""

    def __init__(self) -> None:
        self.picture: Any = None
        self.marks: dict[str, tuple[float, float]] = {}

    def __call__(self, core: Any, info: dict[str, Any]) -> None:
        """Look at the robot after a planning period."""
        begun = info["push"]["start"]  # None before
        if self.picture is None and begun is not None and info["time"] >= begun + SHOT:
            self.picture, self.marks = render(core)


def tasks(shot: Shot) -> Any:
    """The robot in a hard step, with what every part of it is asked to do."""
    figure = new_figure(WIDTH, 4.1)
    axes = figure.subplots()
    height, width = shot.picture.shape[:2]
    left, right = CROP, width - CROP
    axes.imshow(shot.picture[:, left:right], extent=(left, right, height, 0))
    texts = {
        "waist": ("waist (2 rows):\ntrunk'' of the plan", (left - 20, 60)),
        "com": ("CoM (3): as the pendulum,\nheight on its quintic", (left - 20, 200)),
        "stance": ("stance sole (6):\nstays as it is", (left - 20, 390)),
        "pelvis": ("pelvis (3): upright,\nalong the heading", (right + 20, 190)),
        "swing": ("swing sole (6): level,\non its trajectory", (right + 20, 390)),
    }
    for name, (text, place) in texts.items():
        look: dict[str, Any] = {"color": BLUE, "va": "center", "ha": "right" if place[0] < left else "left"}
        arrow = {"arrowstyle": "-", "color": BLUE, "lw": 1.0}
        axes.annotate(text, shot.marks[name], place, arrowprops=arrow, **look)
        axes.plot(*shot.marks[name], "o", color=BLUE, mec="white", ms=6)
    axes.set(xlim=(left - 240, right + 220), ylim=(height, 0))
    axes.axis("off")
    return figure


def knee_rate(length: Any) -> Any:
    """Rate of the knee for one metre a second of a leg of this length [1/m]."""
    cosine = (length**2 - THIGH**2 - SHANK**2) / (2 * THIGH * SHANK)
    return length / (THIGH * SHANK * np.sqrt(1 - cosine**2))


def knee(record: Recorder) -> Any:
    """How fast a knee has to turn for one metre a second of leg, and what its motor gives at that speed."""
    figure = new_figure(WIDTH, 2.9)
    geometry, motor = figure.subplots(1, 2)
    top, free = MOTORS[:, KNEES[0]]
    angle = np.radians(np.linspace(2.0, 130.0, 400))
    length = np.sqrt(THIGH**2 + SHANK**2 + 2 * THIGH * SHANK * np.cos(angle))
    geometry.plot(length, knee_rate(length), color=BLUE, lw=2)
    geometry.axhline(free, color=ORANGE, ls="--")
    geometry.text(0.46, free + 0.5, "no torque beyond", color=ORANGE)
    geometry.axvline(THIGH + SHANK, color=GREY, ls=":")
    geometry.axvline(BIPED_GAIT.reach, color=GREY)
    geometry.text(BIPED_GAIT.reach - 0.005, 22, "reach of\nthe plan", ha="right", color=GREY)
    geometry.set(xlabel="hip to ankle [m]", ylabel="knee [rad/s] per 1 m/s", xlim=(0.45, 0.73), ylim=(0, 30))
    speed = np.linspace(-20.0, 20.0, 400)
    upper = [top * driving_share(v, free) for v in speed]
    lower = [-top * driving_share(-v, free) for v in speed]
    motor.fill_between(speed, lower, upper, color="#dcecf7")
    motor.plot(speed, upper, color=BLUE)
    motor.plot(speed, lower, color=BLUE)
    motor.plot(record.series["knee_speed"], record.series["knee_torque"], ".", color=COM_COLOUR, ms=2)
    motor.set(xlabel="speed of the knee [rad/s]", ylabel="torque [N m]", xlim=(-20, 20), ylim=(-345, 345))
    return figure


def bind(record: Recorder, axes: Any, first: bool) -> None:
    """Shade the steps alternately and mark the push."""
    begins = record.time[np.flatnonzero(np.diff(record.series["elapsed"]) < 0) + 1]
    for a, b in zip(begins[::2], begins[1::2], strict=False):
        axes.axvspan(a, b, color="#f4f1ea", zorder=0)
    axes.plot([0.0, DURATION], [0.985] * 2, color=PUSH_COLOUR, lw=5, transform=axes.get_xaxis_transform())
    if first:
        axes.text(DURATION + 0.01, 0.9, "push", color=PUSH_COLOUR, transform=axes.get_xaxis_transform())


def height(record: Recorder) -> Any:
    """CoM height, leg length and knee speed in a backward push."""
    figure = new_figure(WIDTH, 4.0)
    rows, s, time = figure.subplots(3, 1, sharex=True), record.series, record.time
    rows[0].plot(time, s["height_asked"], color=BLUE, lw=2.4, label="asked: the quintic")
    rows[0].plot(time, s["height"], "--", color=COM_COLOUR, label="of the robot")
    shown = (time > -BEFORE) & (time < AFTER)
    lowest = min(s["height"][shown].min(), s["height_asked"][shown].min())
    rows[0].set(ylabel="CoM height [m]", ylim=(lowest - 0.01, 0.815))
    rows[0].legend(loc="lower right")
    rows[1].plot(time, s["stance_leg"], color=COM_COLOUR, label="stance leg")
    rows[1].plot(time, s["swing_leg"], "--", color=GREY, label="swing leg")
    rows[1].axhline(THIGH + SHANK, color=ORANGE, ls=":")
    rows[1].axhline(BIPED_GAIT.reach, color=BLUE, ls=":")
    rows[1].set(ylabel="hip to ankle [m]", ylim=(0.46, 0.745))
    rows[1].legend(loc="lower right", ncols=2)
    rows[2].plot(time, s["knee"], color=COM_COLOUR)
    rows[2].axhline(MOTORS[1, KNEES[0]], color=ORANGE, ls=":")
    rows[2].set(ylabel="faster knee [rad/s]", xlabel="time from the push [s]", xlim=(-BEFORE, AFTER))
    for i, axes in enumerate(rows):
        bind(record, axes, i == 0)
    return figure


def bounds(record: Recorder) -> Any:
    """What the plan has for the CoM and what the body does."""
    figure = new_figure(WIDTH, 4.2)
    rows, s, time = figure.subplots(3, 1, sharex=True, height_ratios=[1.3, 1, 1]), record.series, record.time
    rows[0].plot(time, s["of_plan"], color=BLUE, lw=2.4, label="of the plan: ω² (x - p)")
    rows[0].plot(time, s["given"], "--", color=COM_COLOUR, label="with what the body adds, within the bounds")
    rows[0].set(ylabel="CoM'' forward\n[m/s²]", ylim=(-2.6, 1.25 * s["given"].max()))
    rows[0].legend(loc="upper right")
    rows[1].plot(time, s["planned_cop"], color=BLUE, lw=2.4, label="planned")
    rows[1].plot(time, s["cop"], "--", color=COP_COLOUR, label="of the contact wrench")
    for side in (-1.0, 1.0):
        rows[1].axhline(side * BIPED_BOUNDS.cop_x_max, color=GREY, ls=":")
    rows[1].set(ylabel="CoP forward [m]", ylim=(-0.17, 0.115))
    rows[1].legend(loc="lower right", ncols=2)
    rows[2].plot(time, s["waist"], color=COM_COLOUR)
    for side in (-1.0, 1.0):
        rows[2].axhline(side * MOTORS[0, 0], color=GREY, ls=":")
    rows[2].set(
        ylabel="waist [N m]", xlabel="time from the push [s]", xlim=(-BEFORE, AFTER), ylim=(-190, 190)
    )
    for i, axes in enumerate(rows):
        bind(record, axes, i == 0)
        where = axes.get_xaxis_transform()
        hit = s["at_bound"] > 0
        axes.fill_between(time, 0.0, 0.04, where=hit, color=ORANGE, transform=where, step="mid", lw=0)
    return figure


def report_settings() -> None:
    """Print the constants of the page, and what follows from them."""
    for settings in (BIPED_GAINS, BIPED_GAIT, BIPED_BOUNDS):
        print(settings)
    model = biped_model()
    for i, (torque, speed) in enumerate(MOTORS.T):
        print(f"{model.actuator(i).name}: {torque:g} N m, {speed:g} rad/s")
    for length in (0.55, BIPED_GAIT.reach, 0.71):
        print(f"leg of {length:.3f} m: knee {knee_rate(length):.1f} rad/s per m/s")
    delay = preset_config("biped").touchdown_delay
    nominal = nominal_gait(BIPED, BIPED_LIMITS, (0.5, 0.0), delay)
    growth = math.exp(BIPED.omega * (nominal.duration + delay))
    print(f"walking at 0.5 m/s: the DCM grows {growth:.2f} times in a step, "
          f"at its end by {BIPED.omega * (nominal.length + nominal.offset_x):.2f} m/s")  # fmt: skip


def report_probes() -> None:
    """Print what the robot does when asked for one thing at a time."""
    forward, aside = leg_momentum()
    print(f"CoP for an acceleration of the swing sole: {forward:.5f} s^2 forward, {aside:.5f} s^2 aside")
    for change in (-0.003, 0.0, 0.003):
        delay = BIPED_GAIT.landing_delay + change
        walk = Walk(delay)
        landed = 1000 * np.array(walk.landed[4:])
        print(
            f"aiming at the floor {1000 * delay:.1f} ms after T: lands {landed.min():.1f} to "
            f"{landed.max():.1f} ms after T, walks at {walk.speed:.3f} m/s, "
            f"sole {1000 * np.median(walk.depth):.2f} mm deep"
        )


def report_push(record: Recorder) -> None:
    """Print what the push does."""
    s, seen = record.series, (record.time > -BEFORE) & (record.time < AFTER)
    after = (record.time >= 0) & (record.time < AFTER)
    print(f"{FORCE:.0f} N backward for {DURATION:g} s: recovered at {record.recovered_at}")
    print(f"height: error at most {1000 * np.abs(s['height'] - s['height_asked'])[seen].max():.1f} mm, "
          f"lowest {s['height'][seen].min():.3f} m")  # fmt: skip
    print(f"longest leg: stance {s['stance_leg'][seen].max():.3f}, swing {s['swing_leg'][seen].max():.3f} m; "
          f"fastest knee {s['knee'][seen].max():.1f} rad/s")  # fmt: skip
    k = np.argmax(s["swing"] * after)
    swing, length, duration = s["swing"][k], s["length"][k], s["duration"][k]
    print(f"swing sole: at most {swing:.0f} m/s^2, in a step of {length:.2f} m in {duration:.3f} s, "
          f"which moves the CMP by {leg_momentum()[0] * swing:.2f} m")  # fmt: skip
    added = (s["given"] - s["of_plan"])[after].max()
    print(f"the body adds at most {added:.1f} m/s^2, {added / BIPED.omega**2:.2f} m of CMP")
    for end in (0.5, AFTER):
        share = s["at_bound"][after & (record.time < end)].mean()
        print(f"at a bound in {100 * share:.0f} % of the first {end} s")
    for start in (0.0, 0.2, 0.3, 0.5, 0.6):
        short = (s["of_plan"] - s["given"])[after & (record.time >= start)]
        print(f"CoM'' planned less given from {start} s on: at most {short.max():.2f} m/s^2")


def main() -> None:
    """Write the pictures into the directory given, docs/pictures by default."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "pictures")
    shot = Shot()
    record = Recorder(FORCE, DURATION, shot)
    report_settings()
    report_probes()
    report_push(record)
    with print_style():
        figures = {"tasks": tasks(shot), "knee": knee(record), "height": height(record),
                   "bounds": bounds(record)}  # fmt: skip
        for name, figure in figures.items():
            png, svg = save(figure, directory, f"whole-body-{name}")
            svg.unlink()
            print(f"{png} {png.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
