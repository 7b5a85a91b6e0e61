"""Small steps in the floor, of which nobody is told, and footholds on one that is known."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.floor import BEHIND, SENDS, TAKEN, WAY_SIZE, FootholdPlanner, KnownFloor, Stance
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.robots.biped import PLAN, biped, biped_model
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.noise import uniform
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.scenario.terrain import DEPTH, TILE, Pattern, Stairs
from push_recovery.envs.scenario.terrain import TILES_PER_FOOT as AROUND
from push_recovery.eval.rollout.episodes import rollout_batch

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
PUSH = Push((60.0, 90.0, 0.0), 0.1, GaitEvent(1, "right", 0.3))
CORNERS = np.array([[x, y, -0.015] for x in (0.1, -0.1) for y in (0.05, -0.05)])  # of a sole, from its box


def uneven(step: float, seed: int = 3, stance: str = "left") -> Scenario:
    errors = ModelErrors(floor_step=step)
    return Scenario("a", (PUSH,), Command(0.3), stance, noise_seed=seed, errors=errors)  # type: ignore[arg-type]


def walk(core, seconds: float) -> None:
    for _ in range(round(100 * seconds)):
        action = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))


def own(core, k: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    return core.simulations.models[k], core.simulations.data[k]


def corners(core, foot: str, share: float = 1.0) -> np.ndarray:
    model, data = own(core)
    box = model.geom(foot).id
    return data.geom_xpos[box] + CORNERS * [share, share, 1.0] @ data.geom_xmat[box].reshape(3, 3).T


def test_uniform_numbers_are_uniform_and_independent():
    grid = np.array([[uniform(7, i, j) for j in range(-30, 30)] for i in range(-30, 30)])
    assert ((grid >= 0.0) & (grid < 1.0)).all()
    shares = np.histogram(grid, 10, (0.0, 1.0))[0] / grid.size
    np.testing.assert_allclose(shares, 0.1, atol=0.02)
    for a, b in ((grid[1:], grid[:-1]), (grid[:, 1:], grid[:, :-1])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.05


def test_the_tiled_model_is_the_biped_but_for_its_floor():
    plain, tiled = biped_model(), altered_model(biped(), ModelErrors(floor_step=0.01))
    assert tiled is not None
    for name in ("nq", "nv", "nu", "nbody", "njnt", "nsensordata"):
        assert getattr(tiled, name) == getattr(plain, name)
    for name in ("body_mass", "body_inertia", "dof_armature", "jnt_range", "actuator_forcerange"):
        np.testing.assert_array_equal(getattr(tiled, name), getattr(plain, name))
    for tile in range(2 * AROUND):
        pair = np.flatnonzero(tiled.pair_geom1 == tiled.geom(f"tile_{tile}").id).item()
        assert tiled.pair_geom2[pair] == tiled.geom(PLAN.sole_boxes[tile // AROUND]).id
        for name in ("pair_friction", "pair_solref", "pair_solimp", "pair_dim"):
            np.testing.assert_array_equal(getattr(tiled, name)[pair], getattr(plain, name)[0])


@pytest.mark.parametrize("stance", ["left", "right"])
def test_soles_begin_on_their_tiles_and_stay_above_them(biped_core, begin, stance):
    core, lowest, contacts = biped_core(), [], []
    begin(core, 0, uneven(0.02, stance=stance))
    seed, side = 3, 1.0 if stance == "left" else -1.0
    origin = np.array([uniform(seed, 1 << 40, 0), uniform(seed, 1 << 40, 1)])

    def height(x: float, y: float) -> float:
        i, j = np.floor(np.array([x, side * y]) / TILE - origin).astype(int)
        return 0.02 * uniform(seed, i, j)

    for foot in PLAN.sole_boxes:
        at = corners(core, foot)
        highest = max(height(x, y) for x, y in at[:, :2])
        np.testing.assert_allclose(at[:, 2], highest, atol=1e-9)

    def look():
        inner = [
            corner for foot in PLAN.sole_boxes for corner in corners(core, foot, 0.95)
        ]  # an edge may touch a wall
        lowest.append(min(z - height(x, y) for x, y, z in inner))
        contacts.append(own(core)[1].ncon)

    core.after_physics_step = look
    walk(core, 2.0)
    assert core.gait.failure[0] == 0
    assert -0.01 < min(lowest) < 0.0  # a corner of a foot that tips over an edge
    assert np.median(contacts) >= 2


def test_the_boxes_of_a_foot_hold_all_of_its_sole(biped_core, begin):
    core = biped_core()
    begin(core, 0, uneven(0.03))
    for _ in range(20):
        walk(core, 0.1)
        model, _ = own(core)
        for leg, foot in enumerate(PLAN.sole_boxes):
            boxes = model.geom_pos[[model.geom(f"tile_{AROUND * leg + i}").id for i in range(AROUND)]]
            assert ((boxes[:, 2] >= -DEPTH) & (boxes[:, 2] < 0.03 - DEPTH)).all()
            for corner in corners(core, foot):
                inside = (np.abs(boxes[:, :2] - corner[:2]) <= 0.5 * TILE + 1e-9).all(axis=1)
                assert inside.any()


def test_tiles_of_no_height_are_the_plane(biped_core, begin):
    core = biped_core(2)
    begin(core, 0, uneven(1e-9))
    begin(core, 1, Scenario("b", (PUSH,), Command(0.3)))
    walk(core, 1.0)
    np.testing.assert_allclose(core.physics.com[0, 0], core.physics.com[1, 0], atol=0.01)


def test_friction_holds_on_tiles_and_each_robot_has_tiles_of_its_own(biped_core, begin):
    slippery = altered_model(biped(), ModelErrors(friction=0.5, floor_step=0.02))
    assert slippery is not None
    on_floor = slippery.geom_bodyid[slippery.pair_geom1] == 0
    assert on_floor.sum() == 2 + 2 * AROUND
    np.testing.assert_array_equal(slippery.pair_friction[on_floor, :2], 0.5)
    np.testing.assert_array_equal(slippery.pair_friction[~on_floor, :2], 0.9)
    core = biped_core(2)
    for k in range(2):
        begin(core, k, uneven(0.02, seed=k))
    assert own(core, 0)[0] is not own(core, 1)[0]
    assert not np.array_equal(own(core, 0)[0].geom_pos, own(core, 1)[0].geom_pos)
    begin(core, 0, Scenario("level"))
    assert own(core)[0] is core.simulations.model
    assert own(core)[1].geom_xpos.shape == (biped_model().ngeom, 3)


OMEGA, CONFIG = BIPED.omega, preset_config("biped").replace(swing_acceleration=0.0)
FOOTHOLDS = FootholdPlanner(OMEGA, BIPED_LIMITS, CONFIG)
EDGE = KnownFloor((Stairs(0.1, 1, start=0.25, landing=3.0),), Pattern(), (0.1, 0.05))
LAST, BEYOND = 0.095, 0.405  # clear places for soles at 0.005 m end there and begin there
SHORT, LONG = 0.303, 0.444  # nominal time of a step, and three quarters of the way from it to the longest [s]


def standing(x: float = 0.005, time: float = 0.0, leg: int = 0, speed: float = 0.2) -> Stance:
    return Stance(leg, time, x, 0.0, 0.0, 0.2, speed)


def asked_with(dcm: float, behind: float = 0.0, taken: int = -1, speed: float = 0.2):
    """Way, the gait that asks for the DCM's own foothold, what comes of it, and the gain a (2,)."""
    way = np.zeros(WAY_SIZE)
    FOOTHOLDS.begin_step(EDGE, way, standing(speed=speed))
    way[BEHIND], way[TAKEN] = behind, taken
    obs = np.zeros(36)
    obs[1:3] = dcm, 0.05
    gain = obs[1:3] * math.exp(OMEGA * CONFIG.touchdown_delay)
    offset = np.array([0.03, -0.055])
    before = np.array([*(gain * math.exp(OMEGA * SHORT) - offset), SHORT, 0.0, 0.0, 0.0, 0.0])
    after = before.copy()
    FOOTHOLDS.move_step(way, speed, obs, after)
    return way, before, after, gain


