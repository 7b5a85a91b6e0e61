"""Learning curves are read from the files of policies, and drawn."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
from matplotlib.axes import Axes
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import main
from push_recovery.eval.record import style
from push_recovery.eval.record.plot import LearningCurve, learning_curve, save_learning_curves

POINTS = [
    {"timesteps": 0, "seconds": 1.0, "scenarios": 40, "recovered": 0.5, "survived": 0.6, "mean_reward": 0.0},
    {"timesteps": 1500000, "seconds": 9.0, "scenarios": 40, "recovered": 0.75, "survived": 0.8,
     "mean_reward": 1.0},
]  # fmt: skip


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"training": {"settings": {"profile": "hardware"}, "curve": POINTS}}))
    return path


def test_a_curve_is_what_the_file_tells(file):
    expected = LearningCurve(str(file), "hardware", (0, 1500000), (0.5, 0.75), 40)
    assert learning_curve(str(file)) == expected
    file.write_text(file.read_text().replace('"hardware"', '["exact", "hardware"]'))
    assert learning_curve(str(file)).profile == "exact and hardware"


@pytest.mark.parametrize(
    "text", ['{"training": {"settings": {"profile": "exact"}, "curve": []}}', '{"training": {}}', "[]"]
)
def test_a_file_that_tells_of_no_training_is_refused(file, text):
    file.write_text(text)
    with pytest.raises(InvalidValueError, match="does not tell how its policy learned"):
        learning_curve(str(file))
    file.unlink()
    with pytest.raises(InvalidValueError, match="cannot read the policy description"):
        learning_curve(str(file))


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("recovered", 10**400, f"be finite, got 1{'0' * 199}... (401 characters): no float is so large"),
        ("recovered", float("nan"), "be finite, got nan"), ("recovered", 5, "be in [0, 1], got 5"),
        ("recovered", "1", "be a number, got '1'"), ("timesteps", -1, "be in [0, inf], got -1"),
        ("scenarios", 0, "be an integer in [1, 1000000000], got 0"),
    ],
)  # fmt: skip
def test_an_impossible_point_of_a_curve_is_named_before_anything_is_printed(file, field, value, said, capsys):
    points = [{**POINTS[0], field: value}, POINTS[1]]
    file.write_text(json.dumps({"training": {"settings": {"profile": "exact"}, "curve": points}}))
    assert main(["curves", str(file), "--out", str(file.parent / "out")]) == 2
    told = capsys.readouterr()
    expected = f"push-recovery: error: {file} does not tell how its policy learned: {field} must {said}\n"
    assert (told.out, told.err) == ("", expected)
    assert not (file.parent / "out").exists()


def test_a_file_in_place_of_the_folder_is_named_before_anything_is_printed(file, capsys, monkeypatch):
    monkeypatch.chdir(file.parent)
    assert main(["curves", "mine.json", "--out", "mine.json"]) == 2
    told = capsys.readouterr()
    expected = "push-recovery: error: can't write to 'mine.json/curves-mine.json.png': its folder is a file\n"
    assert (told.out, told.err) == ("", expected)


def test_the_figure_has_the_curves_and_the_lines(file, tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(Axes, "set_ylabel", lambda axes, label: said.append(label))
    first = learning_curve(str(file))
    other = replace(first, name="other", like=("quick", "hard"))
    paths = save_learning_curves([first, other], [("two-stage", 0.5)], tmp_path, "curves")
    assert [path.name for path in paths] == ["curves.png", "curves.svg"]
    assert paths[0].stat().st_size > 5000
    ET.fromstring(paths[1].read_text())  # noqa: S314  # our own
    assert said == ["recovered, of 40 pushes like those of hard; quick and hard"]


def test_the_command_prints_the_ends_and_draws(file, tmp_path, capsys):
    words = ["curves", str(file), "--ceiling", "0.9", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    first = f"{file}, hardware: 0.500 -> 0.750 after 1500000 actions"
    assert capsys.readouterr().out.splitlines()[0] == first
    assert len(list((tmp_path / "out").glob("curves-*.svg"))) == 1


def test_a_learning_curve_is_drawn_over_millions_with_wilsons_band(monkeypatch, tmp_path):
    """20 of 40: 0.352 to 0.648."""
    seen = []
    monkeypatch.setattr(style, "save", lambda figure, directory, stem: seen.append(figure) or [])
    curve = LearningCurve("mine", "hardware", (0, 1_500_000), (0.5, 0.75), 40)
    save_learning_curves([curve], [("two-stage", 0.8)], tmp_path, "curves")
    (axes,) = seen[0].axes
    assert axes.lines[0].get_xydata().tolist() == [[0.0, 0.5], [1.5, 0.75]]
    assert axes.collections[0].get_paths()[0].vertices[:, 1].min() == pytest.approx(0.352, abs=5e-4)
    assert axes.get_ylim() == pytest.approx((0.45, 1.02))
