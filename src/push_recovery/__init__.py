"""Push recovery for bipeds: Gymnasium environments, a two-stage planner, and a fair score."""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

register(
    id="PushRecovery/Pendulum-v0",
    entry_point="push_recovery.envs.pendulum.env:PendulumEnv",
    vector_entry_point="push_recovery.envs.pendulum.env:make_pendulum_vector",
)
register(
    id="PushRecovery/Biped-v0",
    entry_point="push_recovery.envs.biped.env:BipedEnv",
    vector_entry_point="push_recovery.envs.biped.env:make_biped_vector",
)
register(
    id="PushRecovery/BipedResidual-v0",
    entry_point="push_recovery.envs.residual.wrapper:make_biped_residual",
    vector_entry_point="push_recovery.envs.residual.vector_env:make_biped_residual_vector",
)
