"""Legs, arms and trunk that collide with each other and with the floor.

The robot's own model has contacts of the soles, and of feet and shanks with one another, as explicit pairs,
which stay as they are. Here all other shapes of its bodies take part, too; those of a body and of its parent
in the tree never meet, as MuJoCo has it.
"""

from __future__ import annotations

import mujoco

from ....controllers.model.body_plan import BodyPlan

COLLIDES = 1  # bit of contype and conaffinity


def add_collisions(spec: mujoco.MjSpec, plan: BodyPlan) -> None:
    """Let all shapes of a spec collide; of the bodies of the feet only the soles, not what dresses them."""
    feet = {spec.geom(name).parent.name for name in plan.sole_boxes}
    pair = spec.pairs[0]
    for geom in spec.geoms:
        if geom.parent.name in feet and geom.name not in plan.sole_boxes:
            continue
        geom.contype = geom.conaffinity = COLLIDES
        geom.solref = pair.solref  # as hard as the soles
