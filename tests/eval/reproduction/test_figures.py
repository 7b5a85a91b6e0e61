"""The figures of the reproduction: files, equal bytes, looks by variant, units, and what they draw."""

import io
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image
from push_recovery.controllers.model.nominal_gait import NominalGait
from push_recovery.controllers.policies.two_stage import POLICY_NAMES
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.record import style
from push_recovery.eval.reproduction import figures as pictures
from push_recovery.eval.reproduction.jobs import case_numbers
from push_recovery.eval.reproduction.pendulum import Walk

PUSH_START, STEP = 2.6, 0.65  # [s]
CURVES = {"two-stage": [(0.0, 900.0), (90.0, 300.0), (180.0, 900.0), (270.0, 600.0)]}
LIMITS = {"F*": [(psi, 1000.0) for psi in range(0, 360, 30)]}


def walk(label: str = "two-stage", survived: bool = True) -> Walk:
    """A made-up walk of 0.5 m/s; the trunk sways after the push, and a fall's DCM runs away to the right."""
    time = np.arange(0.0, 6.5 if survived else 3.7, 0.02)
    step = np.floor(time / STEP + 1e-9).astype(np.int64)
    touchdown = STEP * np.arange(step[-1] + 1)
    side = np.arange(len(touchdown)) % 2
    foothold = np.column_stack([0.325 * np.arange(len(touchdown)), -0.2 * side])
    since = np.maximum(time - PUSH_START, 0.0)
    com_y = -0.1 - (0.02 * np.expm1(3.5 * since) if not survived else 0.0 * since)
    left, lift = side[step] == 0, 0.05 * np.abs(np.sin(math.pi * time / STEP))
    stance_x, nothing = foothold[step, 0], np.zeros(len(time))
    columns = {
        "time": time, "step": step.astype(float), "stance_side": side[step].astype(float),
        "com_x": 0.5 * time, "com_y": com_y, "dcm_x": 0.5 * time + 0.14, "dcm_y": com_y - 0.01 * since,
        "cop_x": stance_x, "cop_y": foothold[step, 1], "cmp_x": stance_x, "cmp_y": foothold[step, 1],
        "left_sole_y": nothing, "left_sole_z": np.where(left, 0.0, lift),
        "right_sole_y": nothing - 0.2, "right_sole_z": np.where(left, lift, 0.0),
        "trunk_pitch": nothing, "trunk_roll": -0.5 * np.sin(since) if survived else nothing,
        "torque_trunk_pitch": nothing, "torque_trunk_roll": -40.0 * np.sin(since),
    }  # fmt: skip
    scenario = Scenario("made up", (Push((0.0, -315.0, 0.0), 0.1, GaitEvent(4, "left", 0.0)),))
    bounds = {f"trunk_{axis}": math.pi / 3 for axis in ("pitch", "roll")}
    bounds |= {f"torque_trunk_{axis}": 150.0 for axis in ("pitch", "roll")}
    outcome: Any = SimpleNamespace(survived=survived)
    return Walk(scenario, outcome, columns, {}, bounds, (0.2, 0.1), (PUSH_START,), 60.0,
                label, 0.8, foothold, side, touchdown)  # fmt: skip


CASES = [walk("stage-1-paper", survived=False), walk("two-stage-paper")]


@pytest.fixture(autouse=True)
def coarse(monkeypatch) -> None:
    """Small pictures: the tests read none of their pixels."""
    monkeypatch.setattr(style, "PIXELS", 40)


@pytest.fixture
def figures(monkeypatch) -> list[Figure]:
    """The figures that are saved while a test runs; nothing is written."""
    seen: list[Figure] = []
    monkeypatch.setattr(style, "save", lambda figure, directory, stem: seen.append(figure) or [])
    return seen


def texts(axes) -> str:
    return " ".join([text.get_text() for text in axes.texts] + [axes.get_title("left")])


DRAWN = {
    "fig3_paths": pictures.draw_paths,
    "fig4_histories": pictures.draw_histories,
    "fig5_cartoon": pictures.draw_cartoon,
}


