"""What a residual adds, told by direction and step, from a policy whose corrections are known."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.envs.scenario.push import Kick, polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.record import corrections
from push_recovery.eval.record.record import EpisodeRecord
from push_recovery.eval.record.words import sector_of
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.policy_source import acting_in

BIPED = "PushRecovery/Biped-v0"
SCALE = (0.0, 0.0, 0.0, 0.1, 0.05, 0.0, 0.0)


@pytest.fixture(scope="module")
def constant():
    """A residual whose network always says 0.5, of the CoP alone, with a gate."""
    env = make_env(BIPED)
    robot, limits = env.unwrapped.robot, env.unwrapped.limits
    base = ResidualBase("two-stage", "biped", SCALE, gate=(0.03, 0.1))
    network = Mlp((np.zeros((7, 36), np.float32),), (np.full(7, 0.5, np.float32),))
    about = PolicyDescription(BIPED, robot, limits, base)
    yield env, NetworkPolicy(network, Normalisation(np.zeros(36), np.ones(36)), about)
    env.close()


def pushed(psi, magnitude, side="left"):
    push = polar_push(magnitude, math.radians(psi), 0.1, 1.0)
    return Scenario(f"{psi}", pushes=(push,), stance_side=side, settle_time=1.0)


def test_the_correction_of_a_step_is_the_mean_of_what_was_added(constant):
    """The gate is open wide after 900 N: then scale x 0.5 x half the box are added, half a box for 1."""
    env, policy = constant
    (one,) = corrections.collect(env, policy, [pushed(0.0, 900.0)])
    limits = env.unwrapped.limits
    most = np.array(SCALE) * 0.5 * (limits.high - limits.low) / 2.0
    pushed_step = one.corrections[0]
    np.testing.assert_allclose(pushed_step[[0, 1, 2, 5, 6]], 0.0, atol=1e-7)
    assert (np.abs(pushed_step[[3, 4]]) > 0.2 * most[[3, 4]]).any()
    assert (np.nan_to_num(one.corrections) <= most + 1e-6).all()
    assert np.nanmin(one.corrections) > -1e-6  # the network says +0.5: nothing is planned lower
    assert one.impulse == pytest.approx(90.0)


def test_an_unpushed_gate_stays_shut(constant):
    env, policy = constant
    (one,) = corrections.collect(env, policy, [pushed(0.0, 1.0)])
    assert (one.corrections.any(), one.below_recovered, one.recovered) == (False, True, True)


def test_directions_are_told_in_the_frame_of_the_step_that_is_pushed(constant):
    """To the left is inward on a left stance; steps alternate, so the other stance gives the other sign."""
    env, policy = constant
    found = list(corrections.collect(env, policy, [pushed(90.0, 200.0, side) for side in ("left", "right")]))
    assert sorted(round(one.psi) for one in found) == [-90, 90]
    mirrored = list(corrections.collect(env, policy, [pushed(90.0, 200.0), pushed(90.0, 200.0).mirrored()]))
    assert mirrored[0].psi == pytest.approx(mirrored[1].psi)
    np.testing.assert_allclose(mirrored[0].corrections, mirrored[1].corrections, atol=1e-5)


def test_a_policy_that_corrects_nothing_is_refused(constant):
    env, _ = constant
    refused = pytest.raises(InvalidValueError, match="only a residual on gait actions")
    with acting_in(BIPED, "two-stage") as acting, refused:
        list(corrections.collect(env, acting.policy, [pushed(0.0, 100.0)]))


def test_sectors_are_of_45_degrees_about_the_eight_directions():
    named = {0.0: "forward", 22.0: "forward", 23.0: "forward outward", 90.0: "outward", -90.0: "inward",
             180.0: "backward", -179.0: "backward", -45.0: "forward inward"}  # fmt: skip
    assert {psi: corrections.SECTORS[sector_of(psi)] for psi in named} == named


@pytest.fixture
def some():
    """Two forward pushes with step lengths 10 and 30 mm longer, and an outward one that is lost."""

    def one(psi, below, recovered, length):
        steps = np.full((3, 7), np.nan)
        steps[0] = 0.0
        steps[0, 0], steps[0, 2] = length, -0.01
        return corrections.PushCorrections("x", psi, 100.0, below, recovered, steps)

    return [one(0.0, False, True, 0.01), one(10.0, True, True, 0.03), one(90.0, True, False, 0.0)]


def test_means_and_counts_are_those_of_the_pushes(some):
    summary = corrections.summarise(some)
    assert summary.pushes.tolist() == [2, 0, 1, 0, 0, 0, 0, 0]
    assert summary.repaired.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    assert summary.lost.tolist() == [0, 0, 1, 0, 0, 0, 0, 0]
    assert not summary.left.any()
    assert summary.mean[0, 0, 0] == pytest.approx(20.0)  # mm
    assert summary.spread[0, 0, 0] == pytest.approx(10.0)
    assert summary.mean[0, 2, 2] == pytest.approx(-10.0)  # ms
    assert np.isnan(summary.mean[1]).all()
    neither = dataclasses.replace(some[0], recovered=False)
    assert corrections.summarise([neither]).left.sum() == 1


def test_tables_and_picture(some, tmp_path):
    summary = corrections.summarise(some)
    assert "| forward | 2 | 1 | 0 | 0 |" in corrections.outcome_table(summary)
    assert "| forward | +20.0 (10.0) |" in corrections.correction_table(summary, 0)
    assert "| forward | - | - |" in corrections.correction_table(summary, 1)
    png, svg = corrections.save_corrections(summary, tmp_path)
    assert png.stat().st_size > 10_000
    assert svg.suffix == ".svg"


def test_the_command_tells_it(constant, tmp_path, capsys):
    file = constant[1].save(tmp_path / "policy")
    words = ["corrections", str(file), "--sample", "2", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    (page,) = (tmp_path / "out").glob("corrections-*.md")
    assert page.read_text() in capsys.readouterr().out
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {f"{page.stem}.{kind}" for kind in ("md", "png", "svg")}


@pytest.mark.parametrize(("side", "sign"), [(0, -1.0), (1, 1.0)])
@pytest.mark.parametrize(("frame", "psi"), [("heading", 90.0), ("world", 90.0 - math.degrees(0.3))])
def test_to_the_left_is_inward_on_the_left_foot_and_steps_count_from_the_push_on(side, sign, frame, psi):
    columns = {"time": np.arange(7) * 0.1, "step": np.array([3.0, 3, 3, 4, 4, 5, 5]),
               "heading": np.full(7, 0.3), "stance_side": np.full(7, float(side))}  # fmt: skip
    push = polar_push(200.0, math.radians(90.0), 0.1, 0.15, frame=frame)
    episode = EpisodeRecord(
        Scenario("x", (push,)), SimpleNamespace(recovered=True), columns, {}, {}, (0.2, 0.1), (0.15,), 60.0
    )
    one = corrections.corrections_of(episode, np.arange(6.0)[:, None] * np.ones(7), False)
    assert one.psi == pytest.approx(sign * psi)
    assert one.corrections[:, 0].tolist() == [1.5, 3.5, 5.0]


def test_points_of_the_figure_go_from_backward_over_inward_to_outward():
    names = [corrections.SECTORS[k] for k in corrections.ORDER[::2]]
    assert names == ["backward", "inward", "forward", "outward", "backward"]


def test_a_scenario_without_a_push_is_refused(constant):
    kicked = Scenario("k", kicks=(Kick((0.2, 0.0, 0.0), 1.0),))
    with pytest.raises(InvalidValueError, match="'k' has none"):
        list(corrections.collect(*constant, [kicked]))


def test_a_place_that_cannot_be_written_is_refused_before_any_push(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(corrections, "collect", lambda *_: pytest.fail("ran first"))
    argv = [
        "corrections",
        "residual",
        "--suite",
        "standard",
        "--sample",
        "1",
        "--out",
        str(tmp_path / "file"),
    ]
    assert main(argv) == 2
