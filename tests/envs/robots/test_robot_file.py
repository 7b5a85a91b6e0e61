"""Robot files: written and read again, refused with the key or the value that is wrong."""

import json
import os
import re
import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError
from push_recovery.envs.robots import model_files as model_place
from push_recovery.envs.robots.adapt import load_robot
from push_recovery.envs.robots.compiled_robot import compiled_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.robot_file import read_robot_file, write_robot_file
from push_recovery.envs.robots.source_model import compiled


@pytest.fixture
def written(robot_file, tmp_path):
    plan = replace(robot_file().plan, waist=("waist_pitch", None))
    robot = robot_file(plan=plan, fixed=(("waist_roll", 0.1),), about="a test")
    write_robot_file(tmp_path / "theirs.json", robot, "biped")
    return tmp_path / "theirs.json", robot


def test_a_file_is_read_as_it_was_written(written):
    path, robot = written
    assert read_robot_file(path) == robot


def test_a_model_and_a_preset_beside_the_file_are_found_from_anywhere(written, tmp_path, monkeypatch):
    path, _ = written
    content = json.loads(path.read_text())
    (tmp_path / "own.json").touch()
    path.write_text(json.dumps(content | {"model": "theirs.xml", "preset": "own.json"}))
    monkeypatch.chdir("/")
    robot = read_robot_file(path)
    assert robot.model == str(tmp_path / "theirs.xml")
    assert robot.preset == str(tmp_path / "own.json")


def test_an_environment_takes_the_path_of_a_file(written):
    path, _ = written
    description = robot_description(str(path))
    assert description is load_robot(str(path))
    assert (description.name, description.com_height, description.preset) == ("theirs", 0.8, "biped")


def test_a_folder_with_a_colon_is_no_module(robot_file, tmp_path, monkeypatch):
    write_robot_file(tmp_path / "a:b" / "mine.robot.json", robot_file(), "biped")
    monkeypatch.chdir(tmp_path)
    assert robot_description("a:b/mine.robot.json").name == "theirs"


def test_folders_that_move_together_stay_together(robot_file, tmp_path):
    """A robot file names its model from where it lies, and from where it was written if that is gone."""
    robot = robot_file()  # its model in tmp_path
    place = tmp_path / "here" / "robots"
    write_robot_file(place / "mine.robot.json", robot, "biped")
    shutil.move(tmp_path / "theirs.xml", tmp_path / "here" / "theirs.xml")
    moved = replace(robot, model=str(tmp_path / "here" / "theirs.xml"))
    write_robot_file(place / "mine.robot.json", moved, "biped")
    shutil.copytree(tmp_path / "here", tmp_path / "copy")
    (tmp_path / "here").rename(tmp_path / "there")
    for folder in ("there", "copy"):
        found = read_robot_file(tmp_path / folder / "robots" / "mine.robot.json")
        assert found.model == str(tmp_path / folder / "theirs.xml")
    (tmp_path / "there").rename(tmp_path / "here")
    alone = shutil.copy(place / "mine.robot.json", tmp_path / "alone.robot.json")
    assert read_robot_file(alone).model == str(tmp_path / "here" / "theirs.xml")


def test_a_link_to_a_robot_file_finds_what_lies_beside_that(robot_file, tmp_path):
    """Where neither the link nor the folder that it was written in has the model."""
    write_robot_file(tmp_path / "old" / "mine.robot.json", robot_file(), "biped")
    shutil.move(tmp_path / "theirs.xml", tmp_path / "old" / "theirs.xml")
    moved = replace(robot_file(), model=str(tmp_path / "old" / "theirs.xml"))
    write_robot_file(tmp_path / "old" / "mine.robot.json", moved, "biped")
    (tmp_path / "old").rename(tmp_path / "new")
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "mine.robot.json").symlink_to("../new/mine.robot.json")
    found = read_robot_file(tmp_path / "links" / "mine.robot.json")
    assert found.model == str(tmp_path / "new" / "theirs.xml")


