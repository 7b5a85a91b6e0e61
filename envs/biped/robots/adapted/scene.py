"""The world of an adapted robot: floor, light, colours and options of the biped's own model."""

from __future__ import annotations

import mujoco

# Names begin with what no model has
COLOURS = {"pr_shell": (0.93, 0.94, 0.95), "pr_left": (0.95, 0.52, 0.13), "pr_right": (0.16, 0.45, 0.80)}
FLOOR, TILE = (1.0, 1.0, 1.0), (0.90, 0.92, 0.95)
SKY = (0.80, 0.87, 0.95), (0.95, 0.97, 0.99)
LIGHT = {"dir": [-0.35, 0.45, -0.85], "diffuse": [0.45, 0.45, 0.45], "specular": [0.15, 0.15, 0.15]}
PICTURE = 1280, 960  # largest [pixels]


def set_options(spec: mujoco.MjSpec) -> None:
    """Physics as the biped's: implicit integration without damping of its own, pyramidal friction cones."""
    spec.option = mujoco.MjSpec().option
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_EULERDAMP.value


def add_world(spec: mujoco.MjSpec) -> None:
    """Floor, light, sky and the colours of the soles."""
    for name, rgb in COLOURS.items():
        spec.add_material(name=name, rgba=[*rgb, 1.0], specular=0.3, shininess=0.4)
    chequered, plane = mujoco.mjtTextureRole.mjTEXROLE_RGB.value, mujoco.mjtGeom.mjGEOM_PLANE
    spec.add_texture(
        name="pr_floor", type=mujoco.mjtTexture.mjTEXTURE_2D, width=128, height=128, rgb1=FLOOR, rgb2=TILE,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
    )  # fmt: skip
    material = spec.add_material(name="pr_floor", texrepeat=[2.0, 2.0], texuniform=True)
    material.textures[chequered] = "pr_floor"
    spec.add_texture(
        name="pr_sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=64, rgb1=SKY[0], rgb2=SKY[1],
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
    )  # fmt: skip
    world = spec.worldbody
    world.add_geom(
        name="floor", type=plane, size=[0.0, 0.0, 1.0], contype=0, conaffinity=0, material="pr_floor"
    )
    world.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=False, **LIGHT)
    look = spec.visual
    look.global_.offwidth, look.global_.offheight = PICTURE
    look.quality.shadowsize = look.quality.offsamples = 0
    look.headlight.ambient, look.headlight.diffuse = [0.42] * 3, [0.28] * 3
    look.headlight.specular = [0.0] * 3