@pytest.mark.parametrize("stem", [*DRAWN, "fig7_limits"])
def test_a_figure_is_written_twice_with_the_same_bytes(stem, tmp_path):
    draw = DRAWN.get(stem, lambda walks, directory: pictures.draw_limits(CURVES, LIMITS, directory))
    first, second = (draw(CASES[1:], tmp_path / folder) for folder in "12")
    assert [path.name for path in first] == [f"{stem}.png", f"{stem}.svg"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert b"<dc:date>" not in first[1].read_bytes()
    assert sorted(path.name for path in (tmp_path / "1").iterdir()) == sorted(path.name for path in first)


def test_the_polar_map_is_closed_and_carries_its_unit(figures, tmp_path):
    pictures.draw_limits(CURVES, LIMITS, tmp_path, stem="fig7_jump", title="jump", unit="N s")
    (axes,) = figures[0].axes
    lines = {line.get_label(): line for line in axes.lines}
    drawn, every = lines["two-stage"].get_xydata(), lines["two-stage"].get_markevery()
    assert np.allclose(drawn[-1] - drawn[0], [2.0 * math.pi, 0.0])
    given = drawn[::every]
    assert len(given) == len(CURVES["two-stage"]) + 1
    assert np.allclose(given[1], [math.pi / 2, 300.0])  # counter-clockwise from forward, which is up
    assert every == 30  # 3 degrees
    assert np.allclose(drawn[10], (2.0 * given[0] + given[1]) / 3.0)  # no chord: linear in the angle
    assert axes.get_theta_direction() == 1
    assert axes.get_theta_offset() == pytest.approx(math.pi / 2)
    assert "limit F*: foot + flywheel" in lines
    assert "200 N s" in texts(axes)
    for word in ("forward", "right: towards the swing foot", "left: towards the stance foot"):
        assert word in texts(axes)


@pytest.mark.parametrize("stem", DRAWN)
def test_every_axis_has_a_unit(stem, figures, tmp_path):
    DRAWN[stem](CASES, tmp_path)
    panels = figures[0].axes
    assert all("[" in axes.get_ylabel() for axes in panels)
    assert "[" in panels[-1].get_xlabel()


def test_paths_end_the_fall_where_the_dcm_leaves_the_view(figures, tmp_path):
    pictures.draw_paths(CASES, tmp_path)
    falling, walking = figures[0].axes
    assert "stage 1, paper's weights: falls" in texts(falling)
    assert f"at t = {CASES[0]['time'][-1]:.2f} s" in texts(falling)
    assert "two-stage, paper's weights: recovers" in texts(walking)
    assert "beyond" not in texts(walking)
    assert "315 N for 0.1 s" in texts(walking)
    low, high = walking.get_ylim()
    view = pictures.in_view(CASES[1])
    assert low < CASES[1]["dcm_y"][view].min() < CASES[1]["dcm_y"][view].max() < high
    assert CASES[0]["dcm_y"].min() < low
    assert falling.get_ylim() == (low, high)


def test_histories_show_the_trunk_of_those_that_use_it(figures, tmp_path):
    pictures.draw_histories(CASES, tmp_path)
    lateral_a, lateral_b, angle, torque = figures[0].axes
    bounds = sorted({line.get_ydata()[0] for line in angle.lines if line.get_linestyle() == "--"})
    assert np.allclose(bounds, [-math.pi / 3, math.pi / 3])
    assert "[N m]" in torque.get_ylabel()
    start, end = PUSH_START - pictures.BEFORE, PUSH_START + pictures.AFTER
    inside = [t for t in CASES[1].touchdown if start < t < end]
    boundaries = [line for line in lateral_b.lines if line.get_color() == style.STEP_COLOUR]
    assert np.allclose([line.get_xdata()[0] for line in boundaries], inside)
    pictures.draw_histories([CASES[0]], tmp_path)
    assert len(figures[1].axes) == 1
    assert lateral_a.get_ylim() == lateral_b.get_ylim()


def test_the_cartoon_leans_and_steps_to_the_robots_right(figures, tmp_path):
    record = walk()
    sample = int(np.searchsorted(record["time"], PUSH_START + 1.5))
    with style.print_style():
        axes = style.new_figure(3, 3).subplots()
        pictures.draw_robot(axes, record, sample, shift=2.0)
    lean = record["trunk_roll"][sample]
    assert lean < -0.4  # to the right
    pelvis, neck = next(
        np.array(line.get_xydata()) for line in axes.lines if line.get_ydata()[-1] > record.com_height
    )
    assert np.allclose(pelvis, [2.0 - record["com_y"][sample], record.com_height])
    assert np.allclose(neck - pelvis, pictures.TRUNK * np.array([-math.sin(lean), math.cos(lean)]))
    pictures.draw_cartoon(CASES, tmp_path)
    falling, walking = figures[0].axes
    assert len(falling.get_xticks()) < len(walking.get_xticks()) == len(pictures.INSTANTS)
    assert "beyond recovery" in texts(falling)


def test_the_film_loops_at_half_speed_and_is_the_same_twice(tmp_path):
    film = pictures.save_film(CASES, tmp_path, fps=2)
    content = film.read_bytes()
    assert film.name == "fig5_motion.gif"
    assert pictures.save_film(CASES, tmp_path, fps=2).read_bytes() == content
    with Image.open(io.BytesIO(content)) as image:
        frames = getattr(image, "n_frames", 1)
        assert image.info["loop"] == 0
        assert image.info["duration"] == 500
        assert frames == round((pictures.FILM_BEFORE + pictures.FILM_AFTER) / pictures.SPEED * 2)


def test_every_policy_has_a_colour_a_line_and_a_marker_of_its_own():
    looks = [style.curve_style(name) for name in (*POLICY_NAMES, *style.POLICY_STYLES, *style.LIMIT_STYLES)]
    assert set(POLICY_NAMES) <= set(style.POLICY_STYLES)
    curves = list(style.POLICY_STYLES.values())
    for name in ("colour", "line", "marker"):
        assert len({getattr(look, name) for look in curves}) == len(curves)
    assert all(0.0 <= channel <= 1.0 for look in looks for channel in to_rgb(look.colour))


def test_limits_are_grey_and_part_by_line_and_lightness():
    looks = list(style.LIMIT_STYLES.values())
    assert all(len(set(to_rgb(look.colour))) == 1 for look in looks)
    assert len({look.line for look in looks}) == len({look.colour for look in looks}) == len(looks)


def test_an_unknown_policy_keeps_its_look_and_its_name(figures, tmp_path):
    look = style.curve_style("my policy")
    assert look == style.curve_style("my policy")
    assert look.label == "my policy"
    assert look != replace(style.curve_style("another"), label="my policy")
    pictures.draw_paths([walk("my policy")], tmp_path)
    assert "my policy" in texts(figures[0].axes[0])


def test_fonts_are_legible_in_print(figures, tmp_path):
    with style.print_style():
        pictures.draw_limits(CURVES, LIMITS, tmp_path)
        labels = figures[0].findobj(lambda artist: hasattr(artist, "get_fontsize"))
        assert min(text.get_fontsize() for text in labels) >= 9.0
    assert figures[0].get_size_inches()[0] <= style.WIDTH


def test_the_arrow_of_a_push_ends_where_it_acts():
    tail, tip = pictures._push_arrow(walk())
    assert (*tail, *tip) == pytest.approx((1.3, 0.12, 1.3, -0.1))


def test_leans_of_a_case_are_those_soon_after_the_push_ever_and_at_the_end():
    """Roll 0.5 sin t from the push on; x = 0.1 t^2 has the mean speed 0.1 (t1 + t2) between two times."""
    record = walk()
    record["com_x"][:] = 0.1 * record["time"] ** 2
    found = case_numbers(record, NominalGait(0.325, 0.2, STEP, 0.0, 0.0))
    end = record["time"][-1] - PUSH_START
    assert found["peak_lean_within_1_s"] == pytest.approx(0.5 * math.sin(1.0), abs=6e-3)
    assert found["peak_lean"] == pytest.approx(0.5, abs=1e-4)
    assert found["final_lean"] == pytest.approx(0.5 * abs(math.sin(end)))
    assert found["final_speed"] == pytest.approx(0.1 * (4.56 + 5.86), abs=5e-3)  # steps 7 and 8
    assert found["step_error_before"] == pytest.approx(0.0, abs=1e-12)


def test_seen_from_behind_a_push_to_the_right_comes_from_the_left_while_it_acts():
    record, tails = walk(), {}
    with style.print_style():
        for sample in (129, 130, 134, 135):  # at 2.58, 2.60, 2.68 and 2.70 s
            axes = style.new_figure(3, 3).subplots()
            pictures.draw_robot(axes, record, sample, shift=0.0)
            tails[sample] = [text.xyann for text in axes.texts]
    assert tails[129] == tails[135] == []
    for sample in (130, 134):
        assert tails[sample] == [pytest.approx((0.1 - 0.33, 0.8))]  # the pelvis is at (0.1, 0.8)


def test_the_view_holds_the_soles_and_the_dcm_of_those_that_stay_up():
    """Soles 0.1 m wide at 0 and -0.2 m, a margin of 0.06 m."""
    falls, stays = walk(survived=False), walk()
    for record in (falls, stays):
        record["dcm_y"][:] = -0.4
    assert pictures.lateral_limits([falls]) == pytest.approx((-0.31, 0.11))
    assert pictures.lateral_limits([stays]) == pytest.approx((-0.46, 0.11))
