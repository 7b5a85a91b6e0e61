"""Small steps in the floor: where the tiles are, that soles stand on them, that nobody is told."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.robots.biped import PLAN, biped, biped_model
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.noise import uniform
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.scenario.terrain import DEPTH, TILE
from push_recovery.envs.scenario.terrain import TILES_PER_FOOT as AROUND

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
