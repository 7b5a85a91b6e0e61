import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import PresetFile
from push_recovery.envs.biped.core import BIPED_LIMITS, SECTIONS, BipedSettings, biped_settings
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario


def preset(path, **sections):
    PresetFile("biped", {}, {}, sections).save(path)
    return str(path)


def walk(episodes, periods=60):
    """Observations of a pushed robot under the two-stage planner."""
    episodes.begin(0, Scenario("push", (polar_push(150.0, 2.0, 0.1, 0.1),)))
    policy = make_policy("two-stage", episodes.robot, BIPED_LIMITS, "biped")
    seen = []
    for _ in range(periods):
        seen.append(episodes.core.observation[0].copy())
        episodes.step(policy.predict(seen[-1])[0][None])
    return np.array(seen)


def test_changes_take_hold_and_leave_the_rest():
    changed = BipedSettings().changed({"gains": {"swing_kp": 1.0}, "limits": {"length_max": 0.3}})
    before, after = BipedSettings().to_dict(), changed.to_dict()
    assert after["gains"].pop("swing_kp") == 1.0
    assert after["limits"].pop("length_max") == 0.3
    assert before["gains"].pop("swing_kp") != 1.0
    before["limits"].pop("length_max")
    assert after == before
    assert BipedSettings().changed(BipedSettings().to_dict()) == BipedSettings()


def test_without_changes_the_robot_is_that_of_the_environment(tmp_path):
    plain = walk(BipedEpisodes(1))
    assert np.array_equal(walk(BipedEpisodes(1)), plain)
    everything = preset(tmp_path / "all.json", **BipedSettings().to_dict())
    assert np.array_equal(walk(BipedEpisodes(1, everything)), plain)


@pytest.mark.parametrize(
    ("section", "field", "value"),
    [("gait", "apex", 0.1), ("gains", "swing_kp", 200.0), ("bounds", "cop_x_max", 0.03)],
)
def test_a_change_reaches_the_robot(tmp_path, section, field, value):
    changed = BipedEpisodes(1, preset(tmp_path / "one.json", **{section: {field: value}}))
    assert not np.array_equal(walk(changed, 30), walk(BipedEpisodes(1), 30))


def test_limits_are_the_action_box_and_the_nominal_gait(tmp_path):
    episodes = BipedEpisodes(1, preset(tmp_path / "box.json", limits={"duration_max": 0.7}))
    assert episodes.limits.duration_max == 0.7
    assert episodes.nominal(0.0, 0.0).duration > BipedEpisodes(1).nominal(0.0, 0.0).duration
    lowest, highest = episodes.gaits(np.array([[-1.0] * 7, [1.0] * 7], np.float32))
    assert (lowest[2], highest[2]) == (BIPED_LIMITS.duration_min, 0.7)


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"gain": {}}, r"^unknown section of the biped's settings 'gain'; did you mean 'gains'\?"),
        ({"gains": {"swing": 1.0}}, r"^unknown field of the biped's gains 'swing'"),
        ({"gait": {"mass": 1.0}}, r"^unknown field of the biped's gait 'mass'"),
        ({"gait": {"apex": "high"}}, r"^apex of the biped's gait must be finite and >= 0, got 'high'$"),
        ({"gains": {"swing_kp": -1.0}}, r"^swing_kp of the biped's gains must be finite and >= 0, got -1.0$"),
        ({"limits": {"length_max": -1.0}}, r"^GaitLimits.length_min must be below length_max"),
    ],
)
def test_bad_settings_are_refused(tmp_path, sections, message):
    with pytest.raises((InvalidValueError, UnknownNameError), match=message):
        biped_settings(preset(tmp_path / "bad.json", **sections))


def test_sections_are_plain_json():
    assert set(SECTIONS) == set(json.loads(json.dumps(BipedSettings().to_dict())))
