"""What the sections make of their rows, and the command around them."""

import json
import re
from functools import partial

import pytest
from push_recovery.eval.cli.main import main
from push_recovery.eval.reproduction import figures, scenarios, studies
from push_recovery.eval.reproduction.jobs import CaseJob, EpisodeJob, ScanJob, key
from push_recovery.eval.reproduction.page import table_text
from push_recovery.eval.reproduction.pendulum import Variant
from push_recovery.eval.reproduction.run import SECTIONS, reproduce
from push_recovery.eval.reproduction.scenarios import SCENARIO_1, SCENARIO_2
from push_recovery.eval.reproduction.studies import ABLATIONS


def rows_of(jobs, value):
    """Rows as they would be if every scan gave `value(job)` and every push were survived below 400 N."""
    rows = {}
    for job in jobs:
        if isinstance(job, ScanJob):
            found = value(job)
            rows[key(job)] = {"survived": found, "largest_survived": found + (job.push.psi_deg == 30.0)}
        elif isinstance(job, CaseJob):
            rows[key(job)] = {"key": key(job), "label": job.text, **job.identity(), "final_lean": 0.5}
        elif isinstance(job, EpisodeJob):
            paper = job.variant.policy == "stage-1-paper"
            rows[key(job)] = {"survived": not paper, "recovered": not paper}
    return rows


def test_scenario_2_in_short():
    """Variants at a known share of F*: 0.25 for stage 1, 0.5 for others, 0.4 inward and 0.9 to the front."""

    def value(job):
        share = 0.25 if job.variant.label == "stage-1" else 0.4 if 45 <= job.push.psi_deg <= 135 else 0.5
        share = 0.9 if job.variant.label == "two-stage" and job.push.psi_deg == 0 else share
        return share * job.push.limit(job.variant)

    content = SCENARIO_2.summary(rows_of(SCENARIO_2.jobs(12), value), 12)
    short = content["scenario_2_overview"]["two-stage"]
    assert short["fraction_mean"] == pytest.approx((0.9 + 3 * 0.4 + 8 * 0.5) / 12)
    assert (short["fraction_worst"], short["worst_psi_deg"]) == (pytest.approx(0.4), 60.0)
    assert short["ratio_to_stage_1_min"] == pytest.approx(1.6)
    assert short["ratio_to_stage_1_min_inward"] == pytest.approx(1.6)
    assert content["jump_overview"]["two-stage"]["fraction_worst"] == pytest.approx(0.4)
    assert {hole["psi_deg"] for hole in content["scenario_2_holes"]} == {30.0}
    for entry in content["scenario_2"]["two-stage"]:
        assert set(entry) == {"psi_deg", "max_force_N", "limit_N"}
    assert content["scenario_2"]["two-stage"][9]["limit_N"] == pytest.approx(641.5, abs=0.1)


def test_scenario_1_reports_the_open_parameters():
    def value(job):
        wider = 300.0 + 1000 * dict(job.variant.robot).get("foot_width", 0.1)
        return 60.0 if job.variant.policy == "stage-1-paper" else wider

    content = SCENARIO_1.summary(rows_of(SCENARIO_1.jobs(1), value), 1)
    assert content["scenario_1"]["stage-1-paper"] == {"recovers_315_N": False, "max_force_N": 60.0}
    assert content["scenario_1"]["two-stage"] == {"recovers_315_N": True, "max_force_N": 400.0}
    assert content["scenario_1_limits_N"]["point foot"] == pytest.approx(315.9, abs=0.05)
    assert content["scenario_1_interval"]["two-stage"]["max_force_N"] == [380.0, 430.0]
    together = content["scenario_1_together"]
    assert set(together["two-stage-paper"]) == {"repaired", "literal"}
    alone = together["stage-1-paper"]["none"]
    assert (alone["combinations"], alone["recovered"], len(alone["does_not_recover"])) == (32, 0, 32)


def test_ablations_measure_against_the_robot_of_the_row():
    content = ABLATIONS.summary(rows_of(ABLATIONS.jobs(1), lambda job: 0.5 * job.push.limit(job.variant)), 1)
    assert {table["parameter"].split(" [")[0] for table in content["ablations"]} >= {
        "alpha_offset", "beta_dcm", "beta_trunk", "beta_cop", "sampling_time", "tail_intervals", "foot_width",
        "pelvis_width", "control period", "the step adapts", "DCM noise", "delay",
    }  # fmt: skip
    for table in content["ablations"]:
        for case in table["cases"]:
            assert case["fraction_mean"] == pytest.approx(0.5)
    feet = next(t for t in content["ablations"] if t["parameter"].startswith("foot_width"))
    assert feet["cases"][-1]["limit_N"][0] > feet["cases"][0]["limit_N"][0] + 50


