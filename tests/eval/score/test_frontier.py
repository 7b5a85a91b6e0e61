"""Scans on hand-written outcomes, F* of a robot that walks and shares of it, and the frontier's table."""

import json
import math
from dataclasses import replace
from itertools import count, islice
from pathlib import Path

import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.capturability import capture_margin, recoverable_offset
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.whole_body.limits import LIMIT_NAMES
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import AT_REST, HARDWARE, IN_PLACE, Command
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout import DEFAULT_ENV
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.outcome import Outcome
from push_recovery.eval.score import frontier as scans
from push_recovery.eval.score.frontier import FrontierSettings


def test_the_largest_before_the_first_failure_and_at_all():
    found = scans.Scanned.of({30.0: False, 10.0: True, 20.0: True, 40.0: True, 50.0: False})
    assert found == scans.Scanned(survived=20.0, largest_survived=40.0, failed=(30.0, 50.0))
    assert scans.Scanned.of({10.0: False, 20.0: True}) == scans.Scanned(0.0, 20.0, (10.0,))
    assert scans.Scanned.of({10.0: True, 20.0: True}) == scans.Scanned(20.0, 20.0, ())
    assert scans.Scanned.of({}) == scans.Scanned(0.0, 0.0, ())


@pytest.mark.parametrize("at_once", [1, 2, 5, 50])
def test_a_scan_ends_so_far_past_the_first_failure_whatever_runs_at_once(at_once):
    asked = []

    def run(strengths):
        while chunk := list(islice(strengths, at_once)):
            asked.extend(chunk)
            yield from ((strength, strength not in {7.0, 9.0}) for strength in reversed(chunk))

    found = scans.scan_upwards(run, (float(k) for k in count(1)), 3.0, bool)
    assert found == {float(k): k not in {7, 9} for k in range(1, 11)}
    assert list(found) == sorted(found)
    assert len(asked) < 11 + at_once


def test_a_scan_without_failure_takes_every_strength():
    found = scans.scan_upwards(lambda strengths: ((s, True) for s in strengths), [1.0, 2.0], 0.5, bool)
    assert found == {1.0: True, 2.0: True}


def test_multiples_end_at_the_cap():
    assert list(scans.multiples(1500.0)) == [1500.0, 3000.0]
    assert list(scans.multiples(20.0))[-1] == scans.FORCE_CAP
    assert list(scans.multiples(scans.FORCE_CAP)) == [scans.FORCE_CAP]
    assert len(list(scans.multiples(0.1))) == 40000  # 4000 / 0.1 is 40000 but for rounding


PAPER, PAPER_LIMITS = RobotModel(), GaitLimits.of(RobotModel())
DURATION = 0.1


def force_for(robot: RobotModel, shift: float) -> float:
    """A push that moves the DCM by `shift` [m]: F (1 - exp(-omega d)) / (m omega^2)."""
    return shift * robot.mass * robot.omega**2 / (1.0 - math.exp(-robot.omega * DURATION))


@pytest.fixture(scope="module")
def env():
    made = make_env("PushRecovery/Pendulum-v0")
    yield made
    made.close()


@pytest.mark.parametrize("command", [Command(0.3, 0.1), Command(0.3, -0.1), Command(-0.2, 0.15)])
def test_the_limit_starts_from_the_gait_of_the_command(env, command):
    """On left stance the swing side is the right one: a velocity to the left narrows the step."""
    gait = nominal_gait(PAPER, PAPER_LIMITS, (command.vx, -command.vy))
    assert (gait.width < PAPER.pelvis_width) == (command.vy > 0)
    x, y = step_start_dcm(gait, PAPER.pelvis_width, PAPER.omega)
    bounds = recoverable_offset(PAPER, PAPER_LIMITS)
    sagittal = (0.0, bounds.high[0] - x), (math.pi, x - bounds.low[0])
    lateral = (-math.pi / 2, bounds.high[1] - y), (math.pi / 2, y - bounds.low[1])
    for psi, room in (*sagittal, *lateral):
        expected = pytest.approx(force_for(PAPER, room))
        assert scans.limit_force(env, psi, DURATION, command) == expected
        assert scans.own_limit_force(env, psi, DURATION, command) == expected


