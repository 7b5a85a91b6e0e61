"""The sample, its variations, and tables of rows written by hand."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import EXACT, HARDWARE, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.environments import profile_on
from push_recovery.eval.score import sensitivity as varying
from push_recovery.eval.score.suites import Suite, get_suite

CALM = Suite("calm", "1", tuple(Scenario(f"c{i}", (polar_push(100.0, i, 0.1, 0.2),)) for i in range(5)))


def test_one_thing_is_varied_at_a_time():
    assert next(iter(varying.VARIATIONS)) == "exact"
    names = {"exact", "onboard", "hardware", *dict(varying.NUMERICS), *dict(varying.MODEL_ERRORS)}
    assert len(varying.VARIATIONS) == len(varying.NUMERICS) + len(varying.MODEL_ERRORS) + 3 == len(names)
    exact = [name for name, profile in varying.VARIATIONS.items() if profile.sensing == "exact"]
    assert exact == [name for name in varying.VARIATIONS if name not in {"onboard", "hardware"}]
    assert replace(varying.VARIATIONS["onboard"], name="exact", sensing="exact") == EXACT
    for name, _ in varying.NUMERICS:
        assert varying.VARIATIONS[name].errors == EXACT.errors
        assert varying.VARIATIONS[name].physics != EXACT.physics
    for name, _ in varying.MODEL_ERRORS:
        assert len(varying.VARIATIONS[name].errors.names) == 1
        assert varying.VARIATIONS[name].physics == EXACT.physics
    assert varying.VARIATIONS["hardware"] is HARDWARE


def test_a_sample_is_spread_over_the_suite():
    hard = get_suite("hard")
    assert varying.sample_of(hard, 128).scenarios == hard.scenarios[::8]
    assert varying.sample_of(hard, 1024).scenarios == hard.scenarios
    assert [s.id for s in varying.sample_of(CALM, 3).scenarios] == ["c0", "c1", "c3"]
    for bad in (0, 6, 2.5):
        with pytest.raises(InvalidValueError, match=r"sample must be an integer in \[1, 5\]"):
            varying.sample_of(CALM, bad)


def test_every_variation_has_all_pushes_under_ids_of_its_own():
    suite = varying.varied_by(CALM, ["exact", "floor-0.6", "step-1ms"])
    assert [s.id for s in suite.scenarios[4:7]] == ["c4/exact", "c0/floor-0.6", "c1/floor-0.6"]
    assert [s.pushes for s in suite.scenarios] == 3 * [s.pushes for s in CALM.scenarios]
    assert {s.errors for s in suite.scenarios[5:10]} == {ModelErrors(friction=0.6)}
    assert {s.physics.time_step for s in suite.scenarios[10:]} == {0.001}
    with pytest.raises(UnknownNameError, match=r"did you mean 'floor-0\.6'"):
        varying.varied_by(CALM, ["exact", "floor-06"])
    for bad in (["floor-0.6"], ["exact", "cg", "cg"]):
        with pytest.raises(InvalidValueError, match="distinct and begin with 'exact'"):
            varying.varied_by(CALM, bad)


@pytest.fixture
def written(evaluation):
    """Five pushes: exact recovers 3 of 4 survived; the variation loses two of them and gains one."""
    return varying.Sensitivity(CALM, 5, ("exact", "cg"), evaluation({"p": "rrrsf" + "rsfrs"}))


def test_what_is_lost_and_gained(written):
    exact, varied = written.changes("p")
    assert (exact.score.recovered, exact.score.survived) == (3, 4)
    assert (varied.score.recovered, varied.score.survived) == (2, 4)
    told = varied.to_dict()
    assert (told["lost"], told["gained"], told["survived_lost"], told["survived_gained"]) == (2, 1, 1, 1)
    assert told["rate_difference"] == pytest.approx(-0.2)
    assert told["mcnemar_p"] == 1.0  # 2 : 1
    assert told["ci95"][0] < -0.2 < told["ci95"][1]


def test_the_table_and_the_report(written):
    (table,) = varying.sensitivity_tables(written)
    cells = table.rows
    assert len(cells[0]) == len(table.columns)
    assert cells[0] == ("exact", "3", "4", "0", "0", "-", "-")
    assert cells[1][:5] == ("cg", "2", "4", "2", "1")
    assert cells[1][5].startswith("-0.200 (")
    path = varying.write_sensitivity_reports(written)
    assert "| cg | 2 | 4 | 2 | 1 | -0.200 (" in path.read_text()
    report = json.loads((path.parent / "report.json").read_text())
    assert report["policies"]["p"]["cg"]["lost"] == 2
    assert report["sample"] == 5


def test_a_run_goes_on_where_it_stopped(tmp_path):
    """Few rows first, as after a kill: the second run keeps them and ends with the same numbers."""
    arguments = CALM, 2, "PushRecovery/Biped-v0", "stage-1", ["armature-0.05", "step-1ms"]
    whole = varying.sensitivity(*arguments, directory=tmp_path / "a")
    assert whole.variations == ("exact", "armature-0.05", "step-1ms")
    lines = (tmp_path / "a" / "outcomes.jsonl").read_text().splitlines(keepends=True)
    assert len(lines) == 6
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "config.json").write_bytes((tmp_path / "a" / "config.json").read_bytes())
    (tmp_path / "b" / "outcomes.jsonl").write_text("".join(lines[:3]) + lines[3][:20])
    again = varying.sensitivity(*arguments, directory=tmp_path / "b")
    assert again.evaluation.rows == whole.evaluation.rows
    rewards = np.array([row["total_reward"] for row in whole.evaluation.rows["stage-1"]]).reshape(3, 2)
    assert (rewards[0] != rewards[1:]).all()  # the robots were not the same


def test_the_command(tmp_path, capsys):
    CALM.save(tmp_path / "calm.json")
    suite = ["--suite", str(tmp_path / "calm.json"), "--workers", "1"]
    argv = ["sensitivity", *suite, "--sample", "1", "--variations", "cg", "--policies", "stage-1"]
    out = ["--out", str(tmp_path / "out")]
    assert main([*argv, *out, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["policies"]["stage-1"]) == ["exact", "cg"]
    assert told["policies"]["stage-1"]["cg"]["episodes"] == 1
    assert main([*argv, *out]) == 0
    assert "1 pushes of suite calm" in capsys.readouterr().out
    assert main(["sensitivity", *suite, "--sample", "9"]) == 2
    assert "sample must be an integer in [1, 5], got 9" in capsys.readouterr().err
    assert main(["sensitivity", *suite, "--variations", "rk5", "--sample", "1"]) == 2
    assert "did you mean 'rk4'" in capsys.readouterr().err


def test_hardware_is_that_of_the_robot():
    """Its friction is 1 N m on 60 kg of 0.8 m height, and less on a G1."""
    env_id = "PushRecovery/G1-v0"
    suite = varying.varied_by(CALM, ["exact", "hardware"], env_id)
    errors = {scenario.errors.joint_friction for scenario in suite.scenarios if "/hardware" in scenario.id}
    assert errors == {profile_on(env_id, "hardware").errors.joint_friction}
    assert 0.3 < errors.pop() < 0.5


def test_a_variation_is_as_large_as_its_name_says():
    sizes = {}
    for name, one in (*varying.NUMERICS, *varying.MODEL_ERRORS):
        if number := re.search(r"-([\d.]+)(ms|kW)?$", name):
            size = float(number[1]) * {"ms": 1e-3, "kW": 1e3, None: 1.0}[number[2]]
            sizes[name] = size, [value for value in one.to_dict().values() if not isinstance(value, str)]
    assert len(sizes) == 20
    for name, (size, values) in sizes.items():
        assert values == pytest.approx([size]), name


def test_the_interval_of_a_variation_is_newcombes_low_end_first(evaluation):
    """Newcombe (1998), both 36, 12 lost, 2 gained: 0.0569 to 0.3404 the other way round."""
    letters = "r" * 48 + "f" * 2 + "r" * 36 + "f" * 12 + "r" * 2
    found = varying.Sensitivity(CALM, 50, ("exact", "cg"), evaluation({"p": letters}))
    (table,) = varying.sensitivity_tables(found)
    assert table.rows[1][:6] == ("cg", "38", "38", "12", "2", "-0.200 (-0.340 to -0.057)")


def test_survivals_lost_and_gained_are_not_exchanged(evaluation):
    """The exact robot survives all three pushes, the varied one only the first."""
    found = varying.Sensitivity(CALM, 3, ("exact", "cg"), evaluation({"p": "rrr" + "rff"}))
    changes = found.changes("p")[1].to_dict()
    assert (changes["survived_lost"], changes["survived_gained"]) == (2, 0)


def test_a_variation_of_the_numerics_is_the_one_that_its_name_says():
    def of(**changes):
        return replace(EXACT.physics, **changes)

    wanted = {name: of(integrator=name) for name in ("euler", "implicit", "rk4")}
    wanted |= {name: of(solver=name) for name in ("cg", "pgs")}
    wanted |= {
        "rk4-0.5ms": of(time_step=0.0005, integrator="rk4"), "elliptic": of(cone="elliptic"),
        "elliptic-impratio-10": of(cone="elliptic", impratio=10.0),
        "fine": of(time_step=0.0005, cone="elliptic", impratio=10.0, contact_time=0.004),
    }  # fmt: skip
    assert {name: varying.VARIATIONS[name].physics for name in wanted} == wanted


def test_no_variation_is_named_twice():
    message = "variations must be distinct and begin with 'exact', got exact, exact"
    with pytest.raises(InvalidValueError, match=f"^{message}$"):
        varying.sensitivity(CALM, 3, "PushRecovery/Pendulum-v0", "stage-1", ("exact", "exact"))
