"""A model without its shapes, or with those alone that are looked at or that collide."""

from __future__ import annotations

from collections.abc import Collection
from itertools import chain

import mujoco

from .....controllers.errors import InvalidValueError

SHAPES = 1e-12  # least mass of a body that counts [kg]
NONE, VISUAL, SOLID = "none", "visual", "solid"  # shapes that are left: those for the eye, or that collide
HULL = 32  # corners of the convex hull that a mesh collides with, at most
VISUAL_GROUP = 1  # of the shapes that are drawn
COLLISION_GROUPS = (3, 4, 5)  # of the shapes that models draw on demand only


def drop_shapes(spec: mujoco.MjSpec, left: str = NONE, fixed: Collection[str] = ()) -> None:
    """Take shapes out of a model but for those of a kind that are `left`, and let nothing touch any of them.

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
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    things = spec.sensors, spec.keys, spec.pairs, spec.excludes, spec.actuators, spec.lights, spec.sites
    for part in chain(*things):
        spec.delete(part)
    for geom in list(spec.geoms):
        solid = bool(geom.contype or geom.conaffinity) or geom.name in paired
        wanted = solid if left == SOLID else geom.group not in COLLISION_GROUPS
        if left == NONE or geom.parent.name == "world" or not wanted:
            spec.delete(geom)
            continue
        geom.contype = geom.conaffinity = 0
        geom.group = VISUAL_GROUP
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
        elif left == SOLID:
            mesh.maxhullvert = HULL
    if left == NONE:
        for part in (*spec.materials, *spec.textures):
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
