"""Limbs for the eye of a robot whose meshes cannot be shown: capsules along its skeleton."""

from __future__ import annotations

import mujoco
import numpy as np

THICK = 0.16  # radius of a limb over its length
SLIM, STOUT = 0.015, 0.06  # least and largest radius [m]
SHORT = 0.03  # a shorter one is not drawn [m]
READABLE = ".obj", ".stl", ".msh"  # meshes that MuJoCo reads


def can_be_shown(spec: mujoco.MjSpec) -> bool:
    """Whether a model has shapes of its own that MuJoCo can read."""
    return bool(list(spec.geoms)) and all(mesh.file.lower().endswith(READABLE) for mesh in spec.meshes)


def draw_limbs(spec: mujoco.MjSpec) -> None:
    """A capsule from every body to each that hangs from it; nothing touches them and they weigh nothing."""
    for body in spec.bodies:
        if body.name == "world" or body.parent.name == "world":
            continue
        end = np.array(body.pos)
        length = float(np.linalg.norm(end))
        if length < SHORT:
            continue
        radius = min(max(THICK * length, SLIM), STOUT)
        body.parent.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0.0, 0.0, 0.0, *end], size=[radius, 0.0, 0.0],
            group=1, contype=0, conaffinity=0, mass=0.0, material="pr_shell",
        )  # fmt: skip
