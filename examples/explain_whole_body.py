"""Draw the pictures of docs/whole-body.md from the robot: python examples/explain_whole_body.py [DIR]."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from push_recovery.controllers.policies import make_policy
from push_recovery.envs.biped_model import biped_model
from push_recovery.envs.biped_scene import set_posture
from push_recovery.envs.biped_settings import BIPED_BOUNDS
from push_recovery.envs.canvas import Canvas
from push_recovery.envs.leg_kinematics import SHANK, THIGH
from push_recovery.envs.motors import driving_share
from push_recovery.envs.push import GaitEvent, Push
from push_recovery.envs.scenario import Scenario
from push_recovery.eval.reproduction.style import (
    COM_COLOUR,
    COP_COLOUR,
    PUSH_COLOUR,
    WIDTH,
    new_figure,
    print_style,
    save,
)

FORCE, DURATION = -700.0, 0.1  # of the push, backward [N], [s]
BEFORE, AFTER = 0.1, 1.1  # of the time shown about the onset [s]
SHOT = 0.28  # of the rendered picture, from the onset [s]
BLUE, ORANGE, GREY = "#0064a8", "#c44601", "#777777"
KNEES, FIRST_LEG_JOINT = (5, 11), 3  # motors of the knees, in the order of the model; hip joint in xanchor
CROP = 130  # of the rendered picture, left and right [pixels]


class Recorder:
    """What one push does, sampled at every physics step."""

    def __init__(self) -> None:
        env = gym.make("push_recovery:PushRecovery/Biped-v0")
        self.biped: Any = env.unwrapped
        self.core = self.biped.core
        self.rows: list[dict[str, float]] = []
        self.knee: list[tuple[float, float]] = []  # speed [rad/s], torque [N m]
        self._speed = np.zeros(14)
        policy = make_policy("two-stage", self.biped.robot, self.biped.limits, self.biped.preset)
        self.core.after_physics_step = self._look
        push = Push((FORCE, 0.0, 0.0), DURATION, GaitEvent(4, "left"))
        observation, info = env.reset(options={"scenario": Scenario("backward", (push,))})
        self._com, self._sole = self._points()
        self.picture: Any = None
        over = False
        while not over:
            observation, _, terminated, truncated, info = env.step(policy.predict(observation)[0])
            over = terminated or truncated
            begun = info["push"]["start"]  # None before
            if self.picture is None and begun is not None and info["time"] >= begun + SHOT:
                self.picture, self.marks = render(self.core)
        self.start, self.recovered_at = info["push"]["start"], info["recovered_at"]
        self.series = {name: np.array([row[name] for row in self.rows]) for name in self.rows[0]}
        self.time = self.series["time"] - self.start

    def _points(self) -> tuple[np.ndarray, np.ndarray]:
        """CoM, and the centre of both soles, in the world."""
        data = self.core.physics
        feet = [biped_model().body(name).id for name in ("left_foot", "right_foot")]
        soles = [data.xpos[0, b] + data.xmat[0, b].reshape(3, 3) @ (0.0, 0.0, -0.06) for b in feet]
        return data.com[0, 0].copy(), np.array(soles)

    def _look(self) -> None:
        core, robot = self.core, self.biped.robot
        stance, plan, wrench = int(core.gait.stance[0]), core.gait.plan[0], core.gait.wrench[0]
        cmp = plan[3] + robot.cmp_per_trunk_acceleration * plan[5]
        asked = robot.omega**2 * (self._com[0] - self._sole[stance, 0] - cmp)  # as `walk` saw it
        torque, speed = core.physics.ctrl[0].copy(), core.physics.qvel[0, 6:].copy()
        com, sole = self._com, self._sole = self._points()
        hips = core.physics.xanchor[0, [3, 9]]
        ankles = core.physics.xanchor[0, [7, 13]]
        lengths = np.linalg.norm(hips - ankles, axis=1)
        self.rows.append({
            "time": core.gait.time[0], "asked": asked, "given": wrench[0] / robot.mass,
            "cop": -wrench[4] / wrench[2], "planned_cop": plan[3], "waist": torque[0],
            "height_asked": core.gait.height[0, 0], "height": com[2] - sole[stance, 2],
            "stance_leg": lengths[stance], "swing_leg": lengths[1 - stance], "elapsed": core.gait.elapsed[0],
            "knee": np.abs(speed[list(KNEES)]).max(), "at_bound": float(self._at_bound(torque, wrench)),
        })  # fmt: skip
        self.knee += [(float(self._speed[i]), float(torque[i])) for i in KNEES]
        self._speed = speed

    def _at_bound(self, torque: np.ndarray, wrench: np.ndarray) -> bool:
        model, s = biped_model(), BIPED_BOUNDS
        top, free = model.actuator_forcerange[:, 1], model.actuator_user[:, 0]
        share = [driving_share(v * np.sign(t), f) for v, t, f in zip(self._speed, torque, free, strict=True)]
        x, y = -wrench[4] / wrench[2], wrench[3] / wrench[2]
        yaw = wrench[5] - x * wrench[1] + y * wrench[0]
        near = 1e-3
        return bool(
            (np.abs(torque) > top * np.array(share) - near * top).any()
            or abs(x) > s.cop_x_max - near * 0.1
            or abs(y) > s.cop_y_max - near * 0.1
            or abs(yaw) > (s.yaw_friction - near * 0.01) * wrench[2]
            or np.abs(wrench[:2]).max() > (s.friction - near) * wrench[2]
        )


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


def tasks(record: Recorder) -> Any:
    """The robot in a hard step, with what every part of it is asked to do."""
    figure = new_figure(WIDTH, 4.1)
    axes = figure.subplots()
    height, width = record.picture.shape[:2]
    left, right = CROP, width - CROP
    axes.imshow(record.picture[:, left:right], extent=(left, right, height, 0))
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
        axes.annotate(text, record.marks[name], place, arrowprops=arrow, **look)
        axes.plot(*record.marks[name], "o", color=BLUE, mec="white", ms=6)
    axes.set(xlim=(left - 240, right + 220), ylim=(height, 0))
    axes.axis("off")
    return figure


def knee(record: Recorder) -> Any:
    """How fast a knee has to turn for one metre a second of leg, and what its motor gives at that speed."""
    figure = new_figure(WIDTH, 2.9)
    geometry, motor = figure.subplots(1, 2)
    model = biped_model()
    top, free = model.actuator("left_knee").forcerange[1], model.actuator("left_knee").user[0]
    angle = np.radians(np.linspace(2.0, 130.0, 400))
    length = np.sqrt(THIGH**2 + SHANK**2 + 2 * THIGH * SHANK * np.cos(angle))
    rate = length / (THIGH * SHANK * np.sin(angle))
    geometry.plot(length, rate, color=BLUE, lw=2)
    geometry.axhline(free, color=ORANGE, ls="--")
    geometry.text(0.46, free + 0.5, "the motor gives nothing beyond", color=ORANGE)
    geometry.axvline(THIGH + SHANK, color=GREY, ls=":")
    geometry.axvline(0.673, color=GREY)
    geometry.text(0.668, 22, "reach of\nthe plan", ha="right", color=GREY)
    geometry.set(xlabel="hip to ankle [m]", ylabel="knee [rad/s] per 1 m/s", xlim=(0.45, 0.73), ylim=(0, 30))
    speed = np.linspace(-20.0, 20.0, 400)
    upper = [top * driving_share(v, free) for v in speed]
    lower = [-top * driving_share(-v, free) for v in speed]
    motor.fill_between(speed, lower, upper, color="#dcecf7")
    motor.plot(speed, upper, color=BLUE)
    motor.plot(speed, lower, color=BLUE)
    motor.plot(*np.array(record.knee).T, ".", color=COM_COLOUR, ms=2)
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
    rows[0].set(ylabel="CoM height [m]", ylim=(0.755, 0.815))
    rows[0].legend(loc="lower right")
    rows[1].plot(time, s["stance_leg"], color=COM_COLOUR, label="stance leg")
    rows[1].plot(time, s["swing_leg"], "--", color=GREY, label="swing leg")
    rows[1].axhline(THIGH + SHANK, color=ORANGE, ls=":")
    rows[1].axhline(0.673, color=BLUE, ls=":")
    rows[1].set(ylabel="hip to ankle [m]", ylim=(0.5, 0.745))
    rows[1].legend(loc="lower right", ncols=2)
    rows[2].plot(time, s["knee"], color=COM_COLOUR)
    rows[2].axhline(14.0, color=ORANGE, ls=":")
    rows[2].set(ylabel="faster knee [rad/s]", xlabel="time from the push [s]", xlim=(-BEFORE, AFTER))
    for i, axes in enumerate(rows):
        bind(record, axes, i == 0)
    return figure


def bounds(record: Recorder) -> Any:
    """What was asked of the CoM and what the bounds left of it."""
    figure = new_figure(WIDTH, 4.2)
    rows, s, time = figure.subplots(3, 1, sharex=True, height_ratios=[1.3, 1, 1]), record.series, record.time
    rows[0].plot(time, s["asked"], color=BLUE, lw=2.4, label="asked: ω² (x - p)")
    rows[0].plot(time, s["given"], "--", color=COM_COLOUR, label="kept within the bounds")
    rows[0].set(ylabel="CoM'' forward\n[m/s²]")
    rows[0].legend(loc="lower right")
    rows[1].plot(time, s["planned_cop"], color=BLUE, lw=2.4, label="planned")
    rows[1].plot(time, s["cop"], "--", color=COP_COLOUR, label="of the contact wrench")
    for side in (-1.0, 1.0):
        rows[1].axhline(side * 0.0791, color=GREY, ls=":")
    rows[1].set(ylabel="CoP forward [m]", ylim=(-0.17, 0.115))
    rows[1].legend(loc="lower right", ncols=2)
    rows[2].plot(time, s["waist"], color=COM_COLOUR)
    for side in (-1.0, 1.0):
        rows[2].axhline(side * 150.0, color=GREY, ls=":")
    rows[2].set(
        ylabel="waist [N m]", xlabel="time from the push [s]", xlim=(-BEFORE, AFTER), ylim=(-190, 190)
    )
    for i, axes in enumerate(rows):
        bind(record, axes, i == 0)
        where = axes.get_xaxis_transform()
        hit = s["at_bound"] > 0
        axes.fill_between(time, 0.0, 0.04, where=hit, color=ORANGE, transform=where, step="mid", lw=0)
    return figure


def report(record: Recorder) -> None:
    """Print the figures that the page gives."""
    s, seen = record.series, (record.time > -BEFORE) & (record.time < AFTER)
    after = (record.time >= 0) & (record.time < AFTER)
    print(f"{FORCE:.0f} N for {DURATION:g} s: recovered at {record.recovered_at}")
    print(f"height: error at most {1000 * np.abs(s['height'] - s['height_asked'])[seen].max():.1f} mm, "
          f"lowest {s['height'][seen].min():.3f} m")  # fmt: skip
    print(f"longest leg: stance {s['stance_leg'][seen].max():.3f}, swing {s['swing_leg'][seen].max():.3f} m; "
          f"fastest knee {s['knee'][seen].max():.1f} rad/s")  # fmt: skip
    print(f"at a bound in {100 * s['at_bound'][after].mean():.0f} % of the physics steps after the onset")
    short = np.abs(s["asked"] - s["given"])
    print(f"CoM'' asked less given: largest {short[seen].max():.2f} m/s^2, "
          f"from 0.2 s on {short[seen & (record.time > 0.2)].max():.2f} m/s^2")  # fmt: skip


def main() -> None:
    """Write the pictures into the directory given, docs/pictures by default."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "pictures")
    record = Recorder()
    report(record)
    with print_style():
        for draw in (tasks, knee, height, bounds):
            png, svg = save(draw(record), directory, f"whole-body-{draw.__name__}")
            svg.unlink()
            print(f"{png} {png.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
