import json
from types import SimpleNamespace

import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.settings import PresetFile
from push_recovery.eval.bench import GROUPS, KEYS, closed_loop
from push_recovery.eval.bench import run as module
from push_recovery.eval.bench.run import BenchError, key_cells, robot_cells, solver_cells, start_time
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.environments import make_env


def test_bench_leaves_out_what_the_environment_lacks(capsys):
    assert main(["bench", "--env", "toy_gait_env:PushRecovery/SturdyToy-v0", "--seconds", "2", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert "raw_physics_rtf" not in content
    assert "solvers_missing" not in content
    assert content["threads"] == 1
    assert content["single_env_rtf"] > 0
    for key in ("stage_1_us", "stage_2_us", "plan_us"):
        assert 0 < content[key]["median"] <= content[key]["p99"]
    assert all(content[f"{part}_batch_us"] > 0 for part in ("stage_1", "stage_2", "plan"))


def test_a_robot_that_falls_is_no_bench(capsys):
    assert main(["bench", "--env", toy.ENV_ID, "--seconds", "2", "--json"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "fell after" in err


def test_the_start_is_that_of_a_new_process(monkeypatch):
    monkeypatch.setattr(module, "START", "import sys; sys.exit({env!r} != 'push_recovery:A-v0')")
    assert start_time("A-v0") > 0.0
    with pytest.raises(BenchError, match="B-v0 did not start"):
        start_time("B-v0")
    monkeypatch.setattr(module, "START", "{env}; raise SystemExit('why it did not')")
    with pytest.raises(BenchError, match="why it did not"):
        start_time("sys:1")


CONTENT = {
    "env": "E", "single_env_rtf": 60.1234, "threads": 2, "stage_1_us": {"median": 1.0, "p99": 2.0},
    "stage_2_us": {"median": 3.0, "p99": 4.0}, "period_us_16_robots_2_threads": 59.6,
    "rtf_16_robots_2_threads": 167.8, "cost_over_physics_16_robots_2_threads": 1.618,
    "solvers_missing": ["proxqp"], "stage_1_daqp_us": {"median": 5.0, "p99": 6.0},
    "stage_2_daqp_us": {"median": 7.0, "p99": 8.0}, "stage_2_daqp_error_m": 2e-15,
    "stage_2_daqp_c_us": {"median": 6.0, "p99": 7.0}, "stage_1_batch_us": 0.25,
}  # fmt: skip


def test_tables():
    assert robot_cells(CONTENT) == [("16", "2", "60", "168", "1.62")]
    assert solver_cells(CONTENT) == [
        ("this planner", "1.00 (p99 2.00)", "3.00 (p99 4.00)", "-"),
        ("daqp", "5.00 (p99 6.00)", "7.00 (p99 8.00)", "2e-15 m"),
        ("proxqp", "not installed", "pip install proxsuite", "-"),
    ]
    cells = {key: value for key, value, _ in key_cells(CONTENT)}
    assert cells["single_env_rtf"] == "60.1"
    assert cells["stage_1_batch_us"] == "0.25"
    assert solver_cells({"env": "E"}) == robot_cells({"env": "E"}) == []


def test_help_names_every_key(capsys):
    assert main(["bench", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(key in text for key in (KEYS | GROUPS))


def test_the_real_time_factor_is_of_the_timed_part_alone(monkeypatch):
    """One second after the warm-up, which takes two seconds by the clock."""
    times = iter([10.0, 12.0])
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: next(times)))
    rtf, observations = module.closed_loop(make_env("PushRecovery/Pendulum-v0"), 1.0)
    assert rtf == pytest.approx(0.5)
    assert observations.shape == (200, 36)  # with the warm-up's 100


def test_what_is_timed_on_the_biped_alone_is_of_no_other_robot(monkeypatch, tmp_path):
    PresetFile("biped", biped={"limits": {"length_max": 0.4}}).save(tmp_path / "own.json")
    for part in ("memory_per_robot", "time_control", "batch_timings"):
        monkeypatch.setattr(closed_loop, part, lambda *_: {"of": "the biped"})
    monkeypatch.setattr(module, "closed_loop", lambda *_: (1.0, np.zeros((1, 36))))
    monkeypatch.setattr(module.planner, "pushed_observations", lambda *_: np.zeros((1, 36)))
    for part in ("planner_timings", "batch_planner_timings"):
        monkeypatch.setattr(module.planner, part, lambda *_: {})
    for env_id, own in (
        ("PushRecovery/Biped-v0", True),
        (f"PushRecovery/Biped-v0@{tmp_path / 'own.json'}", False),
    ):
        assert ("of" in module._measured(make_env(env_id), env_id, 0.1)) == own


def test_the_start_is_that_of_the_preset_or_robot(monkeypatch):
    asked = []
    monkeypatch.setattr(module, "_measured", lambda *_: {})
    monkeypatch.setattr(module, "start_time", lambda name, **options: asked.append((name, options)) or 1.0)
    module.bench("PushRecovery/Pendulum-v0@default", 20.0)
    module.bench("PushRecovery/Pendulum-v0", 20.0)
    assert asked == [("PushRecovery/Pendulum-v0", {"preset": "default"}),
                     ("PushRecovery/Pendulum-v0", {})]  # fmt: skip
    monkeypatch.undo()
    monkeypatch.setattr(module, "START", "import sys; sys.exit({options!r} != {{'preset': 'x'}})")
    assert start_time("A-v0", preset="x") > 0.0
