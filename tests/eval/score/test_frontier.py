"""Searches on hand-written outcomes, the run of all directions, and the frontier's table."""

import json
import math
import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.whole_body.limits import LIMIT_NAMES
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent
from push_recovery.envs.scenario.scenario import AT_REST, HARDWARE, IN_PLACE, Command
from push_recovery.eval.cli.main import main
from push_recovery.eval.report import frontier as report
from push_recovery.eval.rollout import DEFAULT_ENV
from push_recovery.eval.rollout.outcome import Outcome
from push_recovery.eval.score import frontier as scans
from push_recovery.eval.score import limits
from push_recovery.eval.score.frontier import FrontierSettings
from push_recovery.eval.score.threshold import BEYOND, directions_deg


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
        met = "cop", {"cop": 1.0, "contact": 1.1}, {"cop": 0.25, "contact": force / 1000}
        recovered = ok and force < 100.0  # the largest force survived counts, settled or not
        end = None, None if ok else "low", 1.0, 1, 0.0
        push = force / 10, 0.0, 1, (0.0, 0.0)
        steps = {"steps": int(force > 130.0)}
        return Outcome(scenario.id, policy, ok, recovered, *end, *push, *met, measures=steps)


def scan_with(survives, grid=20.0, command=IN_PLACE):
    runner = Holes(survives)
    job = scans.ScanJob(FrontierSettings("env", grid, command=command), "p", 30.0)
    return scans.scan(runner, job), runner.forces  # type: ignore[arg-type]


def test_scan_goes_100_newtons_past_the_first_failure():
    row, forces = scan_with(lambda force: force < 210 or 250 < force < 290)
    assert (row["survived_N"], row["largest_survived_N"]) == (200.0, 280.0)
    assert row["failed_N"] == [220.0, 240.0, 300.0, 320.0]
    assert forces == [20.0 * k for k in range(1, 17)]
    assert forces[-1] == 220.0 + BEYOND
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


def test_the_pendulum_catches_in_place_what_its_own_limit_leaves_it(tmp_path):
    """A period of 10 ms late it loses 3.4 % of F*_stand: 450 N forward, 575 N aside."""
    settings = FrontierSettings("PushRecovery/Pendulum-v0", 100.0, command=AT_REST)
    found = scans.frontier(settings, ["two-stage"], 4, 1, tmp_path).to_dict("two-stage")["directions"]
    assert [entry["stand_N"] for entry in found] == [400.0, 500.0, 400.0, 500.0]
    assert all(entry["survived_N"] > entry["own_stand_limit_N"] for entry in found[::2])
    report.save_pictures(scans.frontier(settings, ["two-stage"], 4, 1, tmp_path))
    text = (tmp_path / "frontier.svg").read_text()
    assert "two-stage without a step" in text
    assert limits.STAND in text


def test_scan_keeps_the_limits_of_every_failed_force():
    row, _ = scan_with(lambda force: force < 310)
    assert [fall["force_N"] for fall in row["falls"]] == row["failed_N"]
    assert row["falls"][0] == {
        "force_N": 320.0, "failure_reason": "low", "first_limit": "cop",
        "limits_met": {"cop": 1.0, "contact": 1.1}, "limit_shares": {"cop": 0.25, "contact": 0.32},
    }  # fmt: skip
    assert report.fall_cell(row["falls"]) == "CoP; contact 0.32, CoP 0.25"


