import math

import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario

TURN = Command(0.3, turn=0.2)
CHANGES = (CommandChange(2.0, Command(0.3, 0.1)), CommandChange(3.5, Command()))
PUSH = Push((10.0, 0.0, 0.0), 0.1, 1.0)


def test_json_round_trip_is_exact_and_has_no_key_without_changes():
    scenario = Scenario("a", (PUSH,), Command(0.1), changes=CHANGES)
    text = scenario.to_json()
    assert Scenario.from_json(text) == scenario
    assert Scenario.from_json(text).to_json() == text
    assert "changes" not in Scenario("a", (PUSH,), Command(0.1)).to_dict()
    assert Command.from_dict(TURN.to_dict()) == TURN
    assert set(Command(0.1).to_dict()) == {"vx", "vy"}


def test_mirror_is_an_involution():
    scenario = Scenario("a", changes=CHANGES)
    mirrored = scenario.mirrored()
    assert mirrored.changes == (
        CommandChange(2.0, Command(0.3, -0.1)),
        CommandChange(3.5, Command(0.0, -0.0)),
    )
    assert mirrored.mirrored() == scenario
    assert TURN.mirrored() == Command(0.3, turn=-0.2)


def test_an_episode_waits_for_the_last_change():
    assert Scenario("a", (PUSH,), changes=CHANGES).end_time(1.1) == 7.5
    assert Scenario("a", (PUSH,), changes=CHANGES).end_time(5.0) == 9.0
    assert Scenario("a", changes=CHANGES, duration=3.0).end_time(0.0) == 3.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Command(turn=0.61), r"Command.turn \[rad/s\] must be in \[-0.6, 0.6\], got 0.61"),
        (lambda: CommandChange(0.0, Command()), r"CommandChange.time \[s\] must be in \(0, inf\], got 0"),
        (lambda: CommandChange(math.inf, Command()), "must be finite, got inf"),
        (lambda: CommandChange(1.0, 0.3), "CommandChange.command must be a Command, got 0.3"),  # type: ignore[arg-type]
        (lambda: Scenario("a", changes=(PUSH,)), "must hold CommandChange objects, got Push"),  # type: ignore[arg-type]
        (lambda: Scenario("a", changes=CHANGES[::-1]), "must rise in time, got 2 s after 3.5 s"),
        (lambda: Scenario.from_dict({"id": "a", "changes": 3}), "scenario changes must be a list, got 3"),
    ],
)
def test_an_impossible_change_is_refused(make, message):
    with pytest.raises(InvalidValueError, match=message):
        make()


def test_an_unknown_key_is_refused():
    with pytest.raises(PushRecoveryError, match="speed"):
        Scenario.from_dict({"id": "a", "changes": [{"time": 1.0, "command": {}, "speed": 2}]})