def offset_of(gait: np.ndarray, gain: np.ndarray) -> float:
    """DCM at touchdown, by the pendulum with this CoP, less the foothold [m]."""
    growth = math.exp(OMEGA * (gait[2] + CONFIG.touchdown_delay))
    return gain[0] * math.exp(OMEGA * gait[2]) - gait[3] * (growth - 1.0) - gait[0]


def test_a_step_that_is_clear_stays_as_it_is():
    _, before, after, _ = asked_with(0.02)
    assert before[0] < LAST
    np.testing.assert_allclose(after, before, atol=1e-12)


@pytest.mark.parametrize(("dcm", "crosses"), [(0.055, False), (0.075, False), (0.1, True), (0.115, True)])
def test_a_step_onto_an_edge_is_moved_to_where_the_dcm_gets(dcm, crosses):
    """The same DCM offset comes of it, by more or less time and by the CoP."""
    way, before, after, gain = asked_with(dcm)
    assert LAST < before[0] < BEYOND
    assert after[0] == pytest.approx(BEYOND if crosses else LAST - 0.005, abs=0.011)
    assert (after[2] > SHORT) == crosses
    assert abs(after[3]) < BIPED_LIMITS.cop_x_max
    assert offset_of(after, gain) == pytest.approx(0.03)
    assert way[TAKEN] == crosses


