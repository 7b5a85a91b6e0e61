"""Compile all kernels ahead of their first use, by a short run of everything that calls one."""

from collections.abc import Iterator
from dataclasses import replace

import gymnasium as gym

from ...controllers.policies.two_stage import RandomPolicy
from ...controllers.settings import ARMS
from ...envs.scenario.model_errors import ModelErrors
from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Command, CommandChange, Scenario
from ..rollout.environments import env_ids, make_env
from ..rollout.episodes import rollout, rollout_all
from ..rollout.load_policy import acts_on_joints, acts_on_residual, make_policy

DOUBLE_SUPPORT = "PushRecovery/Pendulum-v0@double-support"
ROBOTS = 2  # side by side: what runs in batches
WALK = Scenario(
    "warm-up", (Push((30.0, 10.0, 0.0), 0.1, 0.2),), Command(0.1), duration=1.0,
    changes=(CommandChange(0.4, Command()),),
)  # fmt: skip
ERRORS = {  # those that each kind of robot knows
    "Pendulum": ModelErrors(mass=0.05, slope_forward=0.01, delay=0.004, dcm_noise=0.001),
    "Biped": ModelErrors(
        mass=0.05, payload=1.0, friction=0.8, slope_left=0.01, delay=0.004, dcm_noise=0.001,
        joint_noise=0.0005, floor_step=0.005,
    ),
}  # fmt: skip


def warm_up() -> Iterator[str]:
    """Run every environment, preset form and arm for a second; yields what comes next, for a display.

    What was compiled is kept for every process of this user until its sources change. Where all of it is
    there, this takes seconds.
    """
    for name in names():
        yield name
        _run(name)


def names() -> list[str]:
    """Environments that `warm_up` runs, those of other robots left out: their kernels are the biped's."""
    return [*(name for name in env_ids() if "robot" not in gym.spec(name).kwargs), DOUBLE_SUPPORT]


def arms(name: str) -> list[str]:
    """Arms that plan in an environment: the paper's form of stage 2 and linear MPC know no double support."""
    without = ("two-stage-paper", "herdt") if name == DOUBLE_SUPPORT else ()
    return [arm for arm in ARMS if arm not in without]


def _run(name: str) -> None:
    env = make_env(name)
    try:
        if acts_on_residual(env) or acts_on_joints(env):
            # random actions may be residuals and targets as well; no arm gives those
            policy = make_policy("random", env) if acts_on_joints(env) else RandomPolicy()
            rollout(env, policy, WALK, "random")
            rollout_all(env, policy, [WALK] * ROBOTS, "random", ROBOTS)
            return
        errors = next(value for kind, value in ERRORS.items() if kind in name)
        for arm in arms(name):
            policy = make_policy(arm, env)
            rollout(env, policy, WALK, arm)
            rollout_all(env, policy, [WALK, replace(WALK, errors=errors)], arm, ROBOTS)
    finally:
        env.close()
