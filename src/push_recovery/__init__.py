"""Push recovery for bipeds: Gymnasium environments, a two-stage planner, and a fair score."""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

register(id="PushRecovery/Pendulum-v0", entry_point="push_recovery.envs.pendulum_env:PendulumEnv")
register(id="PushRecovery/Biped-v0", entry_point="push_recovery.envs.biped_env:BipedEnv")
register(id="PushRecovery/BipedResidual-v0", entry_point="push_recovery.envs.residual:make_biped_residual")
