"""`push-recovery play` up to the page: what it refuses, and the panel's actions without a browser."""

import pytest
from push_recovery.envs.scenario.scenario import Command
from push_recovery.eval.cli.main import main, parse
from push_recovery.eval.play import browser as opening
from push_recovery.eval.rollout.environments import make_env, policy_names_for
from push_recovery.eval.rollout.load_policy import policy_names


def test_a_missing_viewer_names_the_command_that_installs_it(monkeypatch, capsys):
    monkeypatch.setattr(opening, "find_spec", lambda name: None)
    assert main(["play"]) == 1
    assert "pip install 'push-recovery[play]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["--port", "70000"], ["--port", "65535"]),
        (["--force", "9", "--impulse", "9"], ["--impulse-per-kg", "only one"]),
        (["--viewer", "tv"], ["browser", "mujoco"]),
        (["--policy", "two-stag"], ["two-stag", "two-stage"]),
        (["--env", "PushRecovery/Pendulum-v0"], ["only bipeds"]),
    ],
)
def test_bad_input_is_refused_before_a_page_is_served(argv, words, capsys):
    assert main(["play", *argv]) == 2
    err = capsys.readouterr().err
    assert all(word in err for word in words), err


def test_a_push_may_be_given_by_its_impulse_and_by_the_robots_mass():
    """60 kg, within 0.2 s."""
    pushes = [
        parse("play", ["--duration", "0.2", *words])._scenario().pushes[0].force
        for words in (
            ["--force", "150"],
            ["--impulse", "30"],
            ["--impulse-per-kg", "0.5"],
            ["--force", "0"],
            [],
        )
    ]
    assert [force[0] for force in pushes] == pytest.approx([150.0, 150.0, 150.0, 0.0, 200.0])


def test_the_list_holds_what_this_robot_can_take():
    env = make_env("PushRecovery/Biped-v0")
    of_others = {name for name in policy_names() if set(name.split("-")) & {"g1", "t1", "jvrc1"}}
    assert {"holosoma-g1-ppo", "joint-residual-t1"} <= of_others
    assert set(policy_names()) - set(policy_names_for(env)) == of_others


def test_a_host_of_another_computer_is_refused(capsys):
    pytest.importorskip("viser", reason="needs the extra play")
    assert main(["play", "--host", "203.0.113.5"]) == 2
    assert "no address of this computer" in capsys.readouterr().err


def test_refusals_and_replays_bring_the_fields_back_to_what_is_true():
    pytest.importorskip("mjviser", reason="needs the extra play")
    from push_recovery.eval.play.gate import Gate
    from push_recovery.eval.play.session import FirstPush, Session

    session = Session("PushRecovery/Biped-v0", "two-stage")
    app = opening.open_app(session, ["two-stage", "stage-1"], Gate("127.0.0.1"), 8760, FirstPush(9.0, 0.0))
    try:
        panel = app.panel
        app.do(panel._replay)  # nothing to replay: a notice for everybody, and no harm
        app.frame(0.3)
        app.do(panel._push)
        app.frame(0.1)
        assert session.last.push.impulse == pytest.approx((9.0, 0.0, 0.0))
        assert app.given.text == "9.0 N s  (0.15 N s/kg)"
        panel._command[0].value = 0.3
        app.do(panel._set_command)
        app.frame(0.1)
        assert session.first.command == Command(0.3)
        app.do(panel._replay)
        app.frame(0.0)
        assert session.first.command == Command()
        assert panel._command[0].value == 0.0
        panel._beside.value = "stage-1"
        app.do(panel._put_beside)
        app.frame(0.0)
        assert [lane.name for lane in session.lanes] == ["two-stage", "stage-1"]
        assert len(app._robots) == 2
        session.put_beside(None)
        app.frame(0.0)
        assert len(app._robots) == 1
    finally:
        app.server.stop()
        session.close()
