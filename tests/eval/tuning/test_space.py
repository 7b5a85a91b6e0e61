from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import TwoStagePolicy, make_policy
from push_recovery.controllers.settings import PlannerConfig, preset_config
from push_recovery.envs.biped.core import SECTIONS, BipedSettings
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.tuning import space
from push_recovery.eval.tuning.space import (
    ROBOT,
    TUNED,
    Dimension,
    Space,
    planner_dimensions,
    robot_dimensions,
    select,
)

LINEAR = Dimension("a", "x", 0.0, 1.0, 0.1)
LOG = Dimension("b", "y", 1.0, 100.0, 2.0, "log")
SPACE = Space((LINEAR, LOG), (0.5, 10.0))
START = {"planner": asdict(preset_config("biped")), **BipedSettings().to_dict()}
PLANNER = {d.name: d for variant in TUNED for d in planner_dimensions(variant)}


def test_units_are_differences_and_factors():
    assert SPACE.settings([0.0, 0.0]) == {"a": {"x": 0.5}, "b": {"y": 10.0}}
    assert SPACE.settings([2.0, -3.0]) == {"a": {"x": 0.7}, "b": {"y": 1.25}}
    assert SPACE.settings([9.0, 9.0]) == {"a": {"x": 1.0}, "b": {"y": 100.0}}
    np.testing.assert_allclose(SPACE.bounds, [[-5.0, 5.0], [-np.log2(10.0), np.log2(10.0)]])


def test_point_and_settings_are_inverse_within_rounding():
    space = Space.at((*PLANNER.values(), *ROBOT), START)
    low, high = space.bounds.T
    assert (low <= 0).all()
    assert (high >= 0).all()
    rng = np.random.default_rng(0)
    for _ in range(20):
        settings = space.settings(rng.uniform(np.maximum(low, -3), np.minimum(high, 3)))
        assert space.settings(space.point(settings)) == settings


def test_every_dimension_is_a_field_and_none_comes_twice():
    planner = {entry.name for entry in fields(PlannerConfig)}
    for dimension in (*PLANNER.values(), *ROBOT):
        group = dimension.group
        assert dimension.name in (planner if group == "planner" else SECTIONS[group])
    for variant in TUNED:
        labels = [d.label for d in (*planner_dimensions(variant), *ROBOT)]
        assert len(set(labels)) == len(labels)


def test_start_outside_its_bounds_is_refused():
    with pytest.raises(InvalidValueError, match=r"^a\.x must start in \[0, 1\], got 2$"):
        Space((LINEAR,), (2.0,))


def test_selection_by_group_and_field():
    both = (LINEAR, LOG)
    assert select(both, ()) == both
    assert select(both, ["b"]) == (LOG,)
    assert select(both, ["a.x"]) == (LINEAR,)
    with pytest.raises(UnknownNameError, match=r"unknown field to tune 'a\.z'.*\(valid: a, b, a\.x, b\.y\)"):
        select(both, ["a.z"])


@pytest.fixture(scope="module")
def observations():
    """What a pendulum sees while it is pushed hard, near the limit of its trunk too."""
    episodes = PendulumEpisodes(3)
    for k, (force, psi) in enumerate(((800.0, 0.3), (340.0, 1.6), (180.0, 3.0))):
        push = polar_push(force, psi, 0.1, GaitEvent(2, "left", 0.2))
        episodes.begin(k, Scenario(f"s{k}", (push,), Command(0.2)))
    policy = make_policy("two-stage")
    seen = []
    for _ in range(300):
        seen.append(episodes.core.observation.copy())
        episodes.step(policy.predict(seen[-1])[0])
    return np.concatenate(seen)


@pytest.mark.parametrize("variant", TUNED)
def test_a_variant_is_tuned_in_all_that_it_uses_and_in_nothing_else(variant, observations):
    """A field belongs to the space of a variant exactly if some action depends on it."""
    policy = make_policy(variant)
    assert isinstance(policy, TwoStagePolicy)
    base = replace(policy.config, beta_trunk_limit=10.0)  # low enough to show at what was seen
    actions = TwoStagePolicy(config=base).predict(observations)[0]
    used = {d.name for d in planner_dimensions(variant)}
    for name, dimension in PLANNER.items():
        start = float(getattr(base, name))
        config = replace(base, **{name: dimension.value(3.0 if start < dimension.high else -3.0, start)})
        differs = not np.array_equal(TwoStagePolicy(config=config).predict(observations)[0], actions)
        assert differs == (name in used), name


def test_variants_without_gains_are_refused():
    assert set(space.TRUNK) <= set(planner_dimensions("two-stage"))
    assert set(space.UPRIGHT) <= set(planner_dimensions("stage-1"))
    message = r"unknown policy to tune 'passive' \(valid: raibert, herdt, fixed-time, stage-1, stage-1\+cop"
    with pytest.raises(UnknownNameError, match=message):
        planner_dimensions("passive")


@pytest.mark.parametrize("policy", ["raibert", "fixed-time", "herdt"])
def test_a_step_time_that_is_fixed_is_searched_down_to_the_shortest_step(policy):
    fields = {d.name: d for d in robot_dimensions(policy)}
    assert "duration_min" not in fields
    assert fields["duration_max"].low == 0.12
    assert fields["duration_max"].unit == 0.01
    moved = {d.name: d for d in robot_dimensions("two-stage")}
    assert (moved["duration_min"].low, moved["duration_max"].low) == (0.08, 0.4)
    assert fields.keys() == moved.keys() - {"duration_min"}
