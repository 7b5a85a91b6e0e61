"""The pages under docs/environments say what the code does."""

import inspect
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.joint_control import JOINT_NAMES, JOINT_OBSERVATION_NAMES, own_joint
from push_recovery.controllers.model.gait_box import GAIT_NAMES
from push_recovery.controllers.model.observation import OBSERVATION_NAMES
from push_recovery.controllers.policies.residual import default_residual_scale
from push_recovery.controllers.whole_body import gait_machine as biped_gait
from push_recovery.envs.biped.env import BipedEnv
from push_recovery.envs.joint.env import BipedJointEnv, BipedJointResidualEnv
from push_recovery.envs.pendulum import dynamics as pendulum_dynamics
from push_recovery.envs.pendulum.env import PendulumEnv
from push_recovery.envs.wrappers import make_biped_residual

import push_recovery  # noqa: F401

DOCS = Path(__file__).parents[3] / "docs"
PAGES = {
    "Pendulum": "pendulum",
    "Biped": "biped",
    "BipedResidual": "biped_residual",
    "BipedJoint": "biped_joint",
    "BipedJointResidual": "biped_joint_residual",
}
SEEN = {
    "BipedJoint": JOINT_OBSERVATION_NAMES,
    "BipedJointResidual": OBSERVATION_NAMES + JOINT_OBSERVATION_NAMES,
}
BUILDERS = {
    "Pendulum": PendulumEnv,
    "Biped": BipedEnv,
    "BipedResidual": make_biped_residual,
    "BipedJoint": BipedJointEnv,
    "BipedJointResidual": BipedJointResidualEnv,
}


def section(name, title):
    """Text of a section, after those sections that it refers to: "as for [Biped](biped.md#info)"."""
    return "\n".join(text for _, text in parts(PAGES[name], title))


def parts(page, title):
    """(page, text) of the sections that a section refers to, and of itself."""
    text = (DOCS / "environments" / f"{page}.md").read_text(encoding="utf-8")
    own = text.split(f"\n## {title}\n")[1].split("\n## ")[0]
    anchor = title.lower().replace(" ", "-")
    others = re.findall(rf"[Aa]s for \[[\w ]+\]\((\w+)\.md#{anchor}\)", own)
    return [part for other in others for part in parts(other, title)] + [(page, own)]


def rows(name, title):
    """Cells of the section's first table, without its head, after the rows that it refers to.

    A row of the page's own takes the place of the one that is referred to. Of two other pages the numbers
    of the second go on from the first's.
    """
    *others, (_, own) = parts(PAGES[name], title)
    found = []
    for _, text in others:
        before = len(found)
        found += [[str(int(c[0]) + before), *c[1:]] if c[0].isdigit() else c for c in cells_of(text)]
    return list({key(cells): cells for cells in (*found, *cells_of(own))}.values())


def key(cells):
    """Number and name of a numbered row, or the names in the first cell."""
    return tuple(cells[: 1 + cells[0].isdigit()])


