"""What an episode is worth to a search."""

from types import SimpleNamespace

import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.eval.tuning.scorer import check_env, worth


@pytest.mark.parametrize(
    ("recovered", "survived", "expected"), [(True, True, 1.0), (False, True, 0.5), (False, False, 0.0)]
)
def test_standing_unsettled_is_worth_half(recovered, survived, expected):
    assert worth(SimpleNamespace(recovered=recovered, survived=survived)) == expected  # type: ignore[arg-type]


def test_environments_are_named_with_and_without_their_module():
    assert check_env("push_recovery:PushRecovery/Pendulum-v0") == "PushRecovery/Pendulum-v0"
    with pytest.raises(UnknownNameError, match=r"PushRecovery/Biped-v0"):
        check_env("PushRecovery/G2-v0")