def test_links_are_not_replaced_by_what_they_lead_to(written, tmp_path, monkeypatch):
    """A store keeps contents under names of its own; what a model includes lies beside the links."""
    path, _ = written
    store, view = tmp_path / "store", tmp_path / "view"
    store.mkdir()
    view.mkdir()
    text = (tmp_path / "theirs.xml").read_text()
    body, end = text[text.index("<worldbody>") : text.index("</worldbody>")] + "</worldbody>", "</mujoco>"
    whole = text.replace(body, '<include file="robot/body.xml"/>')
    for name, content in (("a1", whole), ("b2", f"<mujoco>{body}{end}"), ("c3", path.read_text())):
        (store / name).write_text(content.replace(str(tmp_path), "."))
    (view / "robot").mkdir()
    for link, name in (("theirs.xml", "a1"), ("robot/body.xml", "b2"), ("mine.robot.json", "c3")):
        (view / link).symlink_to(store / name)
    monkeypatch.chdir(view)
    found = read_robot_file("mine.robot.json")
    assert found.model == str(view / "theirs.xml")
    np.testing.assert_array_equal(
        compiled_robot(load_robot("mine.robot.json")).model.body_mass,
        compiled_robot(load_robot(path)).model.body_mass,
    )


PLAIN = '<mujoco><include file="part.xml"/></mujoco>'
MESH = '<asset><mesh name="sole" file="sole.obj"/></asset>'
PART = (
    f'<mujoco><compiler meshdir="meshes"/>{MESH}<worldbody><body name="a"><freejoint/><geom type="mesh" '
    'mesh="sole"/><body name="b"><joint name="j"/><geom size=".1"/></body></body></worldbody></mujoco>'
)
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def pieces(tmp_path):
    """A model of three files: itself, what it includes and a mesh."""
    (tmp_path / "meshes").mkdir()
    parts = {"whole.xml": PLAIN, "part.xml": PART, "meshes/sole.obj": CORNERS}
    for name, content in parts.items():
        (tmp_path / name).write_text(content)
    return parts


@pytest.mark.parametrize("changed", ["whole.xml", "part.xml", "meshes/sole.obj"])
def test_a_change_of_any_file_of_a_model_is_noticed(pieces, tmp_path, changed):
    model = str(tmp_path / "whole.xml")
    before = model_place.model_digest(model)
    assert model_place.model_digest(model) == before
    mujoco.MjModel.from_xml_path(model)  # it is one
    content = pieces[changed]
    (tmp_path / changed).write_text(content.replace("1", "2", 1) if "obj" in changed else f"{content} ")
    after = model_place.model_digest(model)
    assert after != before
    (tmp_path / "unnamed.xml").write_text(content)
    assert model_place.model_digest(model) == after
    (tmp_path / changed).write_text(content)
    assert model_place.model_digest(model) == before


LEG = (
    '<mujoco><compiler meshdir="meshes"/><asset><mesh name="sole" file="sole.obj"/></asset><worldbody>'
    '<body name="foot"><geom type="mesh" mesh="sole"/></body></worldbody></mujoco>'
)
ATTACHED = (
    '<mujoco><asset><model name="l" file="a/leg.xml"/><model name="r" file="b/leg.xml"/></asset><worldbody>'
    '<attach model="l" prefix="l_" body="foot"/><attach model="r" prefix="r_" body="foot"/></worldbody>'
    "</mujoco>"
)
LEGS = {f"{side}/{name}": content for side in "ab" for name, content in (
    ("leg.xml", LEG), ("meshes/sole.obj", CORNERS))}  # fmt: skip
NESTED = '<mujoco><include file="a/part.xml"/><include file="b/part.xml"/></mujoco>'
PARTS = {f"{side}/{name}": f"<mujoco>{content}</mujoco>" for side in "ab" for name, content in (
    ("part.xml", '<include file="inner.xml"/>'),
    ("inner.xml", f'<custom><text name="{side}" data="1"/></custom>'),
)}  # fmt: skip
DASHES, UMLAUT = b"<!-- ---- <legs> ---- -->", "<!-- f\xfc\xdfe -->".encode("latin-1")