def cells_of(text):
    """Cells of a section's table, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def names(cells):
    return re.findall(r"`([^`]+)`", cells[0])


@pytest.fixture(params=PAGES)
def env(request):
    made = gym.make(f"PushRecovery/{request.param}-v0")
    yield request.param, made
    made.close()


def test_action_table(env):
    name, made = env
    limits = made.unwrapped.limits
    table = rows(name, "Action space")
    if "Joint" in name:
        check_joint_table(name, made.unwrapped.core.joints, table)
        return
    assert [cells[1].strip("`") for cells in table] == list(GAIT_NAMES)
    bounds = np.array([[float(cells[3]), float(cells[4])] for cells in table])
    np.testing.assert_allclose(bounds, np.stack([limits.low, limits.high], axis=1), rtol=1e-5)
    if name == "BipedResidual":
        adds = default_residual_scale(limits) * (limits.high - limits.low) / 2
        np.testing.assert_allclose([float(cells[2]) for cells in table], adds, rtol=2e-3)


def check_joint_table(name, joints, table):
    assert [(int(cells[0]), cells[1].strip("`")) for cells in table] == list(enumerate(JOINT_NAMES))
    numbers = np.array([[float(cell) for cell in cells[3:]] for cells in table]).T
    order = [own_joint(c, 1) for c in range(14)]
    constants = joints.posture, joints.stiffness, joints.damping, joints.largest
    expected = constants if name == "BipedJoint" else (joints.reach, joints.largest)
    for column, values in zip(numbers, expected, strict=True):
        np.testing.assert_allclose(column, values[order], rtol=6e-3, atol=1e-9)


def test_observation_table(env):
    name, made = env
    table = rows(name, "Observation space")
    expected = list(enumerate(SEEN.get(name, OBSERVATION_NAMES)))
    assert [(int(cells[0]), cells[1].strip("`")) for cells in table] == expected
    observation, _ = made.reset(seed=3)
    for _ in range(20):
        observation, *_ = made.step(made.action_space.sample() * 0)
    for cells, value in zip(table, observation, strict=True):
        if "(0 here)" in cells[2]:
            assert value == 0.0, cells[1]


def test_reward_terms_reasons_and_info(env):
    name, made = env
    assert [names(cells)[0] for cells in rows(name, "Rewards")] == list(made.unwrapped.episodes.reward_terms)
    ends = {names(cells)[0] for cells in rows(name, "Episode end") if names(cells)}
    failures = pendulum_dynamics.FAILURES if name == "Pendulum" else biped_gait.FAILURES
    assert ends == set(failures) - {""}
    made.reset(seed=0)
    info = made.step(np.zeros(made.action_space.shape, np.float32))[4]
    stated = [key for cells in rows(name, "Info") for key in names(cells)]
    assert sorted(stated) == sorted(info)
    push = next(cells for cells in rows(name, "Info") if cells[0] == "`push`")[1]
    assert set(info["push"]) <= set(re.findall(r"`(\w+)`", push))


def test_arguments(env):
    name, _ = env
    biped = dict(inspect.signature(BipedEnv).parameters)
    expected = {
        k: p for k, p in inspect.signature(BUILDERS[name]).parameters.items() if p.kind is not p.VAR_KEYWORD
    }
    if name in {"BipedResidual", "BipedJointResidual"}:
        expected = {**biped, **expected}
    stated = {names(cells)[0]: cells[1].strip("`") for cells in rows(name, "Arguments")}
    assert stated == {key: repr(parameter.default) for key, parameter in expected.items()}


def test_limits_of_an_episode(env):
    name, made = env
    assert made.spec is not None
    assert made.spec.max_episode_steps is None
    if name != "Pendulum":
        lowest = biped_gait.LOWEST * made.unwrapped.robot.com_height
        assert f"less than {lowest:g} m" in section(name, "Episode end")
        tilt = np.degrees(np.arccos(biped_gait.STEEPEST))
        assert f"more than {tilt:.0f} degrees" in section(name, "Episode end")


def test_vector_form_autoresets_on_the_next_step(env):
    name, _ = env
    mode = gym.vector.AutoresetMode
    for expected, kwargs in ((mode.NEXT_STEP, {}), (mode.SAME_STEP, {"autoreset_mode": mode.SAME_STEP})):
        vector = gym.make_vec(
            f"PushRecovery/{name}-v0", num_envs=1, vectorization_mode="sync", vector_kwargs=kwargs
        )
        assert vector.metadata["autoreset_mode"] == expected
        vector.close()
    assert "AutoresetMode.NEXT_STEP" in section(name, "Vector form")


def test_pictures_and_links_exist():
    for page in PAGES.values():
        text = (DOCS / "environments" / f"{page}.md").read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#]+)", text):
            assert (DOCS / "environments" / target).is_file(), target
    for picture in (DOCS / "pictures").iterdir():
        assert picture.stat().st_size < 300_000, picture.name