def test_the_own_limit_is_of_the_robots_box_and_the_papers_is_not():
    small = GaitLimits(length_min=-0.3, length_max=0.3)
    env = make_env("PushRecovery/Pendulum-v0", limits=small)
    x, _ = step_start_dcm(nominal_gait(PAPER, small), PAPER.pelvis_width, PAPER.omega)
    for found, limits in ((scans.own_limit_force, small), (scans.limit_force, PAPER_LIMITS)):
        room = recoverable_offset(PAPER, limits).high[0] - x
        assert found(env, 0.0, DURATION, Command()) == pytest.approx(force_for(PAPER, room))
    point = recoverable_offset(PAPER, small, foot=False, flywheel=False).high[0] - x
    found = scans.own_limit_force(env, 0.0, DURATION, Command(), point_foot=True)
    assert found == pytest.approx(force_for(PAPER, point))


WALKS = [Command(), Command(0.3, 0.1), Command(-0.2, -0.15)]


@pytest.mark.parametrize("command", WALKS)
@pytest.mark.parametrize("psi", [0.0, 0.7, -2.1, 3.0])
def test_at_the_start_of_a_left_stance_it_is_the_force_by_the_limit(env, command, psi):
    push = polar_push(120.0, psi, 0.1, GaitEvent(4, "left"))
    assert scans.limit_share(env, push, command) == pytest.approx(
        120.0 / scans.own_limit_force(env, psi, 0.1, command)
    )


@pytest.mark.parametrize("command", WALKS)
@pytest.mark.parametrize("psi", [0.3, -0.9, 2.5])
def test_in_mid_step_the_limit_brings_the_dcm_to_its_bound(env, command, psi):
    robot, limits = env.unwrapped.robot, env.unwrapped.limits
    push = polar_push(100.0, psi, 0.2, GaitEvent(4, "left", 0.6))
    share = scans.limit_share(env, push, command)
    assert share is not None
    gait = nominal_gait(robot, limits, (command.vx, -command.vy))
    elapsed = 0.6 * gait.duration
    start = np.array(step_start_dcm(gait, robot.pelvis_width, robot.omega)) * math.exp(robot.omega * elapsed)
    shift = 100.0 * (1.0 - math.exp(-robot.omega * 0.2)) / (robot.mass * robot.omega**2)
    pushed = start + shift / share * np.array([math.cos(psi), -math.sin(psi)])
    assert capture_margin(robot, limits, elapsed, pushed) == pytest.approx(0.0, abs=1e-12)


def test_a_mirrored_push_has_the_same_share_and_one_at_a_time_has_none(env):
    assert scans.limit_share(env, Push((50.0, 0.0, 0.0), 0.1, 2.0), Command()) is None
    push, command = polar_push(90.0, 1.1, 0.1, GaitEvent(4, "right", 0.3)), Command(0.2, 0.1)
    mirrored = scans.limit_share(env, push.mirrored(), replace(command, vy=-command.vy))
    assert scans.limit_share(env, push, command) == pytest.approx(mirrored)
    assert scans.limit_share(env, push, command) != pytest.approx(
        scans.limit_share(env, push.mirrored(), command)
    )


class Holes:
    """A runner whose robot survives the forces that a predicate accepts, with a step from 130 N on.

    It remembers what it was asked.
    """

    def __init__(self, survives):
        self.survives = survives
        self.forces = []

    def run_all(self, policy, scenarios):
        return (self.run(policy, scenario) for scenario in scenarios)

    def run(self, policy, scenario):
        force = math.hypot(*scenario.pushes[0].force)
        self.forces.append(round(force, 6))
        ok = bool(self.survives(force))
        limits = "cop", {"cop": 1.0, "contact": 1.1}, {"cop": 0.25, "contact": force / 1000}
        recovered = ok and force < 100.0  # the largest force survived counts, settled or not
        end = None, None if ok else "low", 1.0, 1, 0.0
        push = force / 10, 0.0, 1, (0.0, 0.0)
        steps = {"steps": int(force > 130.0)}
        return Outcome(scenario.id, policy, ok, recovered, *end, *push, *limits, measures=steps)


