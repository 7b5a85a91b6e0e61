import json
import time

import toy_gait_env as toy
from push_recovery.eval.bench import CALLS, WARM_UP, summary, time_calls
from push_recovery.eval.cli import main


def test_summary():
    assert summary(range(1, 101)) == {"median": 50.5, "p99": 99.01}


def test_calls_are_counted_and_timed():
    calls = []

    def wait(argument):
        calls.append(argument)
        if len(calls) > WARM_UP and len(calls) % 2:
            time.sleep(20e-6)

    timing = time_calls(wait, [1, 2, 3])
    assert len(calls) == WARM_UP + CALLS
    assert calls[:4] == [1, 2, 3, 1]
    assert timing["p99"] > 20.0


def test_bench_leaves_out_what_the_environment_lacks(capsys):
    assert main(["bench", "--env", "toy_gait_env:PushRecovery/SturdyToy-v0", "--seconds", "2", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert "raw_physics_rtf" not in content
    assert content["threads"] == 1
    assert content["single_env_rtf"] > 0
    for key in ("stage_1_us", "stage_2_us", "plan_us"):
        assert 0 < content[key]["median"] <= content[key]["p99"]


def test_a_robot_that_falls_is_no_bench(capsys):
    assert main(["bench", "--env", toy.ENV_ID, "--seconds", "2", "--json"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "fell after" in err
