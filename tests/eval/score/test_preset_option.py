import json
from pathlib import Path

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import PresetFile
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.score.suites import Suite, standard_suite

PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"


@pytest.fixture
def preset(tmp_path):
    path = tmp_path / "tuned.json"
    PresetFile(
        "biped",
        {},
        {"two-stage": {"beta_dcm": 900.0}},
        {"limits": {"duration_max": 0.7}, "gait": {"apex": 0.08}},
    ).save(path)
    return path


def test_an_id_with_a_preset_makes_robot_and_arm_of_the_file(preset):
    env = make_env(f"{BIPED}@{preset}")
    assert env.unwrapped.limits.duration_max == 0.7
    assert env.unwrapped.core.settings.apex == 0.08
    policy = load_policy("two-stage", env)
    assert (policy.config.beta_dcm, policy.limits.duration_max) == (900.0, 0.7)
    assert (
        load_policy("stage-1", env).config.beta_dcm == make_policy("stage-1", preset="biped").config.beta_dcm
    )


def test_rows_of_a_preset_that_has_changed_are_refused(tmp_path, preset, capsys):
    suite, out = str(tmp_path / "suite.json"), str(tmp_path / "out")
    Suite("two", "1", standard_suite().scenarios[:2]).save(Path(suite))
    options = ["evaluate", "--env", PENDULUM, "--policies", "stage-1", "--workers", "1", "--json"]
    options += ["--suite", suite, "--preset", str(preset), "--out", out]
    assert main(options) == 0
    assert json.loads(capsys.readouterr().out)["env"] == f"{PENDULUM}@{preset}"
    assert main(options) == 0
    preset.write_text(preset.read_text().replace("900.0", "901.0"))
    assert main(options) == 2
    assert "differs in: preset_sha256" in capsys.readouterr().err


def test_bad_presets_are_bad_input(tmp_path, capsys):
    assert main(["evaluate", "--preset", "bipd"]) == 2
    assert "unknown preset 'bipd'; did you mean 'biped'?" in capsys.readouterr().err
    assert main(["frontier", "--preset", str(tmp_path / "absent.json")]) == 2
    assert "cannot read preset file" in capsys.readouterr().err
    (tmp_path / "p.json").write_text("{}")
    with pytest.raises(InvalidValueError, match="is no preset file"):
        make_env(f"{PENDULUM}@{tmp_path / 'p.json'}")