def test_the_interval_taken_is_kept_where_another_one_is_hardly_better():
    crossing = [asked_with(0.088, taken=taken)[2][0] > 0.3 for taken in (0, 1)]
    assert crossing == [False, True]


@pytest.mark.parametrize("behind", [0.0, 0.3])
def test_a_robot_behind_its_command_sends_its_dcm_ahead(behind):
    """From the offset that it gets in place the pendulum comes to the next interval in LONG seconds."""
    way, _, after, gain = asked_with(0.02, behind)
    assert way[SENDS] == (behind > 0.0)
    if behind:
        assert after[0] < LAST
        lands, goal = 0.2 * SHORT, BEYOND - 0.005 + 0.01
        arrives = offset_of(after, gain) * math.exp(OMEGA * LONG) - (goal - lands)
        assert arrives == pytest.approx(0.03, abs=0.03)


@pytest.mark.parametrize("elapsed", [0.40, 0.44])
@pytest.mark.parametrize("cop", [-0.02, 0.03])
def test_the_cop_of_a_committed_step_brings_the_dcm_there_with_the_offset_that_the_policy_asks_for(
    elapsed, cop
):
    """The step is 1 cm longer than the policy's own, or out of reach of the sole."""
    way, _, _, _ = asked_with(0.1)
    assert way[TAKEN] == 1.0
    remaining, dcm, shorter = 0.47 + CONFIG.touchdown_delay - elapsed, 0.14, 0.15
    obs, asked = np.zeros(36), np.array([shorter, 0.2, 0.47, cop, 0.0, 3.0, -4.0])
    obs[0], obs[1] = elapsed, dcm

    def arrives(p: float) -> float:
        return p + (dcm - p) * math.exp(OMEGA * remaining)

    for longer, reached in ((0.01, True), (0.3, False)):
        moved = asked.copy()
        held = np.array([shorter + longer, 0.3, 0.47, 0.0, 0.0, 0.0, 0.0])
        FOOTHOLDS.hold_step(way, 0.2, obs, held, moved)
        np.testing.assert_array_equal(np.delete(moved, 3), np.delete(asked, 3))
        if reached:
            assert arrives(moved[3]) - held[0] == pytest.approx(arrives(cop) - shorter, abs=1e-12)
        else:
            assert moved[3] == -BIPED_LIMITS.cop_x_max


def test_a_committed_step_that_is_overdue_has_10_ms_left_and_a_clear_floor_leaves_the_cop():
    way, _, _, _ = asked_with(0.1)
    held, obs = np.array([0.15, 0.2, 0.47, 0.0, 0.0, 0.0, 0.0]), np.zeros(36)
    obs[0], obs[1] = 0.5, 0.14
    asked = np.array([0.15, 0.2, 0.51, 0.01, 0.0, 0.0, 0.0])
    moved = asked.copy()
    FOOTHOLDS.hold_step(way, 0.2, obs, held, moved)
    np.testing.assert_allclose(moved, asked, atol=1e-12)
    for clear in (np.zeros(WAY_SIZE), np.r_[way[:TAKEN], -1.0, way[TAKEN + 1 :]]):
        FOOTHOLDS.hold_step(clear, 0.2, obs, held + 0.1, moved)
        np.testing.assert_allclose(moved, asked, atol=1e-12)


def test_how_far_a_robot_is_behind_counts_from_step_to_step_while_an_edge_is_near():
    way = np.zeros(WAY_SIZE)
    FOOTHOLDS.begin_step(EDGE, way, standing())
    assert way[BEHIND] == 0.0
    FOOTHOLDS.begin_step(EDGE, way, standing(time=0.1))  # the same step
    FOOTHOLDS.begin_step(EDGE, way, standing(0.025, 0.5, 1))
    assert way[BEHIND] == pytest.approx(0.2 * 0.5 - 0.02)
    FOOTHOLDS.begin_step(EDGE, way, standing(-0.025, 1.0, 0))
    assert way[BEHIND] == pytest.approx(0.08 + 0.1 + 0.05)
    FOOTHOLDS.begin_step(EDGE, way, standing(1.0, 1.5, 1))  # all is clear
    FOOTHOLDS.begin_step(EDGE, way, standing(0.025, 2.0, 0))
    assert way[BEHIND] == 0.0


@pytest.mark.parametrize("rise", [0.1, -0.1])
def test_known_steps_are_climbed_at_the_commanded_speed(rise):
    """Three steps and three back at 0.25 m/s, begun on either foot."""
    stairs = Stairs(rise, 3, start=0.6, tread=0.35, landing=0.8)
    errors = ModelErrors(terrain=stairs, floor_known=True)
    walk = Scenario("a", (), Command(0.25), errors=errors, duration=(stairs.end + 0.6) / 0.25)
    episodes = BipedEpisodes(2)
    rows = list(
        rollout_batch(episodes, POLICY, [walk, replace(walk, id="b", stance_side="right")], "two-stage")
    )
    assert all(row.recovered for row in rows)
    one, other = episodes.core.com[:, 0]
    assert one == pytest.approx(other, abs=1e-6)  # its mirror image
    assert one == pytest.approx(stairs.end + 0.6, abs=stairs.tread)


