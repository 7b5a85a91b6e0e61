"""The tables of an evaluation and of profiles on rows written by hand, and on one push of the biped."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from push_recovery.controllers.settings import PresetFile
from push_recovery.controllers.whole_body.limits import LIMIT_NAMES
from push_recovery.envs.scenario.disturbances import Payload, Slip
from push_recovery.envs.scenario.push import Kick, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.output.tables import markdown_page
from push_recovery.eval.report import headline
from push_recovery.eval.rollout.outcome import recovered_after
from push_recovery.eval.rollout.policy_source import search_words
from push_recovery.eval.score import report
from push_recovery.eval.score.evaluate import Comparison, Evaluation, limit_summary
from push_recovery.eval.score.suites import Suite, get_suite

SCENARIOS = get_suite("standard").scenarios[:3]


def row(recovered_at, energy, **more):
    measures = {
        "steps": 10, "smallest_margin": 0.125, "margin_of_stability": -0.034,
        "dcm_error": 0.01, "velocity_error": 0.1,
        "trunk_excursion": math.radians(20.0), "heading_error": 0.1,
        "peak_torque": 150.0, "mean_torque": 12.34, "energy": energy,
    }  # fmt: skip
    kept = {"recovered": recovered_at is not None, "recovered_at": recovered_at, "end_time": 7.0}
    return {**kept, "measures": {**measures, **more}}


def three(**rows):
    return Evaluation(Suite("three", "1", SCENARIOS), "env", rows, Path("out"), 0.0)


def test_medians_are_over_the_pushes_that_all_policies_recover_from():
    found = three(
        p=[row(4.0, 1000.0), row(5.0, 9000.0), row(4.5, 3000.0, smallest_margin=None)],
        q=[row(5.5, 2000.0, steps=11), row(None, 1.0), row(6.5, 2500.0, steps=14)],
    )
    together, summary = report.effort_summary(found)
    assert (together, SCENARIOS[0].settle_time) == (2, 4.0)  # so that the last push ended at 3 s
    assert summary["p"]["recovered_after"] == pytest.approx((1.0 + 1.5) / 2)
    assert summary["q"]["recovered_after"] == pytest.approx((2.5 + 3.5) / 2)
    assert (summary["p"]["energy"], summary["q"]["energy"]) == (2000.0, 2250.0)
    assert (summary["p"]["smallest_margin"], summary["q"]["steps"]) == (0.125, 12.5)
    table = report.effort_table(found)
    assert table.columns == (
        "policy", "recovered after [s]", "steps", "smallest margin [cm]", "margin of stability [cm]",
        "largest lean [deg]",
        "off heading [deg]", "peak torque [N m]", "mean torque [N m]", "energy [kJ]",
    )  # fmt: skip
    assert table.rows == [
        ("p", "1.25", "10", "12.5", "-3.4", "20.0", "5.7", "150", "12.3", "2.00"),
        ("q", "3.00", "12", "12.5", "-3.4", "20.0", "5.7", "150", "12.3", "2.25"),
    ]
    assert "2 of 3 pushes" in table.note


def test_a_policy_that_recovers_from_nothing_hides_no_medians_of_the_others():
    found = three(
        p=[row(4.0, 1000.0), row(5.0, 9000.0), row(None, 1.0)],
        lost=[row(None, 5.0)] * 3,
        q=[row(5.5, 2000.0)] * 3,
    )
    together, summary = report.effort_summary(found)
    assert (together, summary["p"]["energy"], summary["q"]["energy"]) == (2, 5000.0, 2000.0)
    assert set(summary["lost"].values()) == {None}
    assert "2 of 3 pushes that every policy but lost (which recovers from none) recovers" in (
        report.effort_table(found).note
    )


def test_a_new_measure_is_one_entry(monkeypatch):
    lasted = report.Measure(None, "lasted", "ms", 0, 1e3, value=lambda row, scenario: row["end_time"])
    monkeypatch.setitem(report.MEASURES, "lasted", lasted)
    table = report.effort_table(three(p=[row(4.0, 1000.0)] * 3))
    assert (table.columns[-1], table.rows[0][-1]) == ("lasted [ms]", "7000")


def test_rows_that_tell_of_no_effort_make_no_table():
    bare = [row(4.0, 1.0) for _ in SCENARIOS]
    for one in bare:
        del one["measures"]
    assert not report.effort_table(three(p=bare))
    lost = three(p=[row(None, 1.0)] * 3)
    assert report.effort_summary(lost)[0] == 0
    assert not report.effort_table(lost)


def test_recovery_during_the_push_counts_as_at_once():
    assert SCENARIOS[0].settle_time == 4.0
    assert recovered_after(row(2.9, 1.0), SCENARIOS[0]) == 0.0
    assert recovered_after(row(None, 1.0), SCENARIOS[0]) is None


FORCE = (100.0, 0.0, 0.0)
PELVIS, TRUNK = Push(FORCE, 0.1, 1.0), Push(FORCE, 0.1, 1.0, "trunk")
EVERY_KIND = (
    Scenario("a", (PELVIS,)),
    Scenario("b", (TRUNK,), Command(0.1)),
    Scenario("c", (TRUNK, TRUNK), Command(0.1)),
    Scenario("d", (PELVIS, TRUNK), Command(-0.1)),
)


def test_recovered_and_survived_are_counted_in_each_group():
    words = {"a": (True, True), "b": (True, True), "c": (False, False), "d": (False, True)}
    rows = [{"recovered": recovered, "survived": survived} for recovered, survived in words.values()]
    lost = [{"recovered": False, "survived": False}] * 4
    found = Evaluation(Suite("kinds", "1", EVERY_KIND), "env", {"p": rows, "q": lost}, Path("out"), 0.0)
    table = report.kinds_table(found)
    assert table.columns == ("kind of push", "pushes", "p", "q")
    assert {group: (count, of_p) for group, count, of_p, _ in table.rows} == {
        "pelvis": ("1", "1/1"),
        "pelvis and trunk": ("1", "0/1"),
        "trunk": ("2", "1/1"),
        "double": ("2", "0/1"),
        "single": ("2", "2/2"),
        "backward": ("1", "0/1"),
        "forward": ("2", "1/1"),
        "in place": ("1", "1/1"),
    }
    assert table.rows[0][3] == "0/0"


def test_a_kind_of_one_group_only_tells_nothing():
    """All of `standard` are single pushes at the pelvis."""
    groups = report.groups_of(get_suite("standard").scenarios)
    assert set(groups) == {"backward", "forward", "in place", "sideways"}
    assert report.groups_of(EVERY_KIND[:1]) == {}


def stander(recovered, soles, lift_off, steps=0):
    measures = {"soles_margin": soles, "lift_off_margin": lift_off, "steps": steps}
    return {"recovered": recovered, "measures": measures}


def test_strategies_of_robots_that_stood():
    """Ankles where the soles were enough, hips where not, a step where a foot lifted, needless above 0."""
    ankles, hips = [stander(True, 0.02, None), stander(True, 0.0, None)], [stander(False, -0.01, None)]
    steps = [stander(True, -0.2, -0.01, 2), stander(False, 0.05, 0.02, 7), stander(True, -0.1, -0.03, 4)]
    table = report.strategies_table(three(p=[*ankles, *hips, *steps], q=ankles))
    assert table.columns == ("policy", "ankle", "hip", "step", "median steps", "needless")
    assert table.rows == [
        ("p", "2 of 2", "0 of 1", "2 of 3", "4", "1 of 3"), ("q", "2 of 2", "0 of 0", "0 of 0", "-", "0 of 0")
    ]  # fmt: skip
    assert not report.strategies_table(three(p=[row(4.0, 1.0)]))
    beside = report.strategies_table(three(p=ankles, q=[row(4.0, 1.0)]))  # which stepped in place
    nothing = "0 of 0", "0 of 0", "-", "0 of 0"
    assert beside.rows == [("p", "2 of 2", *nothing), ("q", "0 of 0", *nothing)]


def test_recovered_survived_and_why_not(evaluation):
    found = evaluation({"p": "srrff"})
    found.rows["p"][4]["failure_reason"] = "of_its_own"
    found.rows["q"] = found.rows["p"][3:]
    # Wilson (1927) of 2 of 5 and of 0 of 2, z = 1.959964
    assert report.rates_table(found).rows == [
        ("p", "2/5", "0.400", "0.118-0.769", "3", "-", "0"),
        ("q", "0/2", "0.000", "0.000-0.658", "0", "-", "-")
    ]  # fmt: skip
    assert report.reasons_of(found) == ["not_settled", "com_height", "of_its_own"]
    assert report.reasons_table(found).rows == [
        ("p", "2", "1", "1", "1", "CoP 2"), ("q", "0", "0", "1", "1", "CoP 2")
    ]  # fmt: skip


def test_how_much_search_found_a_policy_is_a_column_where_it_is_known(evaluation, tmp_path):
    preset = tmp_path / "mine.json"
    PresetFile("biped", {}, {}, {}, {"trials": {"two-stage": 188, "raibert": 7}}).save(preset)
    own, taught = (str(tmp_path / f"{name}.safetensors") for name in ("own", "taught"))
    for path, timesteps in ((own, 2_345_000), (taught, 0)):
        Path(path).touch()
        Path(path).with_suffix(".json").write_text(json.dumps({"training": {"timesteps": timesteps}}))
    found = replace(evaluation({"p": "rr"}), env_id=f"PushRecovery/Biped-v0@{preset}")
    names = ("two-stage", "raibert", "stage-1", own, taught, "joint-residual", "no/such/file.safetensors")
    found = replace(
        found, rows={name: [{**row, "policy": name} for row in found.rows["p"]] for name in names}
    )
    table = report.rates_table(found)
    assert table.columns[-1] == "found by"
    assert [cells[-1] for cells in table.rows] == [
        "188 trials", "7 trials", "-", "2.3 M actions", "imitation", "12.0 M actions, quick, hard", "-"
    ]  # fmt: skip
    assert "trials of the search" in table.note
    shipped = replace(found, env_id="PushRecovery/Biped-v0")
    trials = {"two-stage": 188, "raibert": 69, "stage-1": 16}
    cells = {name: own for name, *_, own in report.rates_table(shipped).rows}
    assert {name: cells[name] for name in trials} == {
        name: f"{count} trials" for name, count in trials.items()
    }
    beside = report.beside_table({"exact": found, "hardware": found})
    assert beside.columns[-1] == "found by"
    assert [cells[-1] for cells in beside.rows] == [cells[-1] for cells in table.rows]
    assert "trials of the search" in beside.note
    first, *others = found.rows["joint-residual"]
    mixed = replace(found, rows={"ceiling": [first, *({**row, "policy": "raibert"} for row in others)]})
    assert report.rates_table(mixed).columns[-1] == "bent"  # rows of several policies come from none of them
    page = headline.rates_table(found)
    assert ([cells[-1] for cells in page.rows], page.columns[-1]) == (
        [row[-1] for row in table.rows],
        "found by",
    )
    nothing = report.rates_table(replace(found, rows={"stage-1": found.rows["stage-1"]}))
    assert nothing.columns[-1] == "bent"
    assert "trials" not in nothing.note


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"pushes": {"bodies": ["pelvis", "trunk", "pelvis"]}}, "pelvis and trunk"),
        ({"pushes": {"bodies": ["pelvis", "trunk", "left_foot"]}, "like": None}, "3 bodies"),
        ({"pushes": {"bodies": ["pelvis"]}, "like": ["quick", "quick", "hard"]}, "quick, hard"),
        ({"pushes": {}}, "pelvis"),  # before there were others
    ],
)
def test_a_table_says_what_a_training_met(settings, words, tmp_path):
    (tmp_path / "own.safetensors").touch()
    note = {"training": {"timesteps": 600_000, "settings": settings}}
    (tmp_path / "own.json").write_text(json.dumps(note))
    assert search_words(str(tmp_path / "own.safetensors"), {}) == f"0.6 M actions, {words}"


@pytest.mark.parametrize(
    "settings", [[1], "quick", {"pushes": None}, {"pushes": {"bodies": 3}}, {"pushes": {"bodies": [3]}}, None]
)
def test_a_strange_note_of_a_training_says_nothing_of_what_it_met(settings, tmp_path):
    (tmp_path / "own.safetensors").touch()
    note = {"training": {"timesteps": 600_000, "settings": settings}}
    (tmp_path / "own.json").write_text(json.dumps(note))
    assert search_words(str(tmp_path / "own.safetensors"), {}) == "0.6 M actions"


@pytest.mark.parametrize("timesteps", [10**400, True, "1"])
def test_a_strange_number_of_timesteps_says_nothing(timesteps, tmp_path):
    (tmp_path / "own.safetensors").touch()
    (tmp_path / "own.json").write_text(json.dumps({"training": {"timesteps": timesteps}}))
    assert search_words(str(tmp_path / "own.safetensors"), {}) == "-"


def limit_row(survived, first, **shares):
    return {"survived": survived, "recovered": survived, "first_limit": first, "limit_shares": shares,
            "failure_reason": None if survived else "low"}  # fmt: skip


LIMIT_ROWS = [
    limit_row(False, "cop", cop=0.5, contact=0.2),
    limit_row(False, "contact", contact=0.4),
    limit_row(False, "cop", cop=0.1),
    limit_row(True, "cop", cop=0.2),
    limit_row(True, None),
    {**limit_row(True, "contact", contact=0.9), "recovered": False},  # stands unsettled: neither
]


def test_limits_are_told_of_falls_and_of_recoveries(evaluation):
    assert set(report.LIMITS) == set(LIMIT_NAMES)  # every one has words
    found = replace(evaluation({"p": "fffrrs"}), rows={"p": LIMIT_ROWS, "q": [LIMIT_ROWS[4]] * 6})
    summary = limit_summary(LIMIT_ROWS)
    assert summary["falls"]["cop"] == {"first": 2, "met": pytest.approx(2 / 3), "time": pytest.approx(0.2)}
    assert summary["recovered"] == {"cop": {"first": 1, "met": 0.5, "time": 0.1}}
    assert report.first_limits(LIMIT_ROWS) == "CoP 2, contact 1"
    assert report.first_limits(LIMIT_ROWS[3:]) == "-"
    assert report.reasons_table(found).rows[0] == ("p", "2", "1", "3", "CoP 2, contact 1")
    assert report.reasons_table(found).columns[2:4] == ("did not settle", "low")
    table = report.limits_table(found)
    assert table.columns == ("limit", "met while", "p", "q")
    assert table.rows == [
        ("CoP", report.LIMITS["cop"], "20/10", "0/0"),
        ("contact", report.LIMITS["contact"], "20/0", "0/0"),
    ]
    of_p, of_q = report.limit_details(found)
    assert of_p.columns == (
        "limit", "first in falls", "met in falls", "time in falls", "met in recovered", "time in recovered"
    )  # fmt: skip
    assert of_p.rows == [
        ("CoP", "2", "0.67", "0.20", "0.50", "0.10"), ("contact", "1", "0.67", "0.20", "0.00", "0.00")
    ]  # fmt: skip
    assert not of_q


def test_a_report_has_the_tables_that_have_rows(evaluation):
    found = evaluation({"p": "srrff"})
    names = ["rates", "pairs", "kinds", "strategies", "effort", "reasons", "limits"]
    assert list(report.evaluation_tables(found)) == names
    text = markdown_page("Evaluation", report.evaluation_tables(found).values())
    assert text.startswith(f"# Evaluation\n\n## {found.env_id}: suite head v1, 5 pushes, sha256 ")
    assert "| p | 2/5 | 0.400 | 0.118-0.769 | 3 | - | 0 |\n\nRecovered: " in text
    assert "## Pairs" not in text
    assert "## Why pushes are lost" in text


@pytest.fixture
def profiles(evaluation):
    """Of one policy on four pushes: the second one loses two recoveries and gains one."""
    return {"exact": evaluation({"p": "rrrs"}), "hardware": evaluation({"p": "rsfr"})}


def test_recovered_and_survived_of_each_profile_stand_side_by_side(profiles):
    table = report.beside_table(profiles)
    assert table.columns == (
        "policy", "recovered, exact", "survived", "turned", "bent",
        "recovered, hardware", "survived", "turned", "bent",
    )  # fmt: skip
    # Wilson (1927), z = 1.959964: 3 of 4 and 2 of 4
    assert table.rows == [
        ("p", "0.750 (0.301-0.954)", "1.000", "-", "0", "0.500 (0.150-0.850)", "0.750", "-", "0")
    ]
    for one in profiles["exact"].rows["p"][:2]:  # 1.6 rad is 91.7 degrees, 0.6 rad 34.4
        one["measures"] |= {"trunk_excursion": 1.6, "heading_error": 0.6}
    assert report.beside_table(profiles).rows[0][3:5] == ("2", "2")


def test_a_comparison_counts_who_turned_or_bent(evaluation):
    found = evaluation({"p": "rrrf", "q": "rrff"})
    for one in found.rows["p"][:3]:
        one["measures"] |= {"trunk_excursion": 1.6, "heading_error": 0.6}
    for one in found.rows["q"]:  # two of these fell
        one["measures"] |= {"trunk_excursion": 0.3, "heading_error": 0.6}
    table = report.comparison_table(Comparison("p", "q", found))
    cells = dict(table.rows)
    assert (cells["turned p, q"], cells["bent p, q"]) == ("3, 2", "3, 0")


def test_what_is_kept_is_a_share_of_its_own(profiles, evaluation, tmp_path):
    exact, real = profiles.values()
    assert report.kept_table(exact, real, "").rows == [("p", "0.667", "0.750", "2", "1", "1")]
    nothing = evaluation({"p": "ffff"})
    assert report.kept_table(nothing, real, "").rows == [("p", "-", "-", "0", "2", "0.5")]
    page = report.write_profiles(profiles, tmp_path).read_text()
    assert "## hardware against exact" in page
    assert "| p | 0.667 | 0.750 | 2 | 1 | 1 |" in page
    assert "against" not in report.write_profiles({"exact": exact}, tmp_path).read_text()


def test_the_command_runs_a_suite_under_several_profiles(tmp_path, capsys):
    Suite("one", "1", (Scenario("a", (polar_push(100.0, 0.0, 0.1, 0.2),)),)).save(tmp_path / "one.json")
    argv = ["evaluate", "--suite", str(tmp_path / "one.json"), "--policies", "stage-1", "--workers", "1"]
    out = ["--out", str(tmp_path / "out")]
    assert main([*argv, *out, "--profile", "exact", "hardware", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["profiles"]
    assert [told[name]["suite"]["name"] for name in ("exact", "hardware")] == ["one", "one+hardware"]
    rows = [
        json.loads((tmp_path / "out" / name / "outcomes.jsonl").read_text()) for name in ("exact", "hardware")
    ]
    assert rows[0]["total_reward"] != rows[1]["total_reward"]
    assert main([*argv, *out, "--profile", "exact", "hardware"]) == 0  # of the rows that are there
    said = capsys.readouterr().out
    assert "recovered, hardware" in said
    assert str(tmp_path / "out" / "profiles-exact-hardware.md") in said
    assert (tmp_path / "out" / "hardware" / "report.md").is_file()


def test_the_command_runs_a_sample_of_several_suites(tmp_path, capsys):
    """Evenly spread; each suite has results and a page of its own, and one table shows them all."""
    argv = ["evaluate", "--suite", "quick", "hard", "--sample", "2", "--policies", "stage-1", "passive"]
    out = ["--workers", "1", "--out", str(tmp_path)]
    assert main([*argv, *out, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["suites"]
    assert [(name, told[name]["suite"]["scenarios"]) for name in told] == [("quick-2", 2), ("hard-2", 2)]
    assert main([*argv, *out]) == 0  # of the rows that are there
    said = capsys.readouterr().out
    assert "PushRecovery/Biped-v0: 2 suites" in said
    assert said.index("recovered, quick-2") < said.index("recovered, hard-2")
    for suite, ids in {"quick": {"quick-0000", "quick-0128"}, "hard": {"hard-0000", "hard-0512"}}.items():
        rows = (tmp_path / f"{suite}-2/outcomes.jsonl").read_text().splitlines()
        assert {json.loads(row)["scenario_id"] for row in rows} == ids
        page = (tmp_path / f"{suite}-2/report.html").read_text()
        assert f"push-recovery evaluate --suite {suite} --sample 2 --policies stage-1 passive" in page
        assert (
            f"<span>--suite</span> <span>{suite}</span> <span>--scenario</span>" in page
        )  # to play one again


def test_suites_are_named_once_and_have_names_of_their_own(tmp_path, capsys):
    one = Suite("one", "1", (Scenario("a", (polar_push(100.0, 0.0, 0.1, 0.2),)),))
    for name in ("a", "b"):
        one.save(tmp_path / f"{name}.json")
    for names, words in {
        ("hard", "hard"): "--suite must name each one once, got hard hard",
        (str(tmp_path / "a.json"), str(tmp_path / "b.json")): "two suites of --suite are called 'one'",
    }.items():
        assert main(["evaluate", "--suite", *names, "--out", str(tmp_path / "out")]) == 2
        assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("names", "words"),
    [(["exact", "exact"], "--profile must name each one once"), (["real"], "exact, collisions, hardware")],
)
def test_profiles_are_known_and_named_once(names, words, capsys):
    assert main(["evaluate", "--profile", *names]) == 2
    assert words in capsys.readouterr().err


def test_a_profile_that_an_environment_cannot_have_is_refused_before_any_is_scored(tmp_path, capsys):
    pendulum = ["--env", "PushRecovery/Pendulum-v0", "--out", str(tmp_path / "out")]
    assert main(["evaluate", *pendulum, "--profile", "exact", "weighed"]) == 2
    assert "the pendulum has no sensors" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_disturbances_are_a_row_each_for_every_policy():
    """And a body counts where a force acts on it alone."""
    scenarios = (
        Scenario("a", (Push((100.0, 0.0, 0.0), 0.1, 1.0),)),
        Scenario("b", disturbances=(Slip("left", 0.1, 1.0, 0.3),)),
        Scenario("c", disturbances=(Payload(5.0, 0.5, 1.0),)),
        Scenario("d", disturbances=(Slip("right", 0.1, 1.0, 0.3),)),
    )
    assert report.groups_of(scenarios) == {
        "payload": ("c",), "push": ("a",), "slip": ("b", "d"),
        "none": ("b", "d"), "pelvis": ("a",), "trunk": ("c",),
    }  # fmt: skip
    rows = [{"recovered": i < 2, "survived": i < 3} for i in range(4)]
    found = Evaluation(Suite("four", "1", scenarios), "env", {"p": rows, "q": rows[::-1]}, Path("out"), 0.0)
    assert ("slip", "2", "1/1", "1/2") in report.kinds_table(found).rows


@pytest.mark.parametrize(
    ("times", "words"), [((2.0,), "until 2 s after"), ((2.0, 3.5, 2.5), "until 2 to 3.5 s after")]
)
def test_the_note_has_the_time_that_the_scenarios_settle_for(times, words):
    scenarios = tuple(Scenario(f"s{i}", settle_time=time) for i, time in enumerate(times))
    evaluation = SimpleNamespace(suite=SimpleNamespace(scenarios=scenarios))
    assert f"Recovered: no fall {words} the last push; over" in report.recovered_note(evaluation)
    timed = SimpleNamespace(suite=SimpleNamespace(scenarios=(Scenario("t", duration=5.0),)))
    assert "Recovered: no fall until the end; over" in report.recovered_note(timed)


def test_a_comparison_tells_whose_each_count_is(evaluation):
    """p of 3 : 1 is 2 (1 + 4) / 2^4."""
    found = evaluation({"p": "rrrrfff", "q": "rfffrsf"})
    cells = dict(report.comparison_table(Comparison("p", "q", found)).rows)
    names = "both recovered", "only p", "only q", "neither", "survived p, q", "exact McNemar p"
    assert [cells[name] for name in names] == ["1", "3", "1", "2", "4, 3", "0.625"]
    assert cells["rate of p minus rate of q"].startswith("+0.286 (")


def test_what_a_recovery_took_is_of_timed_scenarios_too_but_not_how_long_it_took():
    timed = replace(SCENARIOS[1], duration=9.0)
    rows = [row(4.0, 1000.0), row(5.0, 9000.0), row(4.5, 2000.0)]
    suite = Suite("three", "1", (SCENARIOS[0], timed, SCENARIOS[2]))
    together, summary = report.effort_summary(Evaluation(suite, "env", {"p": rows}, Path("out"), 0.0))
    assert (together, summary["p"]["energy"]) == (3, 2000.0)
    apart = Suite("two", "1", (SCENARIOS[0], SCENARIOS[2]))
    _, two = report.effort_summary(Evaluation(apart, "env", {"p": rows[::2]}, Path("out"), 0.0))
    assert summary["p"]["recovered_after"] == two["p"]["recovered_after"]


def test_limits_in_a_report_are_each_policys_own(evaluation):
    found = evaluation({"p": "fffrrs", "q": "rrrrrr"})
    found = replace(found, rows={"p": LIMIT_ROWS, "q": [LIMIT_ROWS[4]] * 6})
    report.write_evaluation_reports(found, found)
    content = json.loads((found.directory / "report.json").read_text())["policies"]
    assert content["p"]["limits"]["falls"]["cop"]["first"] == 2
    assert content["q"]["limits"] == {"falls": {}, "recovered": {}}


def test_kicks_are_a_kind_of_push():
    groups = report.groups_of((Scenario("a", (PELVIS,)), Scenario("b", kicks=(Kick((0.3, 0.0, 0.0), 2.0),))))
    assert (groups["kick"], groups["push"]) == (("b",), ("a",))


def test_intervals_of_pairs_and_comparisons_are_newcombes_low_end_first(evaluation):
    """Newcombe (1998): both 36, only p 12, only q 2, neither 0: 0.0569 to 0.3404."""
    found = evaluation({"p": "r" * 48 + "f" * 2, "q": "r" * 36 + "f" * 12 + "r" * 2})
    assert report.pairs_table(found).rows[0][:6] == (
        "p and q", "36", "12", "2", "0", "+20.0 (+5.7 to +34.0)"
    )  # fmt: skip
    cells = dict(report.comparison_table(Comparison("p", "q", found)).rows)
    assert cells["rate of p minus rate of q"] == "+0.200 (+0.057 to +0.340)"
