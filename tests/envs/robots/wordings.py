"""One biped as MJCF, said plainly or in words for the same that a generator draws."""

import numpy as np

AXIS = {"yaw": (0.0, 0.0, 1.0), "roll": (1.0, 0.0, 0.0), "pitch": (0.0, 1.0, 0.0), "knee": (0.0, 1.0, 0.0)}
# place in the parent [m], mass [kg], joints, range [rad], torque [N m]
PARTS = {
    "thigh": ((0.0, 0.0, -0.06), 5.0, ("hip_yaw", "hip_roll", "hip_pitch"), 1.5, 150.0),
    "shank": ((0.0, 0.0, -0.35), 3.0, ("knee",), 2.2, 200.0),
    "foot": ((0.0, 0.0, -0.35), 1.0, ("ankle_pitch", "ankle_roll"), 0.8, 90.0),
}
LEGS = [[f"{side}_{joint}" for part in PARTS.values() for joint in part[2]] for side in ("left", "right")]
SIDES = {"left": 1.0, "right": -1.0}
SOLE = '<geom type="box" size=".1 .05 .01" pos=".03 0 -.05"/>'
TILT = (0.0, 0.6, 0.8)  # axis of frames


def numbers(values):
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def quat_of(axis, angle):
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.asarray(axis, float))])


def times(a, b):
    w, v, x, u = a[0], a[1:], b[0], b[1:]
    return np.array([w * x - v @ u, *(w * u + x * v + np.cross(v, u))])


def matrix(q):
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