@pytest.mark.parametrize("behind", [0.0, -0.3])
def test_a_robot_that_walks_backward_sends_its_dcm_back(behind):
    """Clear are x <= 0.1 m and x >= 0.4 m: seen from 0.412 m, on the grid, to -0.315 and from -0.005 on."""
    way, obs, speed = np.zeros(WAY_SIZE), np.zeros(36), -0.2
    FOOTHOLDS.begin_step(EDGE, way, standing(0.412, speed=speed))
    way[BEHIND], obs[1:3] = behind, (-0.02, 0.05)
    gain = obs[1:3] * math.exp(OMEGA * CONFIG.touchdown_delay)
    step = gain * math.exp(OMEGA * SHORT) - [-0.03, -0.055]
    asked = np.array([*step, SHORT, 0.0, 0.0, 0.0, 0.0])
    FOOTHOLDS.move_step(way, speed, obs, asked)
    assert way[SENDS] == (behind < 0.0)
    if behind:
        arrives = offset_of(asked, gain) * math.exp(OMEGA * LONG) - (-0.325 + 0.005)
        assert arrives == pytest.approx(-0.03, abs=0.03)


def test_the_line_of_the_other_foot_turns_with_the_sole():
    """At 45 degrees a sole and its 5 cm reach 0.25 / sqrt(2) m along x, so the way is clear up to
    0.25 sqrt(2) - 0.25 + 0.2 = 0.3036 m, which is 0.295 on the grid.
    """
    way = np.zeros(WAY_SIZE)
    FOOTHOLDS.begin_step(EDGE, way, Stance(0, 0.0, 0.0, 0.0, math.pi / 4, 0.2, 0.2))
    assert way[7] == 1  # intervals
    assert way[8:10] == pytest.approx([BIPED_LIMITS.length_min, 0.295], abs=1e-9)


def test_the_way_gone_counts_along_a_turned_sole():
    """0.03 x 0.8 + 0.04 x 0.6 = 0.048 m of 0.2 m/s x 0.5 s."""
    way, yaw = np.zeros(WAY_SIZE), math.atan2(0.6, 0.8)
    FOOTHOLDS.begin_step(EDGE, way, Stance(0, 0.0, 0.0, 0.0, yaw, 0.2, 0.2))
    FOOTHOLDS.begin_step(EDGE, way, Stance(1, 0.5, 0.03, 0.04, yaw, 0.2, 0.2))
    assert way[BEHIND] == pytest.approx(0.052)


@pytest.mark.parametrize("speed", [0.2, -0.2])
def test_a_robot_is_no_more_than_40_cm_behind(speed):
    way = np.zeros(WAY_SIZE)
    FOOTHOLDS.begin_step(EDGE, way, standing(speed=speed))
    FOOTHOLDS.begin_step(EDGE, way, standing(time=5.0, leg=1, speed=speed))
    assert way[BEHIND] == pytest.approx(math.copysign(0.4, speed))


@pytest.mark.parametrize(("side", "leg", "rise"), [("left", 0, 0.1), ("right", 1, 0.0)])
def test_the_rise_is_that_under_the_foothold_of_a_turned_sole(biped_core, begin, side, leg, rise):
    """Facing the world's left, 0.4 m to the swing side of a left foot is x = 0.4, over the edge at 0.25."""
    core, errors = biped_core(), ModelErrors(terrain=EDGE.parts[0], floor_known=True)
    plan = begin(core, 0, Scenario("a", stance_side=side, errors=errors))
    core.physics.xmat[0, FOOT_BODY[leg]] = 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0
    core.gait.plan[0, :2], core.gait.elapsed[0] = (0.0, 0.4), core.gait.plan[0, 2]  # committed
    core._on_footholds(plan[None])
    assert core.gait.rise[0] == pytest.approx(rise)


def test_the_gaits_that_are_asked_for_stay_the_callers_own(biped_core, begin):
    core, errors = biped_core(), ModelErrors(terrain=EDGE.parts[0], floor_known=True)
    asked = begin(core, 0, Scenario("a", errors=errors))[None]
    asked[0, 0] = 0.25  # onto the edge
    before = asked.copy()
    moved = core._on_footholds(asked)
    np.testing.assert_array_equal(asked, before)
    assert moved[0, 0] == pytest.approx(LAST, abs=0.011)