def test_a_step_that_adapts_its_place_only_keeps_its_time():
    found = dict(studies.adaptation_sweep(Variant("two-stage", "two-stage")).cases)
    kept = {name: dict(variant.planner) for name, variant in found.items()}
    assert kept == {
        "place and time": {},
        "place only": {"adapt_duration": False},
        "time only": {"adapt_step": False},
        "neither": {"adapt_duration": False, "adapt_step": False},
    }


def test_every_job_has_its_own_row_and_a_label():
    for section in SECTIONS:
        jobs, by_key = list(section.jobs(4)), {}
        for job in jobs:
            assert by_key.setdefault(key(job), job.identity()) == job.identity()
            assert job.text
        assert json.loads(json.dumps([job.identity() for job in jobs[:3]]))
    assert [section.name for section in SECTIONS] == ["scenario-1", "scenario-2", "ablations", "limits"]


def test_scenario_1_draws_its_figures_in_both_folders(monkeypatch, tmp_path):
    """Cases (a) and (b) with the paper's weights, then with the scaled ones."""
    seen = {}

    def draw(walks, directory, name):
        labels = [walk.label for walk in walks]
        seen.setdefault(directory.relative_to(tmp_path).as_posix(), []).append((name, labels))
        return directory / name if name == "save_film" else [directory / name]

    names = ("draw_paths", "draw_histories", "draw_cartoon", "save_film")
    for name in names:
        monkeypatch.setattr(figures, name, partial(draw, name=name))
    paths = SCENARIO_1.draw({}, tmp_path)
    assert len(paths) == 2 * len(names)
    assert seen == {
        ".": [(name, ["stage-1-paper", "two-stage-paper"]) for name in names],
        "scaled-weights": [(name, ["stage-1", "two-stage"]) for name in names],
    }


def test_brackets_in_tables_are_units(capsys):
    content = ABLATIONS.summary(rows_of(ABLATIONS.jobs(1), lambda job: 100.0), 1)
    table = next(t for t in ABLATIONS.tables(content) if "foot_width" in t.title)
    table.print()
    assert "foot_width [m]" in capsys.readouterr().out
    title = "**two-stage: largest force [N] by foot_width [m]**"
    assert table_text(table).startswith(f"{title}\n\n| foot_width [m] |")


@pytest.fixture
def small(monkeypatch):
    """Sections that take a second."""
    monkeypatch.setattr(studies, "CHECKED", 2)
    for name in ("VARIANTS", "JUMP_VARIANTS"):
        monkeypatch.setattr(scenarios, name, (Variant("stage-1", "stage-1"),))
    monkeypatch.setattr(scenarios, "EXTRA_VARIANTS", ())


@pytest.mark.parametrize(("asked", "solved"), [(4, 4), (8, 8), (36, 12)])
def test_the_programs_are_solved_in_the_directions_asked_for_up_to_twelve(asked, solved):
    angles = {job.psi_deg for job in studies.limit_jobs(asked)}
    assert angles == {360.0 * k / solved for k in range(solved)}


def test_the_command_resumes_with_the_same_numbers(small, tmp_path, capsys):
    argv = ["reproduce", "limits", "--workers", "1", "--directions", "4", "--out", str(tmp_path)]
    assert main([*argv, "--json"]) == 0
    first = capsys.readouterr().out
    content = json.loads(first)
    assert set(content) == {"limits"}
    for entry in content["limits"]["program"]:
        assert entry["largest_difference"] < 0.2
        assert entry["unsolved"] == 0
    rows = (tmp_path / "outcomes.jsonl").read_bytes()
    whole = (tmp_path / "reproduction.json").read_bytes()
    assert main([*argv, "--json"]) == 0
    assert capsys.readouterr().out == first
    assert main([*argv, "--overwrite"]) == 0
    assert "reproduction.json" in capsys.readouterr().out
    assert (tmp_path / "outcomes.jsonl").read_bytes() == rows
    assert (tmp_path / "reproduction.json").read_bytes() == whole


def test_sections_share_a_directory(small, tmp_path):
    reproduce("limits", 4, directory=tmp_path)
    found = reproduce("scenario-2", 2, directory=tmp_path)
    assert set(json.loads((tmp_path / "reproduction.json").read_text())) > {"limits", "scenario_2", "jump"}
    assert "limits" not in found.content
    entries = found.content["scenario_2"]["stage-1"]
    assert [entry["psi_deg"] for entry in entries] == [0.0, 180.0]
    assert entries[0]["max_force_N"] == entries[1]["max_force_N"] > 600
    names = {path.name for path in found.pictures}
    assert {"fig7_limits.png", "fig7_limits.svg", "fig7_jump.png"} <= names
    text = (tmp_path / "tables.md").read_text()
    assert "Scenario 2" in text
    assert "Closed-form limits" in text


