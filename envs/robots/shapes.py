"""Shapes of somebody else's model: those for the eye, or those that collide, put onto its robot written anew.

A mesh is named by the file that the model names; other shapes are as MuJoCo has compiled them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from ...controllers.files import is_file
from .model_files import read_model
from .source_model import MESH, SourceModel, compiled, paired_shapes, solid, take_mesh, take_out

NONE, VISUAL, SOLID = "none", "visual", "solid"  # shapes that are left: those for the eye, or that collide
HULL = 32  # corners of the convex hull that a mesh collides with, at most
VISUAL_GROUP = 1  # of the shapes that are drawn
COLLISION_GROUPS = (3, 4, 5)  # of the shapes that models draw on demand only
READABLE = ".obj", ".stl", ".msh"  # meshes that MuJoCo reads
THEIRS = "model "  # begins the names of what a model's shapes are made of
CONTACT = "condim", "priority", "friction", "solmix", "solimp", "margin", "gap"  # of a shape that collides
FOLDER = {"mesh": "meshdir", "texture": "texturedir"}  # field of the compiler
UNCOPIED = {"id", "info", "name", "classname", "compiler", "plugin", "signature", "material"}
# A shape without weight that touches nothing but what pairs name
INERT: dict[str, Any] = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": VISUAL_GROUP}


def add_shapes(spec: mujoco.MjSpec, source: SourceModel, kind: str) -> bool:
    """Put shapes of a kind onto a rewritten robot, where nothing touches them and they weigh nothing.

    Returns:
        Whether the model has shapes, all of which MuJoCo can read; otherwise there are none.
    """
    theirs = read_model(source.place)
    if not list(theirs.geoms) or not all(mesh.file.lower().endswith(READABLE) for mesh in theirs.meshes):
        return False
    paired, robot = paired_shapes(theirs), {str(source.model.body(body).name) for body in source.bodies}
    take_out((*theirs.sensors, *theirs.pairs, *theirs.excludes, *theirs.tuples, *theirs.skins), theirs)
    theirs.compiler.fusestatic = False
    shapes = [(geom, take_mesh(geom)) for geom in theirs.geoms]
    model = compiled(theirs, source.place)
    for geom, mesh in shapes:
        wanted = solid(geom, paired) if kind == SOLID else geom.group not in COLLISION_GROUPS
        if wanted and geom.parent.name in robot:
            _add_shape(spec, theirs, model, geom, mesh)
    if kind == SOLID:
        for mesh in spec.meshes:
            mesh.maxhullvert = HULL
    return True


def _add_shape(
    spec: mujoco.MjSpec, theirs: mujoco.MjSpec, model: mujoco.MjModel, geom: mujoco.MjsGeom, mesh: str
) -> None:
    """Put a shape of a model, where it is when compiled, onto the same body of another one."""
    number, body, folder = geom.id, spec.body(geom.parent.name), theirs.modelfiledir
    added = body.add_geom(
        name=geom.name, type=MESH if mesh else geom_type(model, number), pos=model.geom_pos[number],
        quat=model.geom_quat[number], rgba=geom.rgba, **INERT,
    )  # fmt: skip
    if mesh:
        added.meshname = _copied(spec, theirs.mesh(mesh), folder)
    else:
        added.size = model.geom_size[number]
    if geom.material:
        added.material = _copied(spec, theirs.material(geom.material), folder)
        material, used = spec.material(added.material), theirs.material(geom.material).textures
        material.textures = [name and _copied(spec, theirs.texture(name), folder) for name in used]
    for field in CONTACT:
        setattr(added, field, getattr(model, f"geom_{field}")[number])


def geom_type(model: mujoco.MjModel, geom: int) -> mujoco.mjtGeom:
    """Type of a compiled shape. An entry of `geom_type` alone is never found in a tuple of types."""
    return mujoco.mjtGeom(int(model.geom_type[geom]))


def _copied(spec: mujoco.MjSpec, part: Any, folder: str) -> str:
    """Name of a copy of a mesh, a material or a texture in another spec, where there is one at most."""
    kind = type(part).__name__.removeprefix("Mjs").lower()
    name = THEIRS + part.name
    if getattr(spec, kind)(name) is not None:
        return name
    copy = getattr(spec, f"add_{kind}")(name=name)
    for field in dir(part):
        value = getattr(part, field)
        if field[0] != "_" and field not in UNCOPIED and not callable(value):
            setattr(copy, field, value)
    if getattr(part, "file", ""):
        copy.file = _found(folder, getattr(part.compiler, FOLDER[kind]), part.file)
    return name


def _found(folder: str, inside: str, file: str) -> str:
    """Path of a file as MuJoCo finds it: in the compiler's folder, or beside the model, maybe by its name."""
    places = [Path(folder, own, name) for name in (file, Path(file).name) for own in (inside, "")]
    return next((str(place.absolute()) for place in places if is_file(place)), file)
