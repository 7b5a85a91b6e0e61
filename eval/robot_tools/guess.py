"""Guesses about a model that nobody has described: its legs, its waist, its other joints, and its soles.

They are to be looked through; one that cannot be right is refused. The joints are those of a skeleton, the
model without shapes as it stands with all joints at 0; a sole is the rectangle under the shapes of a foot's
body, on the plane that the foot would rest on, however it leans there.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import LEG_JOINTS, BodyPlan
from ...envs.robots.model_files import read_model
from ...envs.robots.robot_file import Angles, Sole, make_plan
from ...envs.robots.source_model import (
    BALL,
    COLLISION_GROUPS,
    FREE,
    HINGE,
    KINDS,
    STRAIGHT,
    SourceModel,
    compiled,
    conjugate,
    geom_type,
    paired_shapes,
    product,
    read_source,
)

Chain = tuple[int, ...]


@dataclass(frozen=True)
class Skeleton:
    """A model without shapes, upright with all joints at 0."""

    source: SourceModel
    model: mujoco.MjModel
    data: mujoco.MjData

    @property
    def name(self) -> str:
        """Where the model lies."""
        return self.source.place

    @cached_property
    def root(self) -> int:
        """Body with the free joint."""
        return int(self.model.jnt_bodyid[self.model.jnt_type == FREE][0])

    @cached_property
    def hinges(self) -> list[int]:
        """Numbers of all hinges."""
        return np.flatnonzero(self.model.jnt_type == HINGE).tolist()

    @cached_property
    def moving(self) -> list[int]:
        """Numbers of all joints but the free one."""
        return np.flatnonzero(self.model.jnt_type != FREE).tolist()

    def names(self, joints: Iterable[int]) -> list[str]:
        """Names of joints."""
        return [str(self.model.joint(joint).name) for joint in joints]

    def chain(self, joint: int) -> Chain:
        """Hinges from the root to a joint, itself included."""
        model, found = self.model, []
        dof = int(model.jnt_dofadr[joint])
        while dof >= 0:
            owner = int(model.dof_jntid[dof])
            if model.jnt_type[owner] == HINGE:
                found.append(owner)
            dof = int(model.dof_parentid[dof])
        return tuple(reversed(found))

    def children(self, body: int) -> list[int]:
        """Bodies that hang from a body."""
        return (np.flatnonzero(self.model.body_parentid[1:] == body) + 1).tolist()


def read_skeleton(model: str) -> Skeleton:
    """The skeleton of a model, MJCF or URDF; couplings of joints are left out, and others refused."""
    source = read_source(model)
    source.refuse_couplings([source.name(joint) for joint in source.joints])
    spec = source.rewritten()
    source.stand_up(spec)
    robot = compiled(spec, model)
    data = mujoco.MjData(robot)
    data.qpos[:7] = 0.0, 0.0, 0.0, *STRAIGHT
    mujoco.mj_kinematics(robot, data)
    mujoco.mj_comPos(robot, data)
    return Skeleton(source, robot, data)


BENT = 0.7  # of the knee, half of it at hip and ankle the other way [rad]
ALONG = 1.0 - 1e-6  # least component of an axis along x, y or z that counts as that axis
HEAVY = 0.4  # share of the upper body's mass from which a branch has the trunk
HANGS = 0.5  # least share of a leg's length by which it reaches down
SHIN = 0.25  # share of the legs' height over the ankles up to which no other limb reaches down
LIGHT = 0.015  # share of the robot's mass below which a joint moves too little to be one


def guess_plan(skeleton: Skeleton) -> tuple[BodyPlan, Angles]:
    """Legs, waist and held joints of a robot; and the joints that are fixed, which its model has no more."""
    left, right = find_legs(skeleton)
    waist, trunk = find_waist(skeleton, {*left, *right})
    roles, held, fixed = {*left, *right, *waist}, [], []
    model, masses = skeleton.model, skeleton.model.body_subtreemass
    for joint, name in zip(skeleton.moving, skeleton.names(skeleton.moving), strict=True):
        if joint not in roles:
            kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
            angle = skeleton.source.posture.get(name, 0.0)
            if model.jnt_limited[joint] and kind != BALL:
                angle = min(max(angle, float(model.jnt_range[joint, 0])), float(model.jnt_range[joint, 1]))
            light = masses[model.jnt_bodyid[joint]] < LIGHT * masses[skeleton.root]
            if kind != HINGE and not light:
                raise InvalidValueError(
                    f"joint {name!r} of {skeleton.name!r} is a {KINDS[kind]} that moves "
                    f"{masses[model.jnt_bodyid[joint]]:.3g} kg: control knows hinges alone"
                )
            (fixed if light else held).append((name, round(angle, 6) + 0.0))  # no -0
    plan = make_plan(
        str(model.body(skeleton.root).name),
        str(model.body(trunk).name),
        [skeleton.names(leg) for leg in (left, right)],
        tuple(None if joint is None else str(model.joint(joint).name) for joint in waist),
        _bend(skeleton, left),
        held,
    )
    return plan, tuple(fixed)


def find_legs(skeleton: Skeleton) -> tuple[Chain, Chain]:
    """Hinges of the left and the right leg: the two chains that reach lowest, less what they share."""
    model, anchors = skeleton.model, skeleton.data.xanchor
    ends = [joint for joint in skeleton.hinges if model.jnt_dofadr[joint] not in model.dof_parentid]
    chains = [skeleton.chain(joint) for joint in sorted(ends, key=lambda joint: anchors[joint, 2])[:2]]
    if len(chains) == 2:
        shared = {*chains[0]} & {*chains[1]}
        chains = [tuple(joint for joint in chain if joint not in shared) for chain in chains]
    sizes = [len(chain) for chain in chains]
    if sizes != [LEG_JOINTS] * 2:
        raise InvalidValueError(
            f"two legs of {LEG_JOINTS} joints each are needed; the lowest chains of {skeleton.name!r} have "
            f"{[skeleton.names(chain) for chain in chains]}"
        )
    _refuse_other_legs(skeleton, ends, chains)
    chains.sort(key=lambda chain: -anchors[chain[-1], 1])
    if not anchors[chains[0][-1], 1] > 0.0 > anchors[chains[1][-1], 1]:
        raise InvalidValueError(
            f"the legs of {skeleton.name!r} must lie left (y > 0) and right of its middle"
        )
    return chains[0], chains[1]


def _refuse_other_legs(skeleton: Skeleton, ends: list[int], legs: list[Chain]) -> None:
    """Raise InvalidValueError where legs do not hang down, or another limb reaches as low as they do."""
    heights = skeleton.data.xanchor[:, 2]
    hip, ankle = (max(heights[leg[place]] for leg in legs) for place in (0, -1))
    length = max(
        sum(np.linalg.norm(np.diff(skeleton.data.xanchor[list(leg)], axis=0), axis=1)) for leg in legs
    )
    if hip - ankle < HANGS * length:
        raise InvalidValueError(
            f"the lowest chains of {skeleton.name!r}, {[skeleton.names(leg) for leg in legs]}, are no legs: "
            f"with all joints at 0 they reach down {max(hip - ankle, 0.0):.2f} of their {length:.2f} m"
        )
    others = [joint for joint in ends if not any(joint in leg for leg in legs)]
    if low := [joint for joint in others if heights[joint] < ankle + SHIN * (hip - ankle)]:
        raise InvalidValueError(
            f"{skeleton.name!r} is no biped: beside its legs {skeleton.names(low)} reach as low as its ankles"
        )


def find_waist(skeleton: Skeleton, legs: set[int]) -> tuple[tuple[int | None, int | None], int]:
    """Pitch and roll of the waist, None for what is missing, and the trunk's body.

    The trunk is where the upper body branches: from the pelvis up, as long as one branch has a good part of
    its mass.
    """
    model, body = skeleton.model, skeleton.root
    below = {int(model.jnt_bodyid[joint]) for joint in legs}
    upper = float(model.body_subtreemass[body]) - sum(
        float(model.body_subtreemass[part]) for part in below if int(model.body_parentid[part]) not in below
    )
    passed: list[int] = []
    while True:
        branches = [part for part in skeleton.children(body) if not _bears(skeleton, part, below)]
        heaviest = max(branches, key=lambda part: model.body_subtreemass[part], default=None)
        if heaviest is None or model.body_subtreemass[heaviest] < HEAVY * upper:
            break
        body = heaviest
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        passed += range(first, first + count)
    axes = skeleton.data.xaxis
    pitch, roll = (next((joint for joint in passed if axes[joint, axis] > ALONG), None) for axis in (1, 0))
    return (pitch, roll), body


def _bears(skeleton: Skeleton, body: int, parts: set[int]) -> bool:
    """Whether any of some bodies hangs from a body, or is it."""
    for part in parts:
        while part > body:  # a parent has the smaller number
            part = int(skeleton.model.body_parentid[part])
        if part == body:
            return True
    return False


def _bend(skeleton: Skeleton, leg: Chain) -> tuple[float, ...]:
    """Angles of a leg with a bent knee, hip and ankle half as much the other way."""
    model, axes, knee = skeleton.model, skeleton.data.xaxis, leg[3]
    low, high = model.jnt_range[knee] if model.jnt_limited[knee] else (0.0, 0.0)
    ahead = float(np.sign(axes[knee, 1])) or 1.0  # so that the knee goes forward
    bent = BENT * (float(np.sign(high + low)) or ahead)
    angles = np.zeros(LEG_JOINTS)
    angles[3] = bent
    for part in (leg[:3], leg[4:]):
        pitch = max(part, key=lambda joint: abs(axes[joint] @ axes[knee]))
        angles[leg.index(pitch)] = -0.5 * bent * np.sign(axes[pitch] @ axes[knee])
    return tuple((angles + 0.0).tolist())  # no -0


LOW = 0.012  # points up to this high over the lowest one belong to the sole [m]
LEVEL = 1e-6  # a foot that leans by less has its sole's axes [rad]
FLAT = 1e-3  # over the lowest point a face is taken for level up to this high [m]
UPWARD = 0.5  # least upward part of the normal of a sole, all joints at 0
NARROW, WIDE = 0.02, 0.8  # least and largest size of a sole over the height of the pelvis above it
ALIKE = 0.1  # largest difference of both soles' sizes and heights, as a share
SLANTING = 0.9  # area of a turned rectangle over that of the one straight ahead, from which it is the sole
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
RIM = 24  # points of a disc that stand for it
Array = NDArray[np.float64]
UP, FORWARD, CORNER = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.zeros((3, 3))


class Parts(NamedTuple):
    """Ellipsoids, balls, discs and corners whose hull the shapes of a foot are, n in world axes [m]."""

    centres: Array  # (n, 3)
    halves: Array  # (n, 3, 3) symmetric, M: the part is M b about its centre, |b| <= 1; 0 of a corner
    axes: Array  # (n, 3) normal of a disc; 0 of another part
    outline: Array  # (n,) share of its reach that belongs to the sole: none of a part that is a whole shape
    ways: Array  # (n, 3) to the other end of a capsule; 0 of another part

    def reach(self, direction: Array) -> Array:
        """How far each part goes beyond its centre (n,) [m]: |M u|."""
        return np.linalg.norm(self.halves @ direction, axis=1)

    def touching(self, normal: Array) -> Array:
        """Lowest point of each part along a normal, (n, 3) [m]: M M u / |M u| below its centre."""
        reach = self.reach(normal)
        below = np.einsum("nij,nj->ni", self.halves, self.halves @ normal)
        return self.centres - below / np.where(reach > 0.0, reach, 1.0)[:, None]

    def resting(self, normal: Array) -> "Parts":
        """Parts on the plane that touches them from below; without an outline only the points that touch.

        A capsule has none where it stands on one end.
        """
        heights = self.heights(normal)
        low = heights.min() + LOW
        outline = self.outline * (heights + self.ways @ normal < low)
        centres = np.where(outline[:, None] > 0.0, self.centres, self.touching(normal))
        return Parts(*(part[heights < low] for part in self._replace(centres=centres, outline=outline)))

    def heights(self, normal: Array) -> Array:
        """Lowest point of each part along a normal (n,) [m]."""
        return self.centres @ normal - self.reach(normal)

    def extent(self, direction: Array) -> tuple[float, float]:
        """Least and largest coordinate of the outline [m]."""
        middle, more = self.centres @ direction, self.reach(direction) * self.outline
        return float((middle - more).min()), float((middle + more).max())

    def points(self, normal: Array) -> Array:
        """What a plane with this normal can touch from below, (m, 3) [m]: rims of discs that face it."""
        faces = np.abs(self.axes @ normal) > UPWARD
        found, angles = [self.touching(normal)[~faces]], np.linspace(0.0, 2.0 * np.pi, RIM, endpoint=False)
        for centre, halves, axis in zip(
            self.centres[faces], self.halves[faces], self.axes[faces], strict=True
        ):
            across = np.linalg.svd(axis[None])[2][1:]
            found.append(centre + np.column_stack([np.cos(angles), np.sin(angles)]) @ across @ halves)
        return np.concatenate(found)


def guess_soles(place: str, joints: tuple[str, str]) -> tuple[Sole, Sole]:
    """Soles of the bodies that two joints move.

    Raises:
        InvalidValueError: shapes that no sole can be under.
    """
    paired = paired_shapes(read_model(place))
    source = read_source(place, feet=joints)
    model, root = source.model, source.root
    data = mujoco.MjData(model)
    model.body_pos[root], model.body_quat[root] = 0.0, source.upright  # where it is fixed
    data.qpos[:] = 0.0
    for joint in range(model.njnt):
        if model.jnt_type[joint] in (FREE.value, BALL.value):
            first = int(model.jnt_qposadr[joint]) + 3 * (model.jnt_type[joint] == FREE.value)
            own = source.upright if model.jnt_bodyid[joint] == root else STRAIGHT
            data.qpos[first : first + 4] = own
    mujoco.mj_kinematics(model, data)
    feet = [int(model.jnt_bodyid[model.joint(name).id]) for name in joints]
    ankles = [data.xanchor[model.joint(name).id] for name in joints]
    left, right = (_sole(model, data, foot, paired) for foot in feet)
    names = [str(model.body(foot).name) for foot in feet]
    places = [data.xpos[foot] + data.xmat[foot].reshape(3, 3) @ sole.centre
              for foot, sole in zip(feet, (left, right), strict=True)]  # fmt: skip
    _check_soles(str(model.body(root).name), names, (left, right), np.array(places), np.array(ankles))
    return left, right


def _check_soles(root: str, names: list[str], soles: tuple[Sole, Sole], places: Array, ankles: Array) -> None:
    """Raise InvalidValueError where two guesses, their places and ankles (2, 3) [m], cannot be soles."""
    for name, sole, place, ankle in zip(names, soles, places, ankles, strict=True):
        least, most, size = NARROW * -place[2], WIDE * -place[2], " x ".join(f"{one:g}" for one in sole.size)
        if not (place[2] < 0.0 and place[2] < ankle[2]):
            raise InvalidValueError(
                f"the shapes of foot {name!r} are not below its ankle and {root!r}, the robot's root, which "
                "must be its pelvis"
            )
        if not all(least <= one <= most for one in sole.size):
            raise InvalidValueError(
                f"the shapes of foot {name!r} would make a sole of {size} m; it must be {least:.2g} to "
                f"{most:.2g} m long and wide: a point or an edge is none"
            )
    (left, right), apart = soles, abs(places[0, 1] - places[1, 1])
    sizes = " and ".join(" x ".join(f"{one:g}" for one in sole.size) for sole in soles)
    if any(abs(a - b) > ALIKE * max(a, b) for a, b in zip(left.size, right.size, strict=True)):
        raise InvalidValueError(f"the shapes of feet {names} would make unlike soles, of {sizes} m")
    if abs(places[0, 2] - places[1, 2]) > ALIKE * -places[:, 2].min():
        raise InvalidValueError(
            f"the shapes of feet {names} would make soles at unlike heights, {-places[0, 2]:.3g} and "
            f"{-places[1, 2]:.3g} m below the pelvis"
        )
    if apart < 0.5 * (left.size[1] + right.size[1]):
        raise InvalidValueError(
            f"the shapes of feet {names} would make soles of {sizes} m that overlap, only {apart:.3g} m apart"
        )


def _sole(model: mujoco.MjModel, data: mujoco.MjData, foot: int, paired: set[str]) -> Sole:
    """The sole of a foot's body."""
    name, shapes = str(model.body(foot).name), _shapes(model, foot, paired)
    if not shapes:
        raise InvalidValueError(f"foot {name!r} has no shapes to take its sole from")
    parts = Parts(*map(np.concatenate, zip(*(_parts(model, data, geom) for geom in shapes), strict=True)))
    normal = sole_normal(parts)
    if normal[2] < UPWARD:
        raise InvalidValueError(
            f"the shapes of foot {name!r} would make a sole that leans by {np.arccos(normal[2]):.2g} rad, "
            f"all joints at 0; it must lean by less than {np.arccos(UPWARD):.2g}"
        )
    low, height = parts.resting(normal), parts.heights(normal).min()
    x, y = sole_axes(low, normal)
    (back, front), (right, left) = low.extent(x), low.extent(y)
    centre = 0.5 * (back + front) * x + 0.5 * (right + left) * y + height * normal
    own, axes = np.empty(4), np.column_stack([x, y, normal])
    mujoco.mju_mat2Quat(own, axes.ravel())
    turn = product(conjugate(data.xquat[foot]), own if (axes != np.eye(3)).any() else np.array(STRAIGHT))
    inside = data.xmat[foot].reshape(3, 3).T @ (centre - data.xpos[foot])
    turn = np.array(STRAIGHT) if np.linalg.norm(turn[1:]) < LEVEL else np.round(turn, 12)
    size = np.round([front - back, left - right], 4)
    centre, turn = np.round(inside, 6) + 0.0, turn + 0.0  # no -0
    return Sole(tuple(centre.tolist()), tuple(size.tolist()), tuple(turn.tolist()))


