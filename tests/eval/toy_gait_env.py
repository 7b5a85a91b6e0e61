"""A toy with the interface of the gait environments: a point that a push moves and the action pulls back."""

import gymnasium as gym
import numpy as np
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.observation import COMMAND, DCM, ELAPSED, OBSERVATION_SIZE
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.envs.scenario.arrays import Pushes, assign_pushes, empty_pushes, mean_force, resolve_starts
from push_recovery.envs.scenario.distribution import PushDistribution

STEP = 0.65
ENV_ID = "toy_gait_env:PushRecovery/Toy-v0"


class ToyEnv(gym.Env):
    dt = 0.05
    observation_space = gym.spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,), np.float64)
    action_space = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(self, render_mode=None, fall=0.15):
        self.fall = fall  # [m]
        self.robot, self.limits, self.preset = RobotModel(), GaitLimits(), "default"
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.scenario = (options or {}).get("scenario") or PushDistribution().sample(self.np_random)
        pushes = assign_pushes(empty_pushes(1, len(self.scenario.pushes)), 0, self.scenario)
        self.pushes = Pushes(*(field[0] for field in pushes))
        self.position, self.velocity, self.tick = np.zeros(2), np.zeros(2), 0
        return self._observation(), {}

    def _observation(self):
        out = np.zeros(OBSERVATION_SIZE)
        out[ELAPSED] = self.tick * self.dt % STEP
        out[DCM] = self.position + self.velocity / self.robot.omega
        out[COMMAND] = self.scenario.command.vx, self.scenario.command.vy
        return out

    def step(self, action):
        t0, t1 = self.tick * self.dt, (self.tick + 1) * self.dt
        index = int(t0 / STEP + 1e-9)
        p, force, total = self.pushes, np.zeros(3), np.zeros(3)
        resolve_starts(p.start, p.step, p.fraction, index, index * STEP, STEP, t0, t1)
        for i in range(len(p.start)):
            mean_force(p.force, p.duration, p.start, i, t0, t1, force)
            total += force
        pull = 4.0 * np.asarray(action, dtype=np.float64)[:2] - 2.0 * self.velocity
        self.velocity += self.dt * (total[:2] / self.robot.mass + pull)
        self.position += self.dt * self.velocity
        self.tick += 1
        fell = bool(np.abs(self.position).max() > self.fall)
        end = self.scenario.end_time(max((p.start + p.duration).tolist(), default=0.0))
        calm = bool(np.abs(self.position).max() < 0.05)
        reason = ("forward" if abs(self.position[0]) > self.fall else "sideways") if fell else None
        info = {"failure_reason": reason, "recovered_at": t1 if calm else None, "time": t1}
        return self._observation(), 1.0, fell, bool(not fell and t1 >= end - 1e-9), info

    def render(self):
        return np.full((32, 48, 3), min(255, self.tick), dtype=np.uint8)


def save_policy(path, gain, inputs=OBSERVATION_SIZE):
    """A linear policy action[0:2] = -gain * dcm, as a policy file."""
    weight = np.zeros((7, inputs), dtype=np.float32)
    weight[0, DCM.start] = weight[1, DCM.start + 1] = -gain
    network = Mlp((weight,), (np.zeros(7, dtype=np.float32),))
    about = PolicyDescription("PushRecovery/Toy-v0", RobotModel(), GaitLimits())
    NetworkPolicy(network, Normalisation(np.zeros(inputs), np.ones(inputs)), about).save(path)
    return str(path)


if "PushRecovery/Toy-v0" not in gym.registry:
    gym.register("PushRecovery/Toy-v0", entry_point=f"{__name__}:ToyEnv")
    gym.register("PushRecovery/SturdyToy-v0", entry_point=f"{__name__}:ToyEnv", kwargs={"fall": np.inf})
