"""Are observations and targets those of Holosoma's own code, on recorded states of a pushed robot?

    python benchmarks/holosoma_observations.py holosoma-g1-ppo [FILE.json]

The package's `LocomotionPolicy` builds its observation from each state that our robot came to, keeps its own
clock and last action, and says its targets. What it imports for real robots alone is left out. FILE.json gets
every 64th decision, as tests/pinned/holosoma.json holds them.
Needs pip install --no-deps holosoma-inference, and termcolor, loguru and pydantic.
"""

import json
import sys
from collections import deque
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
from push_recovery.eval.robot_tools.policy_check import Controls, robot_of
from push_recovery.eval.rollout.contender import Contender
from push_recovery.eval.rollout.contract_files import read_contract

from push_recovery import Command, CommandChange, Push, Scenario

FOR_REAL_ROBOTS = (
    "wandb", "netifaces", "zmq", "sshkeyboard", "importlib_metadata", "lazy_importer", "pinocchio",
    "defusedxml",
)  # fmt: skip
EVERY = 64  # decisions, of which one is recorded
DIGITS = 8  # of a recorded number


def recorded(values):
    """Numbers for a file."""
    return [float(f"{value:.{DIGITS}g}") for value in np.ravel(values)]


def theirs(robot: str, path: str):
    """A policy of the package with what its constructor would give it, less robot and joystick."""
    for name in FOR_REAL_ROBOTS:
        sys.modules.setdefault(name, MagicMock())
    from holosoma_inference.config.config_values import observation, task
    from holosoma_inference.config.config_values import robot as robots
    from holosoma_inference.policies.locomotion import LocomotionPolicy

    policy = object.__new__(LocomotionPolicy)
    seen, body = getattr(observation, f"loco_{robot}_29dof"), getattr(robots, f"{robot}_29dof")
    policy.config = SimpleNamespace(task=task.locomotion)
    policy.obs_dict, policy.obs_dims, policy.obs_scales = seen.obs_dict, seen.obs_dims, seen.obs_scales
    policy.history_length_dict = seen.history_length_dict
    policy.obs_terms_sorted = {group: sorted(names) for group, names in seen.obs_dict.items()}
    policy.obs_history_buffers = {
        group: {name: deque(maxlen=seen.history_length_dict[group]) for name in names}
        for group, names in seen.obs_dict.items()
    }
    policy.num_dofs, policy.default_dof_angles = body.num_joints, np.array(body.default_dof_angles)
    policy.rl_rate, policy.is_standing = task.locomotion.rl_rate, False
    policy.policy_action_scale = task.locomotion.policy_action_scale
    policy._init_command_components()
    policy._init_phase_components()
    policy.last_policy_action = np.zeros((1, policy.num_dofs))
    import onnxruntime

    network = onnxruntime.InferenceSession(path)
    policy.policy = lambda obs: network.run(None, obs)[0]
    return policy


def main() -> None:
    """Run pushed episodes, compare in every decision, print the largest differences."""
    name = sys.argv[1] if len(sys.argv) > 1 else "holosoma-g1-ppo"
    contract = read_contract(name)
    robot = robot_of(contract)
    env = Controls(robot)._env(contract).unwrapped
    ours, joints = Contender(contract, env.episodes), env.episodes.joints
    commands = CommandChange(3.0, Command(0.5, 0.2, 0.3)), CommandChange(6.0, Command())
    scenario = Scenario("pushed", (Push((60.0, 60.0, 0.0), 0.1, 2.0), Push((60.0, -60.0, 0.0), 0.1, 5.0)),
                        changes=commands, duration=9.0)  # fmt: skip
    row, _ = env.reset(options={"scenario": scenario})
    seen: list[np.ndarray] = []
    observe = ours.observe
    ours.observe = lambda *arguments: seen.append(observe(*arguments)) or seen[-1]
    other, state, worst, decisions = theirs(robot, str(contract.network)), None, np.zeros(2), 0
    places = [joints.index(name) if name in joints else None for name in contract.joints]
    rest = contract.get("control.default_joint_pos")
    size = len(joints)
    records, told = [], {}
    while True:
        angles = [rest[name] if i is None else row[13 + i]
                  for name, i in zip(contract.joints, places, strict=True)]  # fmt: skip
        rates = [0.0 if i is None else row[13 + size + i] for i in places]
        data = np.array([[0.0, 0.0, 0.0, *row[:4], *angles, 0.0, 0.0, 0.0, *row[4:7], *rates]])
        other.lin_vel_command[0], other.ang_vel_command[0, 0] = row[10:12], row[12]
        other.update_phase_time()
        before = other.last_policy_action[0].copy()
        action, state = ours.predict(row, state, np.array([state is None]))
        targets = other.rl_inference(data)[0]
        if not told or recorded(row[10:13]) != list(told.values())[-1]:
            told[decisions] = recorded(row[10:13])
        if decisions % EVERY == 0:
            record = {"row": row, "last_action": before, "action": other.last_policy_action[0],
                      "observation": other.obs_buf_dict["actor_obs"][0], "targets": targets}  # fmt: skip
            records.append({"step": decisions} | {key: recorded(value) for key, value in record.items()})
        moved = [i for i, place in enumerate(places) if place is not None]
        own = action[[places[i] for i in moved]] * 2.0 * np.pi
        worst = np.maximum(worst, [np.abs(other.obs_buf_dict["actor_obs"][0] - seen[-1]).max(),
                                   np.abs(own - targets[moved]).max()])  # fmt: skip
        decisions += 1
        row, _, fell, over, _ = env.step(action)
        if fell or over:
            break
    if len(sys.argv) > 2:
        content = {"joints": list(contract.joints), "robot": joints, "commands": told, "decisions": records}
        Path(sys.argv[2]).write_text(json.dumps({robot: content}) + "\n", encoding="utf-8")
    print(f"{name}: {decisions} decisions; largest difference of an observation {worst[0]:.1e}, "
          f"of a target {worst[1]:.1e} rad")  # fmt: skip


if __name__ == "__main__":
    main()