def sole_normal(parts: Parts) -> Array:
    """Upward normal of the plane that a foot rests on: of the face of its hull under its middle, (3,).

    A face that is level up to FLAT is level. Shapes that touch along a line alone rest on it.
    """
    normal = UP
    for _ in range(ROUNDS):
        points, before = parts.points(normal), normal
        normal = _face_below(points)
        if normal is UP or np.abs(normal - before).max() < SAME:
            break
    return normal


ROUNDS, SAME = 20, 1e-12  # of the search for the plane under balls of several sizes


def _face_below(points: Array) -> Array:
    """Upward normal of the lowest face of a hull under the middle of its points, (3,)."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))[:2]
    try:
        planes = ConvexHull(np.concatenate([points, points + UP])).equations
    except QhullError:
        along = np.linalg.svd(points - points.mean(axis=0))[2][0]
        across = UP - (UP @ along) * along
        return UP if abs(along[2]) < LEVEL or abs(along[2]) > UPWARD else across / np.linalg.norm(across)
    below = planes[planes[:, 2] < -LEVEL]
    under = -(below[:, :2] @ middle + below[:, 3]) / below[:, 2]
    face = int(under.argmax())
    return UP if under[face] - points[:, 2].min() < FLAT else -below[face, :3]


def sole_axes(parts: Parts, normal: Array) -> tuple[Array, Array]:
    """Axes of a sole's rectangle: straight ahead, or along an edge where that one is much smaller.

    An edge is one of the hull of the parts' centres, or the line on which these lie.
    """
    if normal is UP:
        straight = FORWARD
    else:
        straight = FORWARD - (FORWARD @ normal) * normal
        straight /= np.linalg.norm(straight)

    def beside(x: Array) -> Array:
        return np.cross(normal, x).astype(np.float64)

    def area(x: Array) -> float:
        return float(np.prod([np.diff(parts.extent(u)) for u in (x, beside(x))]))

    aside = beside(straight)

    flat = np.column_stack([parts.centres @ straight, parts.centres @ aside])
    try:
        corners = flat[ConvexHull(flat).vertices]
    except (QhullError, ValueError):
        end = flat[np.linalg.norm(flat - flat[0], axis=1).argmax()]
        corners = np.array([end, flat[np.linalg.norm(flat - end, axis=1).argmax()]])
    edges = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    angles = (angles + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi  # of the side next to straight ahead
    turned = [np.cos(angle) * straight + np.sin(angle) * aside for angle in angles]
    best = min(turned, key=area)
    if area(best) < SLANTING * area(straight):
        return best, beside(best)
    return straight, aside


def _shapes(model: mujoco.MjModel, foot: int, paired: set[str]) -> list[int]:
    """Shapes of a foot: those that are for collisions where there are any, with what is fixed to the foot."""
    fixed = model.body_weldid == model.body_weldid[foot]
    found = np.flatnonzero(fixed[model.geom_bodyid]).tolist()
    bits = model.geom_contype | model.geom_conaffinity
    touches = [geom for geom in found if bits[geom] or model.geom(geom).name in paired]
    solid = touches or [geom for geom in found if model.geom_group[geom] in COLLISION_GROUPS]
    return solid or found


def _parts(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Parts:
    """Parts of a shape."""
    kind, size = geom_type(model, geom), model.geom_size[geom]
    place, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    ends = place + np.array([[-1.0], [1.0]]) * size[1] * axes[:, 2]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _alike(ends, size[0] * np.eye(3), 1.0)._replace(ways=ends[::-1] - ends)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        disc = size[0] * (np.eye(3) - np.outer(axes[:, 2], axes[:, 2]))
        return _alike(ends, disc, 1.0)._replace(axes=np.tile(axes[:, 2], (2, 1)))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _alike(place[None], size[0] * np.eye(3))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return _alike(place[None], axes @ np.diag(size) @ axes.T)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _alike(place + (CORNERS * size) @ axes.T)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return _alike(place + model.mesh_vert[first : first + count] @ axes.T)
    name, shape = str(model.body(model.geom_bodyid[geom]).name), kind.name.removeprefix("mjGEOM_").lower()
    raise InvalidValueError(f"foot {name!r} has a shape that no sole is guessed from, a {shape}")


def _alike(centres: Array, halves: Array = CORNER, outline: float = 0.0) -> Parts:
    """Parts of one form."""
    n = len(centres)
    return Parts(centres, np.tile(halves, (n, 1, 1)), np.zeros((n, 3)), np.full(n, outline), np.zeros((n, 3)))