def scan_with(survives, grid=20.0, command=IN_PLACE):
    runner = Holes(survives)
    job = scans.ScanJob(FrontierSettings("env", grid, command=command), "p", 30.0)
    return scans.scan(runner, job), runner.forces  # type: ignore[arg-type]


def test_scan_goes_100_newtons_past_the_first_failure():
    row, forces = scan_with(lambda force: force < 210 or 250 < force < 290)
    assert (row["survived_N"], row["largest_survived_N"]) == (200.0, 280.0)
    assert row["failed_N"] == [220.0, 240.0, 300.0, 320.0]
    assert forces == [20.0 * k for k in range(1, 17)]
    assert forces[-1] == 220.0 + scans.BEYOND
    row, forces = scan_with(lambda force: False, grid=10.0)  # always falls
    assert (row["survived_N"], row["largest_survived_N"]) == (0.0, 0.0)
    assert forces == [10.0 * k for k in range(1, 12)]


def test_a_standing_robots_scan_tells_the_largest_force_without_a_step_or_a_fall():
    walking, forces = scan_with(lambda force: force < 210)
    row, same = scan_with(lambda force: force < 210, command=AT_REST)
    assert (row["stand_N"], row["survived_N"], same) == (120.0, 200.0, forces)
    assert {**walking, "stand_N": 120.0} == row
    row, _ = scan_with(lambda force: force < 90, command=AT_REST)  # falls before it steps
    assert row["stand_N"] == 80.0


def test_a_standing_robot_is_pushed_at_rest():
    (push,) = FrontierSettings("env", command=AT_REST).scenario(90.0, 140.0).pushes
    assert (push.start, push.force) == (0.5, pytest.approx((0.0, 140.0, 0.0), abs=1e-12))


@pytest.mark.parametrize(("psi", "reach"), [(0.0, 0.1), (math.pi / 2, 0.15)])
def test_the_standing_limit_is_how_far_both_soles_reach_and_what_the_trunk_gives(env, psi, reach):
    """0.2 x 0.1 m soles whose centres are 0.2 m apart; B by the closed form of a bang-bang swing."""
    torque, inertia, lean = PAPER.trunk_torque_max, PAPER.trunk_inertia, PAPER.trunk_angle_max
    swing = math.sqrt(lean * inertia / torque)
    reserve = torque / (PAPER.mass * 9.81) * (1.0 - math.exp(-PAPER.omega * swing)) ** 2
    expected = force_for(PAPER, reach + reserve)
    assert scans.standing_limit_force(env, psi, DURATION) == pytest.approx(expected, rel=1e-6)


def test_the_pendulum_catches_in_place_what_its_own_limit_leaves_it(tmp_path):
    """A period of 10 ms late it loses 3.4 % of F*_stand: 450 N forward, 575 N aside."""
    settings = FrontierSettings("PushRecovery/Pendulum-v0", 100.0, command=AT_REST)
    found = scans.frontier(settings, ["two-stage"], 4, 1, tmp_path).to_dict("two-stage")["directions"]
    assert [entry["stand_N"] for entry in found] == [400.0, 500.0, 400.0, 500.0]
    assert all(entry["survived_N"] > entry["own_stand_limit_N"] for entry in found[::2])
    scans.save_pictures(scans.frontier(settings, ["two-stage"], 4, 1, tmp_path))
    text = (tmp_path / "frontier.svg").read_text()
    assert "two-stage without a step" in text
    assert scans.STAND in text


def test_scan_keeps_the_limits_of_every_failed_force():
    row, _ = scan_with(lambda force: force < 310)
    assert [fall["force_N"] for fall in row["falls"]] == row["failed_N"]
    assert row["falls"][0] == {
        "force_N": 320.0, "failure_reason": "low", "first_limit": "cop",
        "limits_met": {"cop": 1.0, "contact": 1.1}, "limit_shares": {"cop": 0.25, "contact": 0.32},
    }  # fmt: skip
    assert scans.fall_cell(row["falls"]) == "CoP; contact 0.32, CoP 0.25"


