"""Draw the pictures of docs/planner.md and print its figures: python examples/explain_planner.py [DIR]."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Ellipse, Rectangle
from push_recovery.controllers.model.capturability import max_recoverable_force, recoverable_offset
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.robot import GRAVITY, RobotModel
from push_recovery.controllers.qp import solve_qp
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.stage_1 import StepPlan, StepProblem, solve_step, stopping_debt, swing_time
from push_recovery.controllers.stage_2.single_support import CopPlanner
from push_recovery.envs.biped.core import BIPED, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.robots.biped import biped_model
from push_recovery.eval.record import style
from push_recovery.eval.record.style import COM_COLOUR, COP_COLOUR, DCM_COLOUR, WIDTH, new_figure

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
OMEGA = ROBOT.omega
NOMINAL = nominal_gait(ROBOT, LIMITS)
START = step_start_dcm(NOMINAL, ROBOT.pelvis_width, OMEGA)  # DCM of the nominal gait [m]
PUSH_COLOUR = style.PUSH_COLOUR
ARROW = {"arrowstyle": "-|>", "color": PUSH_COLOUR}
LATE, EARLY = "#c44601", "#0064a8"
GREY = "#777777"


def sole(axes: Any, x: float, y: float, **look: Any) -> None:
    """A sole seen from above, y to the swing side: forward is up, the swing side on the left."""
    half = ROBOT.foot_width / 2, ROBOT.foot_length / 2
    axes.add_patch(Rectangle((y - half[0], x - half[1]), 2 * half[0], 2 * half[1], **look))


def note(axes: Any, text: str, at: tuple[float, float], to: tuple[float, float], colour: str) -> None:
    """A word with a thin line to what it names."""
    arrow = {"arrowstyle": "-", "color": colour, "lw": 0.8}
    axes.annotate(text, to, at, color=colour, arrowprops=arrow, ha="center", va="center")


def pendulum() -> Any:
    """The model, and how its two halves move over a resting CoP."""
    figure = new_figure(WIDTH, 2.9)
    model, motion = figure.subplots(1, 2, width_ratios=[1, 1.25])
    com, velocity, cop, cmp = 0.05, 0.5, 0.02, -0.08
    dcm, height = com + velocity / OMEGA, ROBOT.com_height
    model.plot([-0.4, 0.5], [0, 0], color="#555555", lw=1.2)
    model.add_patch(Rectangle((-0.1, -0.03), 0.2, 0.03, color="#c8ccd2"))
    model.plot([cop, com], [0, height], color=COM_COLOUR, lw=2.5)
    model.plot([cmp, com], [0, height], color=EARLY, lw=1.2, ls="--")
    model.add_patch(Ellipse((com, height), 0.16, 0.34, angle=-15, fc="#f6d7b0", ec="#b06a10"))
    model.plot(com, height, "o", color=COM_COLOUR, ms=6)
    model.annotate(
        "", (com + 0.2, height), (com + 0.02, height), arrowprops={"arrowstyle": "-|>", "color": "k"}
    )
    for x, colour in ((cop, COP_COLOUR), (cmp, EARLY), (dcm, DCM_COLOUR)):
        model.plot(x, 0, "o", color=colour, ms=7, zorder=5)
    note(model, "CoP z", (0.12, -0.15), (cop, 0), COP_COLOUR)
    note(model, "CMP p", (-0.2, -0.15), (cmp, 0), EARLY)
    note(model, "DCM\nξ = x + x'/ω", (0.4, 0.2), (dcm, 0.0), DCM_COLOUR)
    note(model, "CoM x", (-0.17, 0.76), (com, height), COM_COLOUR)
    model.text(com + 0.13, height + 0.04, "x'")
    model.text(-0.05, 1.06, "trunk: flywheel of\ninertia j, lean θ", va="bottom", ha="left")
    model.set(xlim=(-0.42, 0.62), ylim=(-0.22, 1.28), aspect="equal")
    model.axis("off")
    time = np.linspace(0.0, 0.9, 200)
    for start, look in ((0.02, "-"), (0.03, "--")):
        dcm_t = start * np.exp(OMEGA * time)
        stable = (-0.12 - 0.01) * np.exp(-OMEGA * time)  # x - x'/omega
        motion.plot(time, dcm_t, look, color=DCM_COLOUR, label=f"DCM ξ from {start} m")
        motion.plot(time, (dcm_t + stable) / 2, look, color=COM_COLOUR, label="CoM x of the same motion")
    motion.plot(time, stable, ":", color=GREY, label="other half, x - x'/ω")
    motion.set(xlabel="time [s]", ylabel="position from a resting CoP [m]", xlim=(0, 0.9), ylim=(-0.16, 0.6))
    motion.legend(loc="upper left")
    return figure


def worked_example(alpha_offset: float) -> StepPlan:
    """Stage 1's answer to a DCM 0.1 m ahead at the start of a step in place."""
    tau = [math.exp(OMEGA * t) for t in (NOMINAL.duration, LIMITS.duration_min, LIMITS.duration_max)]
    low, high = LIMITS.low, LIMITS.high
    return solve_step(
        StepProblem(
            (START[0] + 0.1, START[1]), (NOMINAL.length, NOMINAL.width), tau[0],
            (NOMINAL.offset_x, NOMINAL.offset_y), (low[0], low[1]), (high[0], high[1]), tau[1], tau[2],
            1.0, 1.0, alpha_offset,
        )
    )  # fmt: skip