def test_a_part_of_the_paper_keeps_the_others_on_the_page(small, tmp_path):
    pytest.importorskip("jinja2", reason="needs the extra report")
    words = ["--directions", "1", "--workers", "1", "--out", str(tmp_path)]
    assert main(["reproduce", "limits", *words]) == 0
    first = (tmp_path / "report.html").read_text()
    assert main(["reproduce", "scenario-2", *words]) == 0
    both = (tmp_path / "report.html").read_text()
    captions = [one for one in re.findall(r"<h[34]>.*?</h[34]>|<figcaption>.*?</figcaption>", first) if one]
    assert captions
    assert all(one in both for one in captions)
    assert len(both) > len(first)
    assert "<span>push-recovery</span> <span>reproduce</span> <span>--directions</span>" in both


@pytest.mark.parametrize(
    ("argv", "text"),
    [
        (["nonsense"], "one of ('all', 'scenario-1', 'scenario-2', 'ablations', 'limits'"),
        (["limits", "--directions", "0"], "must be an integer in [1, 3600], got 0"),
        (["limits", "--out", ""], "must name a directory"),
    ],
)
def test_bad_input_is_one_line_and_2(argv, text, capsys):
    assert main(["reproduce", *argv]) == 2
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1


def test_rows_of_other_code_are_refused(small, tmp_path, capsys):
    (tmp_path / "config.json").write_text('{"reproduce": "other"}')
    assert main(["reproduce", "limits", "--workers", "1", "--out", str(tmp_path)]) == 2
    assert "holds results of another configuration" in capsys.readouterr().err


def test_tables_of_scenario_1_hold_each_number_in_its_column():
    case = {"parameter": "l_p [m]", "value": "0.2", "recovers_315_N": True, "max_force_N": 70.0,
            "limit_N": 640.0, "point_foot_limit_N": 316.0}  # fmt: skip
    sway = {"beta_3": 0.01, "max_force_N": 390.0, "peak_lean_within_1_s": 0.5, "peak_lean": 0.7,
            "final_lean": 0.2}  # fmt: skip
    tables = scenarios.tables_1({
        "scenario_1": {"a": {"recovers_315_N": False, "max_force_N": 60.0}},
        "scenario_1_limits_N": {"F*": 641.47},
        "scenario_1_interval": {"a": {"max_force_N": [50.0, 70.0], "cases": [case]}},
        "scenario_1_together": {"a": {"none": {"combinations": 9, "survived": 7, "recovered": 5}}},
        "scenario_1_sway": [sway],
    })  # fmt: skip
    assert [list(table.rows) for table in tables] == [
        [("a", "no", "60"), ("limit: F*", "", "641.5")],
        [("l_p [m]", "0.2", "yes", "70", "316", "640")],
        [("a", "none", "9", "7", "5")],
        [("0.01", "390", "0.50", "0.70", "0.20")],
    ]


def test_differences_of_either_sign_and_the_worst_share_are_told(monkeypatch):
    """A program 5 N below the closed form, one without an answer; shares of 1/2 but for one of 1/4."""
    monkeypatch.setattr(studies, "CHECKED", 2)
    jobs = list(studies.limit_jobs(2))
    rows = {}
    for job in jobs:
        cut, options = studies.KINDS[job.kind]
        rows[key(job)] = {"strength": studies.PushKind(job.psi_deg, cut).limit(Variant("x"), **options)}
    rows[key(jobs[0])]["strength"] -= 5.0
    rows[key(jobs[1])]["strength"] = None
    first = studies.limit_summary(rows, 2)["limits"]["program"][0]
    assert (first["largest_difference"], first["unsolved"]) == (pytest.approx(5.0), 1)
    monkeypatch.setattr(studies, "sweeps", lambda: (studies.robot_sweep("foot_width", (0.10,)),))

    def share(job):
        return (0.25 if job.push.psi_deg == 90 else 0.5) * job.push.limit(job.variant)

    content = studies.ablation_summary(rows_of(studies.ablation_jobs(1), share), 1)
    assert studies.ablation_tables(content)[0].rows[0][-2:] == ("0.450", "0.250")  # (4 x 0.5 + 0.25) / 5


def test_overwriting_leaves_no_section_or_picture_of_before(small, tmp_path):
    (tmp_path / "reproduction.json").write_text('{"scenario_2": {}}')
    (tmp_path / "fig3_paths.png").touch()
    reproduce("limits", 1, directory=tmp_path, overwrite=True)
    assert set(json.loads((tmp_path / "reproduction.json").read_text())) == {"limits"}
    assert not (tmp_path / "fig3_paths.png").exists()