def test_a_fall_is_told_by_the_limit_met_first_and_the_three_met_longest():
    """Of equal ones in the order of the limits."""
    shares = {"cop": 0.25, "contact": 0.5, "sole_edge": 0.125, "leg_reach": 0.5}
    falls = [{"first_limit": "sole_edge", "limit_shares": shares}, {"first_limit": "cop", "limit_shares": {}}]
    longest = [name.replace("_", " ") for name in sorted(("contact", "leg_reach"), key=LIMIT_NAMES.index)]
    assert scans.fall_cell(falls) == "sole edge; {} 0.50, {} 0.50, CoP 0.25".format(*longest)
    assert scans.fall_cell([{"first_limit": None, "limit_shares": {}}]) == scans.fall_cell([]) == "-"


class SideBySide(Holes):
    """Begins six forces at a time and tells of the strongest first."""

    def run_all(self, policy, scenarios):
        queue = iter(scenarios)
        while begun := list(islice(queue, 6)):
            yield from (self.run(policy, scenario) for scenario in reversed(begun))


@pytest.mark.parametrize("first", [100.0, 210.0, 470.0])
def test_forces_side_by_side_change_nothing(first):
    def survives(force):
        return force < first or first + 45 < force < first + 90 or force > first + 150

    job = scans.ScanJob(FrontierSettings("env", 20.0), "p", 30.0)
    rows = [scans.scan(kind(survives), job) for kind in (Holes, SideBySide)]  # type: ignore[arg-type]
    assert rows[0] == rows[1]


def test_a_frontier_may_be_that_of_another_profile():
    settings = scans.FrontierSettings(DEFAULT_ENV, errors=ModelErrors(friction=0.5), profile="hardware")
    scenario, exact = settings.scenario(90.0, 140.0), replace(settings, profile="exact")
    assert scenario == HARDWARE.applied(exact.scenario(90.0, 140.0))
    assert (scenario.sensing, scenario.errors.friction) == ("onboard", 0.5)
    with pytest.raises(UnknownNameError, match=r"profile 'real'.*exact, hardware"):
        scans.FrontierSettings("env", profile="real")


def test_push_of_the_contract():
    scenario = FrontierSettings("env", command=Command(0.3)).scenario(90.0, 140.0)
    (push,) = scenario.pushes
    assert push.force == pytest.approx((0.0, 140.0, 0.0), abs=1e-12)
    assert push.start == GaitEvent(4, "left", 0.0)
    assert (push.duration, push.body) == (0.1, "pelvis")
    assert (scenario.stance_side, scenario.command) == ("left", Command(0.3))
    assert push.start.step_index("left") == 4  # type: ignore[union-attr]