class Wording:
    """How the biped is said; without a seed plainly, with quaternions and diagonal inertias alone."""

    def __init__(self, seed=None, sole=SOLE, extra=""):
        self.rng = None if seed is None else np.random.default_rng(seed)
        self.sole, self.extra = sole, extra
        self.degrees, self.fixed = self.pick(False, True), self.pick(False, True)

    def pick(self, *choices):
        return choices[0] if self.rng is None else choices[self.rng.integers(len(choices))]

    def angle(self, value):
        return numbers(np.degrees(value) if self.degrees else value)

    def attitude(self, quat):
        """An orientation in one of the six ways of MJCF."""
        turn, kind = matrix(quat), self.pick("quat", "scaled", "axisangle", "euler", "xyaxes", "zaxis")
        if kind == "scaled":
            return f'quat="{numbers(-2.5 * quat)}"'
        if kind == "axisangle":
            angle = 2.0 * np.arccos(np.clip(quat[0], -1.0, 1.0))
            axis = quat[1:] if np.linalg.norm(quat[1:]) > 1e-9 else np.array([0.0, 0.0, 1.0])
            return f'axisangle="{numbers(3.0 * axis)} {self.angle(angle)}"'
        if kind == "xyaxes":
            return f'xyaxes="{numbers(2.0 * turn[:, 0])} {numbers(turn[:, 1] + 0.5 * turn[:, 0])}"'
        if kind == "zaxis" and abs(quat[3]) < 1e-12:  # the shortest turn from z
            return f'zaxis="{numbers(4.0 * turn[:, 2])}"'
        if kind == "euler":  # Rx Ry Rz: about axes that turn, x first, or about axes that stay, z first
            y = np.arcsin(np.clip(turn[0, 2], -1.0, 1.0))
            x, z = np.arctan2(-turn[1, 2], turn[2, 2]), np.arctan2(-turn[0, 1], turn[0, 0])
            order = (z, y, x) if self.fixed else (x, y, z)
            return f'euler="{" ".join(map(self.angle, order))}"'
        return f'quat="{numbers(quat)}"'

    def inertia(self, mass, diagonal, place):
        """An inertial, diagonal in its own axes or as a full matrix in those of the body."""
        turn = quat_of((0.6, 0.8, 0.0), 0.4)
        said = f'<inertial mass="{mass}" pos="{numbers(place)}"'
        if self.pick("diagonal", "full") == "diagonal":
            return f'{said} diaginertia="{numbers(diagonal)}" {self.attitude(turn)}/>'
        full = matrix(turn) @ np.diag(diagonal) @ matrix(turn).T
        return f'{said} fullinertia="{numbers(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>'

    def joint(self, name, bound, torque, ref):
        """A hinge, its numbers its own or those of a default class."""
        low, high = (-0.05, bound) if name.endswith("knee") else (-bound, bound)
        axis = numbers(np.array(AXIS[name.rpartition("_")[2]]) * self.pick(1.0, 2.0))
        limited = self.pick("", ' limited="true"')
        own = self.pick('armature=".02" damping="3"', 'class="joints"', 'class="joints" stiffness="9"')
        return (
            f'<joint name="{name}" axis="{axis}" range="{self.angle(low)} {self.angle(high)}" {own}{limited} '
            f'ref="{self.angle(ref)}" actuatorfrcrange="-{torque} {torque}"/>'
        )

    def body(self, name, place, part, inner):
        """A body, placed by itself or by one or two frames, described with its joint at a reference."""
        _, mass, joints, bound, torque = PARTS[part]
        side, quat, place = name.partition("_")[0], np.array([1.0, 0.0, 0.0, 0.0]), np.array(place, float)
        ref = self.pick(0.0, 0.3) if len(joints) == 1 else 0.0
        quat = times(quat, quat_of(AXIS[joints[0].rpartition("_")[2]], ref))
        hinges = "".join(self.joint(f"{side}_{joint}", bound, torque, ref) for joint in joints)
        inertial = self.inertia(mass, np.array([0.03, 0.025, 0.01]) * mass / 5.0, (0.01, 0.0, -0.1))
        content, how = inertial + hinges + inner, self.pick("body", "frame", "frames")
        if how == "body":
            return f'<body name="{name}" pos="{numbers(place)}" {self.attitude(quat)}>{content}</body>'
        inside = times(quat_of(TILT, -0.7), quat)
        inner = f'<body name="{name}" {self.attitude(inside)}>{content}</body>'
        if how == "frame":
            return f'<frame pos="{numbers(place)}" {self.attitude(quat_of(TILT, 0.7))}>{inner}</frame>'
        half, step = quat_of(TILT, 0.35), np.array([0.1, -0.2, 0.3])
        back = numbers(matrix(half).T @ -step)
        return (
            f'<frame pos="{numbers(place + step)}" {self.attitude(half)}>'
            f'<frame pos="{back}" {self.attitude(half)}>{inner}</frame></frame>'
        )

    def leg(self, side):
        inner = self.sole
        for part, (place, *_) in reversed(PARTS.items()):
            aside = 0.09 * SIDES[side] if part == "thigh" else 0.0
            inner = self.body(f"{side}_{part}", np.array(place) + [0.0, aside, 0.0], part, inner)
        return inner

    def text(self, root="<freejoint/>", defaults="", scene="", after=""):
        """The model.

        Args:
            root: joints of the pelvis.
            defaults: of the main default class.
            scene: beside the robot in the world.
            after: what follows the world.
        """
        trunk = (
            '<body name="trunk" pos="0 0 .1"><inertial mass="20" pos="0 0 .2" diaginertia=".8 .7 .3"/>'
            f'<geom type="capsule" fromto="0 0 .1 0 0 .4" size=".1"/>{self.extra}</body>'
        )
        pelvis = '<inertial mass="8" pos="0 0 0" diaginertia=".08 .07 .06"/>'
        unit, order = "degree" if self.degrees else "radian", "ZYX" if self.fixed else "xyz"
        return (
            f'<mujoco model="worded"><compiler angle="{unit}" eulerseq="{order}"/><default>{defaults}'
            '<default class="joints"><joint armature=".02" damping="3"/></default></default>'
            f'<worldbody>{scene}<body name="pelvis" pos="0 0 .86">{pelvis}{root}{trunk}'
            f"{self.leg('left')}{self.leg('right')}</body></worldbody>{after}</mujoco>"
        )
