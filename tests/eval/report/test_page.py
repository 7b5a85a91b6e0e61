"""Commands as typed, and that a report's replay is one that `play` understands."""

import re
import shlex
from html import escape

import pytest
from push_recovery.envs.scenario.disturbances import Slip
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import parse
from push_recovery.eval.cli.score import Compare, Evaluate
from push_recovery.eval.report.page import beside_axis, command_of, scenario_words, unbroken


def test_a_command_says_what_decides_outcomes_and_is_no_default():
    options = Evaluate(policies=("two-stage", "my file.safetensors"), profile=("exact", "hardware"),
                       workers=7, out="somewhere", json=True)  # fmt: skip
    command = command_of("evaluate", options)
    assert command.text == (
        "push-recovery evaluate --policies two-stage 'my file.safetensors' --profile exact hardware"
    )
    assert parse("evaluate", shlex.split(command.text)[2:]).policies == options.policies
    trusting = command_of("evaluate", Evaluate(policies=("model.zip",), trust=True))
    assert trusting.text == "push-recovery evaluate --trust --policies model.zip"
    assert parse("evaluate", shlex.split(trusting.text)[2:]).trust
    compared = command_of("compare", Compare(a="x", b="y", suite="hard"), ("a", "b"))
    assert compared.text == "push-recovery compare x y --suite hard"


def test_a_later_question_in_a_directory_has_a_page_of_its_own(tmp_path):
    seven = command_of(
        "evaluate", Evaluate(policies=("a", "b's", "runs/c.onnx"), profile=("exact", "weighed"))
    )
    assert seven.page(tmp_path) == "report.html"
    meta = f'<meta name="command" content="{escape(seven.text)}">'
    (tmp_path / "report.html").write_text(f"<head>{meta}</head>")
    assert seven.page(tmp_path) == "report.html"
    two = command_of("evaluate", Evaluate(policies=("a", "d/e.onnx")))
    assert two.page(tmp_path) == "report-a-d-e.onnx.html"
    table = command_of("evaluate", Evaluate())
    assert re.fullmatch(r"report-[0-9a-f]{8}\.html", table.page(tmp_path))
    many = command_of("evaluate", Evaluate(policies=tuple(f"policy-{k}" for k in range(10))))
    assert re.fullmatch(r"report-[0-9a-f]{8}\.html", many.page(tmp_path))
    assert command_of("compare", Compare(a="x", b="y"), ("a", "b")).page(tmp_path) == "compare-x-y.html"


def test_a_line_of_a_command_breaks_at_no_hyphen_of_an_option():
    long = "runs/" + "x" * 40
    assert str(unbroken(f"play --policy 'a' {long}")) == (
        f"<span>play</span> <span>--policy</span> <span>&#39;a&#39;</span> {long}"
    )


def test_a_replay_is_the_same_scenario_for_play():
    env = "PushRecovery/Pendulum-v0"
    options = Evaluate(suite="hard", errors='{"mass": 0.1}', preset="paper", env=env)
    line = command_of("evaluate", options).replay("hardware", "hard-0007", "runs/a/policy.safetensors")
    program, name, *words = shlex.split(line)
    assert (program, name) == ("push-recovery", "play")
    play = parse("play", words)
    for field in ("env", "preset", "suite", "errors"):
        assert getattr(play, field) == getattr(options, field)
    told = play.profile, play.scenario, play.policy
    assert told == ("hardware", "hard-0007", "runs/a/policy.safetensors")
    assert play.out == "hard-0007-runs-a-policy.safetensors.png"
    assert (play._scenario().id, play._scenario().sensing) == ("hard-0007", "onboard")
    assert "--profile" not in command_of("evaluate", options).replay("exact", "hard-0007", "two-stage")


@pytest.mark.parametrize("length", [24, 25, 30])
def test_a_label_beside_an_axis_is_as_long_as_there_is_room(length):
    label = "".join(chr(ord("a") + i % 26) for i in range(length))
    cut = beside_axis(label)
    assert len(cut) <= 24
    assert (cut == label) == (length == 24)
    assert (cut[:10], cut[-10:]) == (label[:10], label[-10:])


def test_a_scenario_is_told_by_what_is_pushed_and_how_it_walks():
    assert scenario_words(Scenario("a")) == "no push, walking in place"
    assert scenario_words(Scenario("a", command=Command(turn=0.3))) == "no push, turning"
    slip = Slip("left", 0.1, 1.0, 0.3)
    assert (
        scenario_words(Scenario("a", disturbances=(slip,), command=Command(0.2))) == "slip, walking forward"
    )