@pytest.mark.parametrize("forces", [(150, 200, 300, 250, 180, 320), (150, 260, 300, 200, 180, 320)])
def test_inward_is_from_45_to_135_degrees_and_no_ratio_is_to_nothing(forces):
    def entries(largest):
        angles = (0.0, 45.0, 90.0, 135.0, 180.0, 270.0)
        return [{"psi_deg": psi, "max_force_N": force, "limit_N": 400.0}
                for psi, force in zip(angles, largest, strict=True)]  # fmt: skip

    section = {"stage-1": entries((100, 100, 100, 100, 100, 0)), "x": entries(forces)}
    found = scenarios.overview(section, "N")["x"]
    assert found["ratio_to_stage_1_min"] == pytest.approx(1.5)
    assert found["ratio_to_stage_1_min_inward"] == pytest.approx(2.0)
    assert (found["fraction_worst"], found["worst_psi_deg"]) == (pytest.approx(0.375), 0.0)


def test_measurements_are_told_in_mm_and_ms_and_noise_is_tried_on_three_seeds():
    noise, delay = studies.measurement_sweeps(Variant("two-stage", "two-stage"))
    assert [(text, one.dcm_noise) for text, one in noise.cases] == [
        ("0", 0.0), ("0.5", 0.0005), ("1", 0.001), ("2", 0.002), ("5", 0.005), ("10", 0.01)
    ]  # fmt: skip
    assert [(text, one.delay) for text, one in delay.cases] == [
        ("0", 0), ("10", 1), ("20", 2), ("30", 3), ("50", 5)
    ]  # fmt: skip
    assert [studies.scan_job(one, 0.0).seeds for _, one in noise.cases[:2]] == [(0,), (0, 1, 2)]
    control = next(one for one in studies.sweeps() if one.parameter == "control period [ms]")
    rates = {text: one.control_hz for text, one in control.cases}
    assert rates == pytest.approx({"2": 500.0, "5": 200.0, "10": 100.0, "20": 50.0, "50": 20.0})


def test_tables_of_scenario_2_hold_each_number_in_its_column():
    short = {"fraction_mean": 0.9, "fraction_worst": 0.8, "worst_psi_deg": 90.0,
             "ratio_to_stage_1_min": 1.5, "ratio_to_stage_1_min_inward": 2.5}  # fmt: skip
    tables = scenarios.tables_2({
        "scenario_2": {"a": [{"psi_deg": 90.0, "max_force_N": 120.4, "limit_N": 401.6}],
                       "b": [{"psi_deg": 90.0, "max_force_N": 99.0, "limit_N": 401.6}]},
        "scenario_2_overview": {"a": short},
        "jump": {"a": [{"psi_deg": 90.0, "max_impulse_Ns": 12.04, "limit_Ns": 40.16}]},
        "jump_overview": {"a": short},
    })  # fmt: skip
    in_short = [("a", "0.900", "0.800", "90", "1.50", "2.50")]
    assert [list(table.rows) for table in tables] == [
        [("90", "402", "120", "99")], in_short, [("90", "40.2", "12.0")], in_short
    ]  # fmt: skip
    assert tuple(tables[2].columns) == ("psi [deg]", "limit F* [N s]", "a")


def test_the_jerk_form_is_of_both_variants_of_the_paper_that_use_stage_2():
    names = "two-stage-paper", "stage-1-paper", "two-stage"
    grids = [scenarios.scan_job(Variant(name, name), 0.0).grids for name in names]
    assert grids == [(20.0, 5.0, 1.0), (5.0, 1.0), (5.0, 1.0)]


def test_combinations_that_survive_unsettled_are_counted_as_survived_alone():
    """4 feet x 4 widths x 2 periods x 4 samplings of each cost."""
    variants = [variant for _, variant in scenarios.together("two-stage-paper")]
    rows = {key(EpisodeJob(one, scenarios.PUSH, scenarios.FORCE)): {"survived": True, "recovered": False}
            for one in variants}  # fmt: skip
    groups = scenarios._together(rows, "two-stage-paper")
    names = "combinations", "survived", "recovered"
    assert [[groups[cost][name] for name in names] for cost in ("repaired", "literal")] == [[128, 128, 0]] * 2


def test_a_hole_is_given_by_the_force_before_it_and_the_one_beyond():
    """`rows_of` survives 1 N more beyond the first failure at 30 degrees."""
    holes = SCENARIO_2.summary(rows_of(SCENARIO_2.jobs(12), lambda job: 100.0), 12)["scenario_2_holes"]
    assert len(holes) == len(scenarios.VARIANTS) + len(scenarios.EXTRA_VARIANTS)
    assert {(one["max_force_N"], one["largest_survived_N"]) for one in holes} == {(100.0, 101.0)}
