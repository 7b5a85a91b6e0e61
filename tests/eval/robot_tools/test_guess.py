"""What is guessed of a model: the biped's own plan, and that of the robots that come with the package."""

from importlib.util import find_spec

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.robots.adapt import FOLDER
from push_recovery.envs.robots.biped import PLAN, spec
from push_recovery.envs.robots.model_files import PACKAGES
from push_recovery.envs.robots.robot_file import read_robot_file
from push_recovery.envs.robots.variants import ARM, NO_WAIST, arms_over_a_waist_of_three
from push_recovery.eval.robot_tools.guess import guess_plan, guess_soles, read_skeleton

ANKLES = "left_ankle_roll", "right_ankle_roll"
NEEDS = pytest.mark.skipif(
    any(find_spec(name) is None for name in PACKAGES), reason="needs pip install 'push-recovery[robots]'"
)


@pytest.fixture
def written(tmp_path):
    def write(model):
        path = tmp_path / "model.xml"
        path.write_text(model.to_xml(), encoding="utf-8")
        return str(path)

    return write


def test_the_bipeds_plan_is_found(written):
    plan, fixed = guess_plan(read_skeleton(written(spec())))
    assert (plan.pelvis, plan.trunk) == (PLAN.pelvis, PLAN.trunk)
    assert (plan.legs, plan.waist) == (PLAN.legs, PLAN.waist)
    assert np.sign(plan.bend).tolist() == [0.0, 0.0, -1.0, 1.0, -1.0, 0.0]
    assert plan.held == fixed == ()


def test_arms_and_a_yaw_are_held_and_what_is_light_is_fixed(written):
    model = arms_over_a_waist_of_three()
    hand = model.body("left_forearm").add_body(name="hand", pos=[0.0, 0.0, -0.1])
    hand.ipos = [0.0, 0.0, -0.05]
    hand.mass, hand.inertia, hand.explicitinertial = 0.1, [1e-4, 1e-4, 1e-4], True
    hand.add_joint(name="wrist", type=mujoco.mjtJoint.mjJNT_HINGE, range=[0.3, 1.0], limited=True)
    plan, fixed = guess_plan(read_skeleton(written(model)))
    arms = {f"{side}_{name}" for side in ("left", "right") for name in ARM}
    assert {name for name, _ in plan.held} == arms | {"waist_yaw"}
    assert plan.waist == ("waist_pitch", "waist_roll")
    assert [name for name, _ in fixed] == ["wrist"]
    low, _ = read_skeleton(written(model)).model.joint("wrist").range
    assert fixed[0][1] == pytest.approx(low, abs=1e-6)  # 0 is out of its range


def test_a_robot_without_a_waist_has_none(written):
    assert guess_plan(read_skeleton(written(NO_WAIST.spec())))[0].waist == (None, None)


def test_a_model_without_two_legs_is_refused(written):
    model = spec()
    model.delete(model.actuator("left_ankle_roll"))
    model.delete(model.joint("left_ankle_roll"))
    with pytest.raises(InvalidValueError, match=r"^two legs of 6 joints each are needed"):
        guess_plan(read_skeleton(written(model)))
    empty = mujoco.MjSpec()
    with pytest.raises(InvalidValueError, match=r"^there is no robot in the model"):
        read_skeleton(written(empty))


def test_a_box_is_the_sole_wherever_its_body_points(written):
    left, right = guess_soles(written(spec()), ANKLES)
    assert left == right
    np.testing.assert_allclose(left.centre, (0.0, 0.0, -0.06), atol=1e-6)
    assert left.size == (0.2, 0.1)
    assert left.turn == (1.0, 0.0, 0.0, 0.0)


def with_feet(*shapes):
    """The biped with other shapes under both feet."""
    model = spec()
    for side in ("left", "right"):
        foot = model.body(f"{side}_foot")
        for pair in [pair for pair in model.pairs if f"{side}_foot" in (pair.geomname1, pair.geomname2)]:
            model.delete(pair)
        for geom in list(foot.geoms):
            model.delete(geom)
        for shape in shapes:
            foot.add_geom(**shape)
    return model


SPHERES = [
    {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [0.005, 0, 0], "pos": [x, y, -0.04]}
    for x in (-0.06, 0.12) for y in (-0.03, 0.03)
]  # fmt: skip
CYLINDER = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [0.05, 0.02, 0], "pos": [0.01, 0.0, -0.04]}
QUARTER = (0.5**0.5, 0.0, 0.5**0.5, 0.0)  # turn about y, from standing to lying along x
CAPSULE = {
    "type": mujoco.mjtGeom.mjGEOM_CAPSULE, "size": [0.02, 0.08, 0], "pos": [0.02, 0.0, -0.04],
    "quat": QUARTER,
}  # fmt: skip


@pytest.mark.parametrize(
    ("shapes", "size", "centre"),
    [
        (SPHERES, (0.18, 0.06), (0.03, 0.0, -0.045)),  # their lowest points are its corners
        ([CYLINDER], (0.1, 0.1), (0.01, 0.0, -0.06)),  # standing: as wide as it is long
        ([CAPSULE], (0.2, 0.04), (0.02, 0.0, -0.06)),  # lying: its caps make it longer by the radius each
    ],
    ids=("spheres", "cylinder", "capsule"),
)
def test_a_sole_is_the_rectangle_under_the_shapes_of_a_foot(written, shapes, size, centre):
    sole, _ = guess_soles(written(with_feet(*shapes)), ANKLES)
    assert sole.size == pytest.approx(size)
    np.testing.assert_allclose(sole.centre, centre, atol=1e-6)


@NEEDS
@pytest.mark.parametrize("name", ["g1", "t1"])
def test_the_guess_of_a_robot_of_the_package_is_its_file(name):
    wanted = read_robot_file(FOLDER.joinpath(f"{name}.json"))
    plan, _ = guess_plan(read_skeleton(wanted.model))
    assert (plan.pelvis, plan.trunk) == (wanted.plan.pelvis, wanted.plan.trunk)
    assert (plan.legs, plan.waist) == (wanted.plan.legs, wanted.plan.waist)
    soles = guess_soles(wanted.model, (wanted.plan.legs[0][-1], wanted.plan.legs[1][-1]))
    for found, sole in zip(soles, wanted.soles, strict=True):
        np.testing.assert_allclose(found.size, sole.size, atol=1e-3)
        np.testing.assert_allclose(found.centre, sole.centre, atol=1e-3)
