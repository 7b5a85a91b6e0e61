"""Which joints of a skeleton are legs, waist and the rest: a guess to be looked through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model.body_plan import LEG_JOINTS, BodyPlan
from ...envs.biped.robots.adapted.robot_file import Angles, make_plan
from .skeleton import Chain, Skeleton

BENT = 0.7  # of the knee, half of it at hip and ankle the other way [rad]
ALONG = 1.0 - 1e-6  # least component of an axis along x, y or z that counts as that axis
HEAVY = 0.4  # share of the upper body's mass from which a branch has the trunk
LIGHT = 0.015  # share of the robot's mass below which a joint moves too little to be one


@dataclass(frozen=True)
class Guess:
    """The plan, and the joints that are none here."""

    plan: BodyPlan
    fixed: Angles


def guess_plan(skeleton: Skeleton) -> Guess:
    """Legs, waist, held and fixed joints of a robot.

    Raises:
        InvalidValueError: no two legs of six joints each were found.
    """
    left, right = find_legs(skeleton)
    waist, trunk = find_waist(skeleton, {*left, *right})
    roles = {*left, *right, *(joint for joint in waist if joint is not None)}
    held, fixed = [], []
    total = float(skeleton.model.body_subtreemass[skeleton.root])
    for joint in skeleton.hinges:
        if joint not in roles:
            few = fixed if skeleton.moved_mass(joint) < LIGHT * total else held
            few.append((skeleton.joint_name(joint), _kept_angle(skeleton, joint)))
    plan = make_plan(
        skeleton.body_name(skeleton.root),
        skeleton.body_name(trunk),
        [[skeleton.joint_name(joint) for joint in leg] for leg in (left, right)],
        tuple(None if joint is None else skeleton.joint_name(joint) for joint in waist),
        _bend(skeleton, left),
        held,
    )
    return Guess(plan, tuple(fixed))


def find_legs(skeleton: Skeleton) -> tuple[Chain, Chain]:
    """Hinges of the left and the right leg: the two chains that reach lowest, less what they share.

    Raises:
        InvalidValueError: they have not six joints each, or do not lie left and right.
    """
    depth = {joint: skeleton.data.xanchor[joint, 2] for joint in skeleton.hinges}
    ends = [joint for joint in skeleton.hinges if not _goes_on(skeleton, joint)]
    lowest = sorted(ends, key=lambda joint: depth[joint])[:2]
    chains = [skeleton.chain(joint) for joint in lowest]
    if len(chains) == 2:
        shared = {*chains[0]} & {*chains[1]}
        chains = [tuple(joint for joint in chain if joint not in shared) for chain in chains]
    sizes = [len(chain) for chain in chains]
    if sizes != [LEG_JOINTS] * 2:
        names = [[skeleton.joint_name(joint) for joint in chain] for chain in chains]
        raise InvalidValueError(
            f"two legs of {LEG_JOINTS} joints each are needed; the lowest chains of {skeleton.name!r} have "
            f"{names}"
        )
    chains.sort(key=lambda chain: -skeleton.data.xanchor[chain[-1], 1])
    if not skeleton.data.xanchor[chains[0][-1], 1] > 0.0 > skeleton.data.xanchor[chains[1][-1], 1]:
        raise InvalidValueError(
            f"the legs of {skeleton.name!r} must lie left (y > 0) and right of its middle"
        )
    return chains[0], chains[1]


def _goes_on(skeleton: Skeleton, joint: int) -> bool:
    """Whether another hinge hangs from a joint."""
    dof = int(skeleton.model.jnt_dofadr[joint])
    return bool((skeleton.model.dof_parentid == dof).any())


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
    pitch, roll = (_along(skeleton, passed, axis) for axis in (1, 0))
    return (pitch, roll), body


def _bears(skeleton: Skeleton, body: int, parts: set[int]) -> bool:
    """Whether any of some bodies hangs from a body, or is it."""
    return body in parts or any(_bears(skeleton, part, parts) for part in skeleton.children(body))


def _along(skeleton: Skeleton, joints: list[int], axis: int) -> int | None:
    """The first joint about an axis of the world, in its positive sense."""
    return next((joint for joint in joints if skeleton.axis(joint)[axis] > ALONG), None)


def _bend(skeleton: Skeleton, leg: Chain) -> tuple[float, ...]:
    """Angles of a leg with a bent knee, hip and ankle half as much the other way."""
    model, knee = skeleton.model, leg[3]
    low, high = model.jnt_range[knee] if model.jnt_limited[knee] else (0.0, 1.0)
    bent = BENT if high + low >= 0.0 else -BENT
    angles = np.zeros(LEG_JOINTS)
    angles[3] = bent
    for part in (leg[:3], leg[4:]):
        pitch = max(part, key=lambda joint: abs(skeleton.axis(joint) @ skeleton.axis(knee)))
        angles[leg.index(pitch)] = -0.5 * bent * np.sign(skeleton.axis(pitch) @ skeleton.axis(knee))
    return tuple(angles.tolist())


def _kept_angle(skeleton: Skeleton, joint: int) -> float:
    """That of the model's first keyframe, or 0, within the joint's range."""
    angle = skeleton.posture.get(skeleton.joint_name(joint), 0.0)
    if skeleton.model.jnt_limited[joint]:
        low, high = skeleton.model.jnt_range[joint]
        angle = min(max(angle, float(low)), float(high))
    return round(angle, 6)