def step_choice() -> Any:
    """The worked example of stage 1: where the DCM goes, and the time that it leaves."""
    figure = new_figure(WIDTH, 3.5)
    above, when = figure.subplots(1, 2, width_ratios=[1, 1.5])
    plan = worked_example(1e6)
    duration = plan.duration(OMEGA)
    sole(above, 0, 0, fc="#c8ccd2", ec="#555555")
    sole(above, 0, NOMINAL.width, fc="none", ec=GREY, ls="--")
    sole(above, *plan.step, fc="#dcecf7", ec=EARLY)
    end = START[1] * math.exp(OMEGA * NOMINAL.duration)
    above.plot([START[1], end], [0, 0], color=GREY, lw=1.5)
    above.plot(end, 0, "o", color=GREY, ms=5)
    ray = np.exp(OMEGA * np.linspace(0, duration, 20))
    above.plot(START[1] * ray, 0.1 * ray, color=DCM_COLOUR, lw=2)
    above.plot([START[1], START[1] * ray[-1]], [0.1, 0.1 * ray[-1]], "o", color=DCM_COLOUR, ms=5)
    above.annotate("", (START[1], 0.1), (START[1], 0.0), arrowprops=ARROW)
    above.text(-0.07, 0.03, "push", color=PUSH_COLOUR)
    above.text(-0.01, -0.17, "stance sole", ha="center")
    note(above, "nominal\nfoothold", (0.31, -0.16), (NOMINAL.width, -0.1), GREY)
    note(above, "foothold\nchosen", (0.31, 0.47), (plan.step[1] + 0.05, plan.step[0]), EARLY)
    note(above, "DCM", (-0.08, 0.36), (0.068, 0.36), DCM_COLOUR)
    above.set(xlim=(0.4, -0.23), ylim=(-0.22, 0.63), aspect="equal", ylabel="forward [m]")
    above.set_xlabel("towards the swing side [m]")
    time = np.linspace(0.25, 0.75, 200)
    ahead = 0.1 * np.exp(OMEGA * time)
    when.plot(time, ahead, color=DCM_COLOUR, lw=2, label="DCM forward at touchdown, 0.1 exp(ω T)")
    when.axhline(LIMITS.length_max, color=COM_COLOUR, lw=1.2)
    when.text(0.255, LIMITS.length_max + 0.015, "longest step, 0.5 m")
    when.axvline(LIMITS.duration_min, color=GREY, ls=":")
    when.text(LIMITS.duration_min + 0.006, 0.02, "T_min", color=GREY)
    when.axvline(NOMINAL.duration, color=GREY, ls="--")
    when.text(NOMINAL.duration + 0.006, 0.02, "T_nom", color=GREY)
    for alpha, colour, name in ((1e6, EARLY, "α₃ = 10⁶"), (1e3, LATE, "α₃ = 10³")):
        found = worked_example(alpha)
        t = found.duration(OMEGA)
        when.plot([t, t], [found.step[0], found.step[0] + found.offset[0]], color=colour, lw=4)
        when.plot(t, found.step[0] + found.offset[0], "o", color=colour, ms=7)
        text = f"{name}: T = {t:.3f} s, b_x = {1000 * found.offset[0]:.2f} mm"
        when.plot([], [], "o", color=colour, label=text)
        print(f"{text}, tau = {found.tau:.4f}, u = {found.step[0]:.3f}, {found.step[1]:.3f} m")
    when.set(xlabel="step duration T [s]", ylabel="[m]", xlim=(0.25, 0.75), ylim=(0, 1.5))
    when.legend(loc="upper left")
    return figure