def test_a_fall_is_told_by_the_limit_met_first_and_the_three_met_longest():
    """Of equal ones in the order of the limits."""
    shares = {"cop": 0.25, "contact": 0.5, "sole_edge": 0.125, "leg_reach": 0.5}
    falls = [{"first_limit": "sole_edge", "limit_shares": shares}, {"first_limit": "cop", "limit_shares": {}}]
    longest = [name.replace("_", " ") for name in sorted(("contact", "leg_reach"), key=LIMIT_NAMES.index)]
    assert report.fall_cell(falls) == "sole edge; {} 0.50, {} 0.50, CoP 0.25".format(*longest)
    assert report.fall_cell([{"first_limit": None, "limit_shares": {}}]) == report.fall_cell([]) == "-"


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
    with pytest.raises(UnknownNameError, match=r"profile 'real'.*exact, collisions, hardware"):
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
    assert scans.default_grid("PushRecovery/Pendulum-v0", 32) == 40.0  # 60 kg
    assert directions_deg(8) == [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
    with pytest.raises(InvalidValueError, match="directions"):
        directions_deg(0)
    with pytest.raises(InvalidValueError, match="grid"):
        scans.FrontierSettings("env", grid=0.0)


def test_json_and_pictures_of_the_nominal_trajectory(tmp_path, capsys):
    policy = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    out = tmp_path / "out"
    argv = ["frontier", "--env", toy.ENV_ID, "--policy", policy, "--directions", "3", "--grid", "50"]
    argv += ["--out", str(out), "--workers", "1", "--replicas", "1"]
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
    told = json.loads((out / "report.json").read_text())["policies"][policy]
    assert [len(entry.pop("falls")) > 0 for entry in told["directions"]] == [True] * 3
    assert told == content  # the report says nothing else than the contract's object
    assert "| psi [deg] | own F* [N] | paper's F* [N] |" in (out / "report.md").read_text()


def test_workers_change_nothing(tmp_path):
    policy = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    settings = FrontierSettings(toy.ENV_ID, grid=50.0)
    one = scans.frontier(settings, [policy], 4, 1, tmp_path / "one").to_dict(policy)
    two = scans.frontier(settings, [policy], 4, 2, tmp_path / "two").to_dict(policy)
    assert one == two


def row(psi, survived, largest):
    return {"policy": "p", "psi_deg": psi, "survived_N": survived, "largest_survived_N": largest, "falls": []}


FRONTIER = scans.Frontier(
    FrontierSettings("env"),
    {"p": [row(0.0, 100.0, 100.0), row(180.0, 150.0, 240.0)]},
    {0.0: limits.DirectionLimits(400.0, 200.0, 125.0), 180.0: limits.DirectionLimits(300.0, 0.0, 75.0)},
    Path("out"),
    60.0,
)


def test_shares_are_of_the_own_box_then_of_the_papers_in_the_table_and_in_the_contracts_object():
    first, second = report.frontier_table(FRONTIER).rows
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
    assert report.frontier_table(FRONTIER).columns == columns
    entry, _ = FRONTIER.to_dict("p")["directions"]
    assert entry == {
        "psi_deg": 0.0, "survived_N": 100.0, "largest_survived_N": 100.0, "limit_N": 200.0, "fraction": 0.5,
        "own_limit_N": 400.0, "own_fraction": 0.25, "own_stand_limit_N": 125.0,
    }  # fmt: skip


class ByPhase(SideBySide):
    """A runner whose robots recover from 200 N at the start of the step, and 400 N more at its end."""

    def __init__(self):
        super().__init__(None)
        self.seen = {}

    def run(self, policy, scenario):
        (push,), force = scenario.pushes, math.hypot(*scenario.pushes[0].force)
        self.seen.setdefault(round(force, 6), []).append(scenario)
        ok = force <= 200.0 + 400.0 * push.start.fraction
        end = None, None if ok else "low", 1.0, 1, 0.0
        met = "cop", {"cop": 1.0}, {"cop": 0.25}
        return Outcome(scenario.id, policy, ok, ok, *end, force / 10, 0.0, 1, (0.0, 0.0), *met)


REPLICATED = FrontierSettings("env", 20.0, replicas=40, replica_seed=3)


def test_a_threshold_is_the_force_of_the_phase_that_a_fifth_are_weaker_than():
    runner = ByPhase()
    row = scans.scan(runner, scans.ScanJob(REPLICATED, "p", 30.0))  # type: ignore[arg-type]
    control = scans.scan(ByPhase(), scans.ScanJob(REPLICATED, "p", None))  # type: ignore[arg-type]
    assert (control["forces_N"], control["recovered"], control["falls"]) == ([0.0], ["1" * 40], [])
    entry = REPLICATED.search.entry(row, control)
    assert entry["threshold_N"] == pytest.approx(200.0 + 400.0 * 0.2, abs=20.0)
    assert entry["J50_Ns"] == pytest.approx(0.1 * 400.0, abs=2.0)
    assert entry["J95_Ns"] == pytest.approx(0.1 * 220.0, abs=2.0)
    low, high = entry["threshold_ci95"]
    assert low < 280.0 < high
    assert high - low < 100.0
    assert entry["islands"] == []  # what is harder is not survived again
    assert 200.0 < entry["first_failure_N"] < 260.0
    assert entry["survived_N"] < entry["first_failure_N"]
    weakest = row["falls"][0]
    assert (weakest["force_N"], weakest["replica"]) == (entry["first_failure_N"], 0)
    told = [len(scenarios) for scenarios in runner.seen.values()]
    assert told == [40] * len(row["forces_N"])
    first, *others = runner.seen.values()
    for scenarios in others:  # the same replicas for every force
        assert [(s.pushes[0].start, s.start, s.noise_seed) for s in sorted(scenarios, key=_phase)] == [
            (s.pushes[0].start, s.start, s.noise_seed) for s in sorted(first, key=_phase)
        ]


def _phase(scenario):
    return scenario.pushes[0].start.fraction


def test_a_policy_that_falls_unpushed_has_no_threshold():
    row = scans.scan(ByPhase(), scans.ScanJob(REPLICATED, "p", 30.0))  # type: ignore[arg-type]
    control = {"forces_N": [0.0], "recovered": ["10" * 20]}
    entry = REPLICATED.search.entry(row, control)
    assert (entry["threshold_N"], entry["first_failure_N"], entry["survived_N"]) == (0.0, 0.0, 0.0)


def test_replicas_of_a_push():
    nominal, replica = REPLICATED.scenario(90.0, 140.0), REPLICATED.replicated(90.0, 140.0, 7)
    assert replica.pushes[0].force == nominal.pushes[0].force
    assert replica.pushes[0].start == GaitEvent(4, "left", REPLICATED.drawn[7].phase)
    assert 7 / 40 <= REPLICATED.drawn[7].phase < 8 / 40
    assert (replica.start, replica.noise_seed) == (REPLICATED.drawn[7].start, REPLICATED.drawn[7].noise_seed)
    standing = replace(REPLICATED, command=AT_REST).replicated(90.0, 140.0, 7)
    assert standing.pushes[0].start == 0.5 + 0.5 * REPLICATED.drawn[7].phase
    with pytest.raises(InvalidValueError, match=r"replica must be in \[0, 39\] of 40 replicas, got 40"):
        REPLICATED.replicated(90.0, 140.0, 40)


def test_json_table_page_and_picture_of_replicas(tmp_path, capsys):
    pytest.importorskip("jinja2", reason="needs the extra report")
    argv = ["frontier", "--env", "PushRecovery/Pendulum-v0", "--policy", "stage-1", "--directions", "2"]
    argv += ["--grid", "100", "--replicas", "4", "--out", str(tmp_path), "--workers", "1"]
    assert main([*argv, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["replicas"] == {"count": 4, "seed": 0}
    assert content["unpushed_recovered"] == 4
    for entry in content["directions"]:
        low, high = entry["threshold_ci95"]
        assert 0 <= low < entry["threshold_N"] < high
        assert entry["J95_Ns"] <= 0.1 * entry["threshold_N"] <= entry["J50_Ns"]
        assert entry["J50_Ns_per_kg"] == pytest.approx(entry["J50_Ns"] / 60.0)
        assert entry["threshold_limit_N"] > entry["own_limit_N"]  # later in the step a push is easier
        assert 0.3 < entry["threshold_fraction"] < 1.0
        assert {"survived_N", "largest_survived_N", "limit_N", "fraction", "islands"} < set(entry)
    assert main(argv) == 0  # nothing is left to run
    told = capsys.readouterr().out
    assert "unpushed" in told
    assert "4 of 4 recover" in told
    assert "J50 [N s]" in told
    assert "first failure" in (tmp_path / "report.md").read_text()
    page = (tmp_path / "report.html").read_text()
    assert "That is done on 4 replicas" in page
    assert limits.PHASES in (tmp_path / "frontier.svg").read_text()
    replay = (
        page.replace("<span>", "").replace("</span>", "").split("push-recovery play")[1].split("</code>")[0]
    )
    assert "--replicas 4" in replay
    assert "--replica " in replay


class Unsettled(ByPhase):
    """Stays up at any force, and settles where the other recovers."""

    def run(self, policy, scenario):
        return replace(super().run(policy, scenario), survived=True, failure_reason=None)


def test_a_replica_counts_where_it_recovers_and_is_a_fall_where_it_fell():
    row = scans.scan(Unsettled(), scans.ScanJob(REPLICATED, "p", 30.0))  # type: ignore[arg-type]
    assert REPLICATED.search.entry(row, None)["threshold_N"] == pytest.approx(280.0, abs=20.0)
    assert row["falls"] == []


def test_standing_replicas_have_a_threshold_without_a_step_of_its_own():
    """All alike: they settle at 80 N and not at 100, and take no step at 120 N and one at 140."""
    settings = replace(REPLICATED, command=AT_REST, replicas=4)
    row = scans.scan(Holes(lambda force: force < 210.0), scans.ScanJob(settings, "p", 0.0))  # type: ignore[arg-type]
    entry = settings.search.entry(row, None)
    assert row["forces_N"] == [80.0, 100.0, 120.0, 140.0, 160.0, 320.0]
    assert entry["threshold_N"] == pytest.approx(80.0 + 20.0 * 0.2)
    assert entry["stand_N"] == pytest.approx(120.0 + 20.0 * 0.2)


def test_what_replicas_survive_is_given_of_all_and_of_any_of_them():
    row = {"forces_N": [100.0, 200.0, 300.0, 400.0], "recovered": ["11", "10", "01", "00"]}
    control = {"forces_N": [0.0], "recovered": ["11"]}
    entry = replace(REPLICATED, replicas=2).search.entry(row, control)
    names = "survived_N", "first_failure_N", "largest_survived_N"
    assert [entry[name] for name in names] == [100.0, 200.0, 300.0]
    assert entry["islands"] == [{"force_N": 300.0, "replicas": 1}]


def test_a_grid_is_no_larger_than_the_largest_force():
    assert FrontierSettings("env", 4000.0).grid == 4000.0
    with pytest.raises(InvalidValueError, match="grid"):
        FrontierSettings("env", 4000.5)


def test_cells_of_replicas():
    """p is 1, 1, 1/2, 1/2, 0, linear between: J95 and J50 at 110 and 300 N for 0.1 s."""
    one = {"policy": "p", "psi_deg": 0.0, "forces_N": [100.0, 200.0, 300.0, 400.0],
           "recovered": ["11", "10", "01", "00"], "falls": []}  # fmt: skip
    found = scans.Frontier(
        FrontierSettings("env", replicas=2), {"p": [one]},
        {0.0: limits.DirectionLimits(400.0, 200.0, 125.0, 280.0)}, Path(), 60.0,
        {"p": {"forces_N": [0.0], "recovered": ["11"]}},
    )  # fmt: skip
    ((_, _, j95, j50, first, islands),) = report.replicas_table(found).rows
    assert (j95[:4], j95[-4:], j50[:4], j50[-4:]) == ("11 (", "0.18", "30 (", "0.50")
    assert (first, islands) == ("200", "300 (1)")
    cell = report.frontier_table(found).rows[0][4]
    assert (cell[:7], cell[-6:]) == ("140 (0 ", " 0.50)")


@pytest.mark.parametrize("change", [{"grid": 50.0}, {"duration": 0.2}])
def test_rows_of_another_question_are_not_mixed(monkeypatch, tmp_path, change):
    def rows(env_id, task, jobs, workers, sources):
        return ({**row(job.psi_deg, 100.0, 100.0), "policy": job.policy, "failed_N": []} for job in jobs)

    monkeypatch.setattr(scans, "parallel", rows)
    settings = FrontierSettings(toy.ENV_ID, 20.0)
    scans.frontier(settings, ["passive"], 4, directory=tmp_path)
    with pytest.raises(InvalidValueError, match="differs in: frontier"):
        scans.frontier(replace(settings, **change), ["passive"], 4, directory=tmp_path)


def test_replicas_that_stand_are_held_against_no_phase_of_a_step(monkeypatch, tmp_path):
    def rows(env_id, task, jobs, workers, sources):
        tried = {"forces_N": [100.0], "recovered": ["11"], "stood": ["11"], "falls": []}
        return ({"policy": job.policy, "psi_deg": job.psi_deg, **tried} for job in jobs)

    monkeypatch.setattr(scans, "parallel", rows)
    for command, phases in ((AT_REST, False), (IN_PLACE, True)):
        settings = FrontierSettings("PushRecovery/Pendulum-v0", 20.0, command=command, replicas=2)
        found = scans.frontier(settings, ["passive"], 2, directory=tmp_path / str(phases))
        assert [limit.phases is not None for limit in found.limits.values()] == [phases] * 2


def test_the_grid_of_a_light_robot_is_a_newton_at_least(monkeypatch):
    """2 N of 3 kg round to no ten, 13.3 N of 20 kg to one, 66.7 N of 100 kg to seven."""
    for mass, grid in ((3.0, 1.0), (20.0, 10.0), (100.0, 70.0)):
        robot = SimpleNamespace(robot=SimpleNamespace(mass=mass))
        made = SimpleNamespace(unwrapped=robot, close=lambda: None)
        monkeypatch.setattr(scans, "make_env", lambda env_id, made=made: made)
        assert scans.default_grid("any", 2) == grid


def test_a_table_of_standing_replicas_has_a_cell_under_every_column():
    """Both take no step at 100 N, one of two at 200 N: 0.8 of them at 140 N, half of F*_stand."""
    one = {"policy": "p", "psi_deg": 0.0, "forces_N": [100.0, 200.0, 300.0], "falls": [],
           "recovered": ["11", "10", "00"], "stood": ["11", "10", "00"]}  # fmt: skip
    control = {"forces_N": [0.0], "recovered": ["11"], "stood": ["11"]}
    found = scans.Frontier(
        FrontierSettings("env", command=AT_REST, replicas=2), {"p": [one], "q": [one]},
        {0.0: limits.DirectionLimits(400.0, 200.0, 280.0)}, Path(), 60.0,
        {"p": control, "q": {**control, "recovered": ["10"]}},
    )  # fmt: skip
    table = report.frontier_table(found)
    assert {len(cells) for cells in table.rows} == {len(table.columns)}
    assert table.rows[-1] == ("unpushed", *"---", "2 of 2 recover", "1 of 2 recover", *"----")
    caught, low, high, share = re.findall(r"[\d.]+", table.rows[0][6])
    assert (caught, share) == ("140", "0.50")
    assert float(low) < 140.0 < float(high)


def test_an_impulse_is_the_force_for_as_long_as_the_push_lasts():
    """p is 1, 1, 1/2, 1/2, 0, linear between: 110 and 300 N, here for 0.2 s."""
    row = {"forces_N": [100.0, 200.0, 300.0, 400.0], "recovered": ["11", "10", "01", "00"]}
    control = {"forces_N": [0.0], "recovered": ["11"]}
    entry = replace(REPLICATED, replicas=2, duration=0.2).search.entry(row, control)
    assert (entry["J95_Ns"], entry["J50_Ns"]) == pytest.approx((22.0, 60.0))


def test_what_is_impossible_is_refused_before_anything_is_written(tmp_path):
    settings = FrontierSettings("PushRecovery/Pendulum-v0", errors=ModelErrors(payload=5.0))
    with pytest.raises(InvalidValueError, match=r"^the pendulum has no model error 'payload'"):
        scans.frontier(settings, ["stage-1"], 1, directory=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": "20"}, "grid [N] must be a number, got '20'"),
        ({"grid": 1e-12}, "grid [N] must be in [1, 4000], got 1e-12"),
        ({"duration": "0.1"}, "Push.duration [s] must be a number, got '0.1'"),
        ({"command": None}, "command must be a Command, got None"),
        ({"errors": {"mass": 0.1}}, "errors must be a ModelErrors, got {'mass': 0.1}"),
        ({"replicas": "8"}, "replicas must be an integer in [1, 4096], got '8'"),
        ({"body": "head"}, "unknown push body 'head' (valid: pelvis, trunk, left_thigh, left_shank, "
         "left_foot, right_thigh, right_shank, right_foot)"),
    ],
)  # fmt: skip
def test_settings_of_another_kind_are_refused(change, message):
    with pytest.raises(PushRecoveryError, match=f"^{re.escape(message)}$"):
        FrontierSettings("env", **change)


@pytest.mark.parametrize("count", [0, 3601, 1.5, "4"])
def test_directions_are_a_few(count):
    message = f"directions must be an integer in [1, 3600], got {count!r}"
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}$"):
        directions_deg(count)
