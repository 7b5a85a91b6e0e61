"""Options of the physics as values: JSON, bounds, and that the default is what there always was."""

import re

import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.envs.scenario.model_errors import CONTROL_STEP, PLAIN_PHYSICS, PhysicsOptions
from push_recovery.envs.scenario.scenario import Scenario

FINE = PhysicsOptions(
    time_step=0.0005, integrator="rk4", solver="cg", cone="elliptic", impratio=10.0, contact_time=0.02
)


def test_the_default_is_one_step_of_physics_in_one_of_control():
    assert PLAIN_PHYSICS.time_step == CONTROL_STEP
    assert PLAIN_PHYSICS.steps == 1
    assert PLAIN_PHYSICS.to_dict() == {}
    assert "physics" not in Scenario("a").to_dict()
    assert Scenario.from_dict({"id": "a", "physics": {}}) == Scenario("a")


def test_json_round_trip_names_only_what_differs():
    scenario = Scenario("a", physics=FINE)
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert scenario.mirrored().physics == FINE
    assert PhysicsOptions(cone="pyramidal").to_dict() == {"cone": "pyramidal"}  # said, not assumed


@pytest.mark.parametrize(
    ("time_step", "steps"), [(0.002, 1), (0.001, 2), (0.0005, 4), (0.002 / 3, 3), (1e-4, 20)]
)
def test_a_step_of_control_holds_a_whole_number_of_steps(time_step, steps):
    assert PhysicsOptions(time_step=time_step).steps == steps


@pytest.mark.parametrize("time_step", [0.0015, 0.003, 0.004, 1e-5])
def test_no_other_time_step_is_taken(time_step):
    with pytest.raises(InvalidValueError, match="time_step"):
        PhysicsOptions(time_step=time_step)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"impratio": 0.0}, "PhysicsOptions.impratio must be in [0.1, 1000], got 0"),
        ({"contact_time": 1.0}, "PhysicsOptions.contact_time [s] must be in [0.0001, 0.2], got 1"),
        ({"cone": "eliptic"}, "did you mean 'elliptic'"),
        ({"integrator": 4}, "integrator"),
        ({"time_step": "fast"}, "time_step [s] must be a number"),
    ],
)
def test_bad_values_name_the_bound(values, text):
    with pytest.raises(PushRecoveryError, match=re.escape(text)):
        PhysicsOptions(**values)


def test_a_scenario_takes_options_only():
    with pytest.raises(UnknownNameError, match="did you mean 'impratio'"):
        Scenario.from_dict({"id": "a", "physics": {"imratio": 3}})
    with pytest.raises(InvalidValueError, match=re.escape("Scenario.physics must be a PhysicsOptions")):
        Scenario("a", physics={"impratio": 3})  # type: ignore[arg-type]