def horizon() -> Any:
    """Stage 2's whole plan of a DCM that no step alone could catch."""
    config = preset_config("default")
    planner = CopPlanner(ROBOT, LIMITS, config)
    remaining, dcm, target = LIMITS.duration_min, 0.29, LIMITS.length_max + NOMINAL.offset_x
    problem = planner.program(np.array([remaining, dcm, 0, 0, 0, 0, 0, target, 0, 0, 0]), 0)
    x = solve_qp(problem.qp, "daqp").x
    cops, trunk = x[: problem.cops], x[problem.cops :]
    edges = np.concatenate([[0.0], np.cumsum(problem.durations)])
    figure = new_figure(WIDTH, 4.4)
    rows = figure.subplots(4, 1, sharex=True, height_ratios=[1.6, 1, 1, 1])
    fine = np.linspace(0.0, remaining, 200)
    rows[0].plot(fine, dcm * np.exp(OMEGA * fine), "--", color=GREY, label="CoP at the centre, trunk still")
    path = [dcm]
    for k in range(problem.cops):
        growth = math.exp(OMEGA * problem.durations[k])
        cmp = cops[k] + ROBOT.cmp_per_trunk_acceleration * trunk[k]
        path.append(growth * path[-1] - (growth - 1.0) * cmp)
    rows[0].plot(edges[: problem.cops + 1], path, "o-", color=DCM_COLOUR, ms=4, label="as planned")
    rows[0].axhline(target, color=EARLY, lw=1.0)
    rows[0].text(0.47, target + 0.03, "u_T + b_nom: wanted at touchdown", color=EARLY)
    rows[0].set(ylabel="DCM [m]", ylim=(0.2, 0.9))
    rows[0].legend(loc="upper right")
    rows[1].stairs(cops, edges[: problem.cops + 1], baseline=None, color=COP_COLOUR, lw=2)
    rows[1].axhline(problem.qp.upper[0], color=GREY, ls=":")
    rows[1].set(ylabel="CoP [m]", ylim=(-0.02, 0.13))
    rows[2].stairs(trunk, edges, baseline=None, color=EARLY, lw=2)
    for bound in (problem.qp.lower[problem.cops], problem.qp.upper[problem.cops]):
        rows[2].axhline(bound, color=GREY, ls=":")
    rows[2].set(ylabel="trunk\n[rad/s²]", ylim=(-23, 23))
    angle, rate, lean = 0.0, 0.0, [0.0]
    for d, a in zip(problem.durations, trunk, strict=True):
        angle, rate = angle + d * rate + d * d / 2 * a, rate + d * a
        lean.append(angle)
    rows[3].plot(edges, lean, "o-", color="#b06a10", ms=4)
    rows[3].axhline(ROBOT.trunk_angle_max, color=GREY, ls=":")
    rows[3].set(ylabel="lean [rad]", xlabel="time from now [s]", xlim=(0, edges[-1]), ylim=(-0.05, 1.2))
    for axes in rows:
        axes.axvspan(remaining, edges[-1], color="#f4f1ea", zorder=0)
    tail = "braking tail: the next step has begun,\nonly the trunk is planned"
    rows[1].text(remaining + 0.01, 0.05, tail, va="center")
    print(f"horizon: DCM at touchdown {path[-1]:.3f} m, free {dcm * math.exp(OMEGA * remaining):.3f} m")
    print(f"  CoP {np.round(cops, 3)}, trunk {np.round(trunk, 2)}, largest lean {max(lean):.2f} rad")
    return figure


def limit() -> Any:
    """The DCMs that can be recovered from at the start of a step, and how far pushes move it."""
    figure = new_figure(WIDTH, 3.7)
    axes = figure.subplots()
    kinds = (
        (True, True, "#dbe9f4", "+ trunk: 81 mm"), (True, False, "#b7d3ea", "+ CoP: 100, 50 mm"),
        (False, False, "#8fbbdc", "steps alone"),
    )  # fmt: skip
    for foot, flywheel, colour, label in kinds:
        b = recoverable_offset(ROBOT, LIMITS, foot=foot, flywheel=flywheel)
        corner, size = (b.low[0], b.low[1]), b.high - b.low
        axes.add_patch(Rectangle(corner, *size, fc=colour, ec="#35648c", lw=0.8))
        axes.text(b.low[0] + 0.01, b.low[1] + 0.01, label)
        print(f"{label}: {np.round(b.low, 3)} to {np.round(b.high, 3)} m")
    size = ROBOT.foot_length, ROBOT.foot_width
    axes.add_patch(Rectangle((-size[0] / 2, -size[1] / 2), *size, fc="none", ec=COM_COLOUR, lw=1.4))
    axes.text(0.105, -0.045, "stance sole")
    axes.plot(*START, "o", color=DCM_COLOUR, ms=7)
    labels = {0: (8, 4), 45: (4, -14), 90: (5, -8), -90: (5, 2), -45: (4, 4), -135: (-58, 4)}
    for degrees, place in labels.items():
        psi = math.radians(degrees)
        force = max_recoverable_force(ROBOT, psi)
        shift = force * -math.expm1(-OMEGA * 0.1) / (ROBOT.mass * OMEGA**2)
        tip = START[0] + shift * math.cos(psi), START[1] - shift * math.sin(psi)
        axes.annotate("", tip, START, arrowprops=ARROW)
        axes.annotate(f"{force:.0f} N", tip, place, textcoords="offset points", color=PUSH_COLOUR)
    axes.set(xlim=(-0.53, 0.62), ylim=(-0.19, 0.33), aspect="equal")
    axes.set(xlabel="DCM forward of the stance sole [m]", ylabel="to the swing side [m]")
    return figure


