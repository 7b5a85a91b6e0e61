"""What wrappers make of an action."""

from push_recovery.envs.wrappers import ActionHold, ResidualAction
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import action_rule

PENDULUM = "PushRecovery/Pendulum-v0"


def test_holds_within_holds_multiply():
    rule = action_rule(ActionHold(ActionHold(make_env(PENDULUM), 2), 3))
    assert rule is not None
    assert (rule.hold, rule.residual) == (6, None)


def test_a_residual_within_a_hold_is_found():
    residual = ResidualAction(make_env(PENDULUM), "stage-1")
    rule = action_rule(ActionHold(residual, 2))
    assert rule is not None
    assert (rule.hold, rule.residual) == (2, residual)
    assert rule.env is residual.unwrapped
