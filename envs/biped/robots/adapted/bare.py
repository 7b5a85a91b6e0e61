"""A model without its shapes: meshes are for the eye, and the physics needs none of them."""

from __future__ import annotations

from collections.abc import Collection
from itertools import chain

import mujoco

from .....controllers.errors import InvalidValueError

SHAPES = 1e-12  # least mass of a body that counts [kg]
VISUAL_GROUP = 1  # of the shapes that are drawn
COLLISION_GROUPS = (3, 4, 5)  # of the shapes that models draw on demand only


def drop_shapes(spec: mujoco.MjSpec, keep_visual: bool = False, fixed: Collection[str] = ()) -> None:
    """Take all shapes out of a model, or leave those that are for the eye and let nothing touch them.

    Masses and inertias stay; where the model takes them from its shapes they are written down before. What
    couples the `fixed` joints to each other goes with them.

    Raises:
        InvalidValueError: a robot whose bodies close a loop, or that ropes pull.
    """
    for equality in list(spec.equalities):
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and {equality.name1, equality.name2} <= set(fixed):
            spec.delete(equality)
    if list(spec.equalities) or list(spec.tendons):
        raise InvalidValueError(
            "a robot with equality constraints or tendons cannot be adapted: control knows chains of joints; "
            "joints that follow others may be named in 'fixed' with them"
        )
    write_inertias(spec)
    things = spec.sensors, spec.keys, spec.pairs, spec.excludes, spec.actuators, spec.lights, spec.sites
    for part in chain(*things):
        spec.delete(part)
    for geom in list(spec.geoms):
        if not keep_visual or geom.parent.name == "world" or geom.group in COLLISION_GROUPS:
            spec.delete(geom)
            continue
        geom.contype = geom.conaffinity = 0
        geom.group = VISUAL_GROUP
    if not keep_visual:
        for part in (*spec.meshes, *spec.materials, *spec.textures):
            spec.delete(part)


def write_inertias(spec: mujoco.MjSpec) -> None:
    """Write down what bodies weigh that take it from their shapes, in place; others are left alone."""
    unknown = [body for body in spec.bodies if not body.explicitinertial and list(body.geoms)]
    unknown = [body for body in unknown if body.name != "world"]
    if not unknown:
        return
    model = spec.compile()
    for body in unknown:
        own = model.body(body.name)
        if own.mass[0] <= SHAPES:
            continue
        body.mass, body.ipos, body.iquat, body.inertia = own.mass[0], own.ipos, own.iquat, own.inertia
        body.explicitinertial = True