@pytest.mark.parametrize(("whole", "parts", "changed"), [
    (PART.encode() + DASHES, {"meshes/sole.obj": CORNERS}, "meshes/sole.obj"),
    (DASHES + PART.encode(), {"meshes/sole.obj": CORNERS}, "meshes/sole.obj"),
    (UMLAUT + PART.encode(), {"meshes/sole.obj": CORNERS}, "meshes/sole.obj"),
    *((ATTACHED.encode(), LEGS, f"{side}/meshes/sole.obj") for side in "ab"),
    *((NESTED.encode(), PARTS, f"{side}/inner.xml") for side in "ab"),
])  # fmt: skip
def test_a_change_is_noticed_of_any_file_that_mujoco_reads(tmp_path, whole, parts, changed):
    """With comments that are no XML, bytes that are no text, and one name in two folders."""
    for name, content in {
        "whole.xml": whole,
        **{name: text.encode() for name, text in parts.items()},
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    model = str(tmp_path / "whole.xml")
    mujoco.MjModel.from_xml_path(model)  # it is one
    before = model_place.model_digest(model)
    (tmp_path / changed).write_text(f"{parts[changed]}\n")
    assert model_place.model_digest(model) != before


def test_a_mesh_that_changes_within_a_second_is_read_again(pieces, tmp_path):
    """MuJoCo keeps meshes by path and second."""
    sizes = []
    for content in (CORNERS, CORNERS.replace("1 0 0", "2 0 0")):
        (tmp_path / "meshes" / "sole.obj").write_text(content)
        os.utime(tmp_path / "meshes" / "sole.obj", (1e9, 1e9))
        sizes.append(np.ptp(model_place.read_model(str(tmp_path / "whole.xml")).compile().mesh_vert))
    assert sizes[0] != sizes[1]


URDF = (
    '<robot name="r"><link name="a"><collision><geometry><mesh filename="package://soles/meshes/sole.obj"/>'
    "</geometry></collision></link></robot>"
)


@pytest.mark.parametrize("beside", ["soles", "legs"])
@pytest.mark.parametrize("deep", ["urdf", "urdf/rev_1"])
def test_meshes_of_packages_of_ros_are_found_and_their_changes_noticed(tmp_path, beside, deep):
    """In the package that the model lies in, and in one beside it; the nearest one where there are two."""
    mesh = tmp_path / "src" / "soles" / "meshes" / "sole.obj"
    model = tmp_path / "src" / beside / deep / "robot.urdf"
    for path, content in (
        (mesh, CORNERS.replace("1 0 0", "5 0 0")), (model, URDF),
        (tmp_path / "soles" / "meshes" / "sole.obj", CORNERS),
    ):  # fmt: skip
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    before = model_place.model_digest(str(model))
    assert np.ptp(model_place.read_model(str(model)).compile().mesh_vert) > 4.0
    mesh.write_text(CORNERS)
    assert model_place.model_digest(str(model)) != before


def test_a_mesh_of_a_package_that_is_nowhere_is_named(tmp_path):
    (tmp_path / "robot.urdf").write_text(URDF)
    spec = model_place.read_model(str(tmp_path / "robot.urdf"))
    with pytest.raises(
        InvalidValueError, match=r"^MuJoCo cannot compile the model 'robot'.*soles/meshes/sole\.obj"
    ):
        compiled(spec, "robot")


def test_a_large_file_is_read_again_when_it_changes(tmp_path, monkeypatch):
    path, reads = tmp_path / "large.stl", []
    read = model_place.read_file
    monkeypatch.setattr(model_place, "read_file", lambda file: reads.append(file) or read(file))
    content = bytes(model_place.SMALL)
    path.write_bytes(content)
    first = [model_place.file_digest(path) for _ in range(3)]
    path.write_bytes(content[:-1] + b"1")
    assert len(set(first)) == 1
    assert model_place.file_digest(path) != first[0]
    assert len(reads) == 2


@pytest.mark.parametrize("changed", ["model", "robot file"])
def test_an_edited_robot_is_another_one_in_the_same_process(written, tmp_path, changed):
    path, _ = written
    old = load_robot(str(path))
    assert load_robot(path) is old
    before = compiled_robot(old).model.body_mass.copy()
    if changed == "model":
        model = tmp_path / "theirs.xml"
        model.write_text(re.sub(' mass="[0-9.]+"', ' mass="77"', model.read_text(), count=1))
    else:
        path.write_text(json.dumps(json.loads(path.read_text()) | {"com_height": 0.81}))
    new = load_robot(str(path))
    assert new is not old
    assert new.files != old.files
    if changed == "model":
        assert compiled_robot(new).model.body_mass.sum() > before.sum() + 0.9
        with pytest.raises(InvalidValueError, match=r"has changed since robot 'theirs' was read: read it"):
            old.looks()  # not made yet when the model changed
    else:
        assert compiled_robot(new).robot.com_height == 0.81


def test_one_name_in_two_folders_is_two_robots(written, tmp_path, monkeypatch):
    path, _ = written
    for folder, height in (("one", 0.8), ("two", 0.7)):
        (tmp_path / folder).mkdir()
        shutil.copy(tmp_path / "theirs.xml", tmp_path / folder)
        content = json.loads(path.read_text()) | {"com_height": height}
        (tmp_path / folder / "mine.robot.json").write_text(json.dumps(content))
    found = []
    for folder in ("one", "two"):
        monkeypatch.chdir(tmp_path / folder)
        found.append(robot_description("mine.robot.json"))
    assert [robot.com_height for robot in found] == [0.8, 0.7]
    assert [one.spec.robot.model for one in found] == [
        str(tmp_path / n / "theirs.xml") for n in ("one", "two")
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, r"its 'format' is not 'push-recovery robot'"),
        ({"format_version": 9}, r"has format_version 9; this version reads 1"),
        ({"soles": [{"centre": [0, 0, 0]}]}, r"is not complete or has a value of another kind"),
        ({"legs": [["a"], ["b"]]}, r"the left leg of a BodyPlan has 6 joints"),
        ({"com_height": "high"}, r"is not complete or has a value of another kind"),
        ({"com_height": float("nan")}, r"a number above 0 is needed, got nan|is not JSON"),
        ({"soles": [{"centre": [0, 0, 0], "size": [0.2, 0]}] * 2}, r"a number above 0 is needed, got 0"),
        (
            {"soles": [{"centre": [0, 0], "size": [0.2, 0.1]}] * 2},
            r"3 finite numbers are needed, got \[0",
        ),
        ({"soles": [{"centre": [0, 0, 0], "size": [1, 1], "turn": [0] * 4}] * 2}, r"must not be 0"),
        ({"pelvis": ["pelvis"]}, r"a name must be text, got \['pelvis'\]"),
        ({"held": {"waist_yaw": "0"}}, r"1 finite numbers are needed, got \['0'\]"),
        ({"motors": {"*": {"torque": -1}}}, r"a number above 0 is needed, got -1"),
        ({"motors": {"*": {"force": 1}}}, r"unexpected keyword argument 'force'"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(written, change, message):
    path, _ = written
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InvalidValueError, match=message):
        read_robot_file(path)


def test_an_unknown_key_is_named(written):
    path, _ = written
    path.write_text(json.dumps(json.loads(path.read_text()) | {"sole": []}))
    with pytest.raises(UnknownNameError, match=r"'sole'; did you mean 'soles'\?"):
        read_robot_file(path)


def test_a_missing_file_model_or_package_is_told(written, tmp_path, monkeypatch):
    with pytest.raises(InvalidValueError, match=r"^cannot read robot file"):
        read_robot_file(tmp_path / "none.json")
    with pytest.raises(InvalidValueError, match=r"^there is no model 'none.xml'$"):
        model_place.read_model("none.xml")
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(InvalidValueError, match=r"^MuJoCo cannot read the model"):
        model_place.read_model(str(tmp_path / "broken.xml"))
    monkeypatch.setattr(model_place, "find_spec", lambda name: None)
    with pytest.raises(
        MissingExtraError, match=r"jvrc-description is not installed.*push-recovery\[robots\]"
    ):
        model_place.read_model("jvrc_description/urdf/jvrc1.urdf")
