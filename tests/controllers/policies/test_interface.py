import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.interface import PlainPolicy, action_and_state, as_policy
from push_recovery.controllers.policies.two_stage import make_policy

ACTION = np.ones(7, np.float32)


class Bare:
    def predict(self, observation):
        return ACTION


class Remembering:
    def predict(self, observation, state=None, episode_start=None):
        return ACTION, (state, episode_start)


class Keywords:
    def predict(self, obs, **known):
        return ACTION, known


class Whole:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return ACTION, state


class Starting(Whole):
    begun = 0

    def reset(self):
        self.begun += 1


def test_a_policy_gets_what_its_signature_takes():
    action, state = as_policy(Bare()).predict(0, 1, 2, False)
    assert action is ACTION
    assert state is None
    assert as_policy(Remembering()).predict(0, 1, 2, False)[1] == (1, 2)
    assert as_policy(Keywords()).predict(0, state=1, episode_start=2, deterministic=False)[1] == {
        "state": 1,
        "episode_start": 2,
        "deterministic": False,
    }


def test_a_policy_of_the_whole_signature_is_itself():
    for policy in (Whole(), make_policy("two-stage")):
        assert as_policy(policy) is policy


def test_a_reset_without_a_seed_is_called_without():
    policy = Starting()
    plain = as_policy(policy)
    assert isinstance(plain, PlainPolicy)
    plain.reset(seed=3)
    assert policy.begun == 1
    as_policy(Bare()).reset(seed=3)


@pytest.mark.parametrize("policy", [3, None, "two-stage", Whole, object()])
def test_what_has_no_predict_is_refused(policy):
    with pytest.raises(InvalidValueError, match=r"a method predict\(observation"):
        as_policy(policy)


def test_what_is_known_of_a_plain_policy_is_what_the_policy_below_says():
    class Planning(Bare):
        config, statuses = "the planner's", ("solved",)

    assert (as_policy(Planning()).config, as_policy(Planning()).statuses) == ("the planner's", ("solved",))
    assert (as_policy(Bare()).config, as_policy(Bare()).statuses) == (None, ())


def test_a_plain_policy_begins_scenarios_where_the_policy_below_does():
    class Told(Bare):
        def begin_scenario(self, scenario):
            self.begun = scenario

    policy = Told()
    as_policy(policy).begin_scenario("a")
    assert policy.begun == "a"
    assert not hasattr(as_policy(Bare()), "begin_scenario")


def test_what_predict_gives_is_an_action_with_or_without_a_state():
    two = np.zeros((2, 7))
    for found in (two, (0.1,) * 7, [1.0, 2.0]):
        assert action_and_state(found)[0] is found
        assert action_and_state(found)[1] is None
    assert action_and_state((two, "state"))[0] is two
    assert action_and_state((two, "state"))[1] == "state"


def test_a_tuple_of_seven_numbers_is_an_action_and_one_of_two_an_action_with_a_state():
    class Says:
        def __init__(self, found):
            self.found = found

        def predict(self, observation):
            return self.found

    seven = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    assert PlainPolicy(Says(seven)).predict(None) == (seven, None)
    assert PlainPolicy(Says((seven, "state"))).predict(None) == (seven, "state")
    assert PlainPolicy(Says([1.0, 2.0])).predict(None) == ([1.0, 2.0], None)


def test_a_reset_that_takes_a_seed_gets_it():
    class Seeded(Bare):
        def reset(self, seed=None):
            self.seed = seed

    policy = Seeded()
    plain = as_policy(policy)
    assert isinstance(plain, PlainPolicy)
    plain.reset(seed=3)
    assert policy.seed == 3