def test_grid_and_directions():
    assert scans.default_grid("PushRecovery/Pendulum-v0") == 10.0
    assert scans.default_grid("PushRecovery/Biped-v0") == scans.default_grid(toy.ENV_ID) == 20.0
    assert scans.directions_deg(8) == [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
    with pytest.raises(InvalidValueError, match="directions"):
        scans.directions_deg(0)
    with pytest.raises(InvalidValueError, match="grid"):
        scans.FrontierSettings("env", grid=0.0)


def test_json_and_pictures(tmp_path, capsys):
    policy = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    out = tmp_path / "out"
    argv = ["frontier", "--env", toy.ENV_ID, "--policy", policy, "--directions", "3", "--grid", "50"]
    argv += ["--out", str(out), "--workers", "1"]
    assert main([*argv, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert set(content) == {"env", "policy", "push", "directions"}
    assert content["push"] == {"duration": 0.1, "body": "pelvis"}
    assert [entry["psi_deg"] for entry in content["directions"]] == [0.0, 120.0, 240.0]
    for entry in content["directions"]:
        forces = {"survived_N", "largest_survived_N", "limit_N", "own_limit_N", "own_stand_limit_N"}
        assert set(entry) == {"psi_deg", "fraction", "own_fraction", *forces}
        assert 0 < entry["survived_N"] <= entry["largest_survived_N"]
        assert entry["fraction"] == pytest.approx(entry["survived_N"] / entry["limit_N"])
        assert entry["own_fraction"] == pytest.approx(entry["survived_N"] / entry["own_limit_N"])
    assert (out / "frontier.png").read_bytes()[:4] == b"\x89PNG"
    assert "<svg" in (out / "frontier.svg").read_text()[:400]
    before = (out / "outcomes.jsonl").read_text()
    assert main(argv) == 0
    assert (out / "outcomes.jsonl").read_text() == before
    assert "F* [N]" in capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())["policies"][policy]
    assert [len(entry.pop("falls")) > 0 for entry in report["directions"]] == [True] * 3
    assert report == content  # the report says nothing else than the contract's object
    assert "| psi [deg] | own F* [N] | paper's F* [N] |" in (out / "report.md").read_text()


def test_workers_change_nothing(tmp_path):
    policy = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    settings = FrontierSettings(toy.ENV_ID, grid=50.0)
    one = scans.frontier(settings, [policy], 4, 1, tmp_path / "one").to_dict(policy)
    two = scans.frontier(settings, [policy], 4, 2, tmp_path / "two").to_dict(policy)
    assert one == two


@pytest.mark.parametrize(("psi", "force"), [(-90, 641), (-45, 907), (0, 1120), (45, 582), (90, 412)])
def test_limit_is_the_papers_in_place(psi, force):
    # l_p 0.2 m, foot 0.2 x 0.1 m, T 0.65 s; on the left stance a push to the left is the hard one
    env = make_env(toy.ENV_ID)
    assert scans.limit_force(env, math.radians(psi), 0.1, Command()) == pytest.approx(force, abs=1.0)


def test_own_limit_is_that_of_the_environments_own_box():
    """Forward with a point foot: F = m omega^2 L_max / (e^(omega T_min) - 1) / (1 - e^(-omega d))."""
    limits = replace(GaitLimits.of(RobotModel()), length_max=0.3, duration_min=0.4)
    env = make_env("PushRecovery/Pendulum-v0", limits=limits)
    mass, omega = 60.0, math.sqrt(9.81 / env.unwrapped.robot.com_height)  # type: ignore[attr-defined]
    offset = 0.3 / (math.exp(0.4 * omega) - 1.0)
    expected = mass * omega**2 * offset / (1.0 - math.exp(-0.1 * omega))
    assert scans.own_limit_force(env, 0.0, 0.1, Command(), point_foot=True) == pytest.approx(expected)
    found = scans.direction_limits(env, 0.0, 0.1, Command())
    assert expected < found.own < found.paper == scans.limit_force(env, 0.0, 0.1, Command())
    curves = scans.limit_curves(env, [0.0, -90.0], 0.1, Command())
    assert list(curves) == [scans.OWN, scans.PAPER, scans.POINT_FOOT, scans.STAND]
    for psi, own, paper, point, stand in zip((0.0, -90.0), *curves.values(), strict=True):
        assert scans.DirectionLimits(own, paper, stand) == scans.direction_limits(env, psi, 0.1, Command())
        assert point < own


def row(psi, survived, largest):
    return {"policy": "p", "psi_deg": psi, "survived_N": survived, "largest_survived_N": largest, "falls": []}


FRONTIER = scans.Frontier(
    FrontierSettings("env"),
    {"p": [row(0.0, 100.0, 100.0), row(180.0, 150.0, 240.0)]},
    {0.0: scans.DirectionLimits(400.0, 200.0, 125.0), 180.0: scans.DirectionLimits(300.0, 0.0, 75.0)},
    Path("out"),
)


def test_shares_are_of_the_own_box_then_of_the_papers_in_the_table_and_in_the_contracts_object():
    first, second = scans.frontier_table(FRONTIER).rows
    assert first == ("0", "400", "200", "125", "100 (0.25, 0.50)", "-")
    assert second == (
        "180",
        "300",
        "0",
        "75",
        "150 (0.50, -; 240)",
        "-",
    )  # more survived beyond the first failure
    columns = "psi [deg]", "own F* [N]", "paper's F* [N]", "own F*_stand [N]", "p", "falls by"
    assert scans.frontier_table(FRONTIER).columns == columns
    entry, _ = FRONTIER.to_dict("p")["directions"]
    assert entry == {
        "psi_deg": 0.0, "survived_N": 100.0, "largest_survived_N": 100.0, "limit_N": 200.0, "fraction": 0.5,
        "own_limit_N": 400.0, "own_fraction": 0.25, "own_stand_limit_N": 125.0,
    }  # fmt: skip
