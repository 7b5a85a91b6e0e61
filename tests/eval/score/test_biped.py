import json

from push_recovery.eval.cli.main import main
from push_recovery.eval.score.evaluate import evaluate
from push_recovery.eval.score.suites import Suite, standard_suite

ENV_ID = "PushRecovery/Biped-v0"
SUITE = Suite("head", "1", standard_suite().scenarios[:3])


def test_workers_and_order_change_nothing(tmp_path):
    names = ["stage-1", "two-stage"]
    alone = evaluate(SUITE, ENV_ID, names, 1, tmp_path / "a")
    many = evaluate(SUITE, ENV_ID, names[::-1], 2, tmp_path / "b")
    assert json.dumps([alone.rows[n] for n in names]) == json.dumps([many.rows[n] for n in names])


def test_bench_has_the_keys_of_the_contract(capsys):
    assert main(["bench", "--seconds", "1", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["raw_physics_rtf"] > 0
    assert content["single_env_rtf"] > 0
    for key in ("stage_1_us", "stage_2_us", "plan_us", "whole_body_us"):
        assert 0 < content[key]["median"] <= content[key]["p99"]