def biped_step() -> Any:
    """What the robot adds: the time that the foot needs, and the last moments of a step."""
    config, s = preset_config("biped"), BIPED_GAIT
    figure = new_figure(WIDTH, 3.0)
    need, line = figure.subplots(1, 2, width_ratios=[1, 1.15])
    distance = np.linspace(0.0, 0.9, 200)
    for speed, look in ((0.0, "-"), (2.0, "--"), (-2.0, ":")):
        time = [swing_time(d, speed, config.swing_acceleration) for d in distance]
        need.plot(distance, time, look, color=EARLY, label=f"moving there at {speed:g} m/s")
    need.axhline(BIPED_LIMITS.duration_min, color=GREY, lw=1)
    need.text(0.01, BIPED_LIMITS.duration_min + 0.004, "T_min", color=GREY)
    need.set(xlabel="way left for the foot [m]", ylabel="time it needs [s]", xlim=(0, 0.9), ylim=(0, 0.25))
    need.legend(loc="upper left")
    moments = (
        (-config.freeze, f"{1000 * config.freeze:.0f} ms before T: the plan is held"),
        (-s.early, f"{1000 * s.early:.0f} ms before T: contact counts"),
        (0.0, "T"),
        (
            config.touchdown_delay,
            f"T + {1000 * config.touchdown_delay:.1f} ms: new foot carries,\nas planned",
        ),
        (s.landing_delay, f"T + {1000 * s.landing_delay:.1f} ms: sole aims at floor"),
    )
    for row, (at, text) in enumerate(moments):
        height = len(moments) - row - 0.5
        line.plot([1000 * at] * 2, [0, height], color=GREY, lw=1)
        line.plot(1000 * at, height, "o", color=DCM_COLOUR, ms=5)
        line.text(1000 * at + 4, height, text, va="center")
    line.axvspan(-120, -1000 * config.freeze, color="#dcecf7")
    line.text(-117, 0.3, "both stages\nchoose")
    line.set(xlim=(-120, 225), ylim=(0, 5), xlabel="time from the planned touchdown T [ms]", yticks=[])
    line.grid(visible=False)
    return figure


def report() -> None:
    """Print the page's figures that no picture shows."""
    print(f"omega {OMEGA:.3f} 1/s; 21 N s move the DCM by {21 / (ROBOT.mass * OMEGA):.3f} m")
    print(
        f"the waist moves the CMP by {LIMITS.trunk_acceleration_max * ROBOT.cmp_per_trunk_acceleration:.3f} m"
    )
    debt = stopping_debt(3.0, ROBOT.cmp_per_trunk_acceleration, LIMITS.trunk_acceleration_max, OMEGA)
    print(f"stopping the trunk at 3 rad/s: {debt:.3f} m")
    config, trunk = preset_config("biped"), biped_model().body("trunk")
    print(config, BIPED_LIMITS, sep="\n")
    torque = float(trunk.mass[0] * GRAVITY * trunk.ipos[2])
    print(f"trunk: {trunk.mass[0]:g} kg x g x {trunk.ipos[2]:.3f} m = {torque:.0f} N m")
    print(f"push_threshold: {config.push_threshold * BIPED.mass * BIPED.omega**2:.0f} N")
    held = config.freeze + config.touchdown_delay
    share = 1.0 / -math.expm1(-OMEGA * held)
    print(f"a DCM off by d {held:.3f} s before the foot carries asks for a CoP off by {share:.1f} d")
    for robot, limits, late in ((ROBOT, LIMITS, 0.0), (BIPED, BIPED_LIMITS, config.touchdown_delay)):
        for speed in (0.0, 0.5):
            n = nominal_gait(robot, limits, (speed, 0.0), late)
            b, growth = (n.offset_x, n.offset_y), math.exp(OMEGA * (n.duration + late))
            print(f"{speed:g} m/s: L {n.length:.3f}, W {n.width:.3f} m, T {n.duration:.4f} s, "
                  f"b {np.round(b, 4)} m, lambda {growth:.2f}")  # fmt: skip


PICTURES = {
    "planner-pendulum": pendulum,
    "planner-step": step_choice,
    "planner-horizon": horizon,
    "planner-limit": limit,
    "planner-biped": biped_step,
}


def main() -> None:
    """Write the pictures into the directory given, docs/pictures by default."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "pictures")
    report()
    with style.print_style():
        for name, draw in PICTURES.items():
            png, svg = style.save(draw(), directory, name)
            svg.unlink()
            print(f"{png} {png.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
