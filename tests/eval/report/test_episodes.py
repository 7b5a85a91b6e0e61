"""What became of pushes, and pictures of those that tell, on rows that are known."""

import base64
import io
import re
from dataclasses import replace

import numpy as np
from PIL import Image
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.record.film import StripCamera
from push_recovery.eval.report import evaluation as episodes
from push_recovery.eval.report import page
from push_recovery.eval.report.evaluation import labelled


def test_grey_print_tells_the_endings_apart(evaluation):
    assert "<pattern" in episodes.ending_figure(evaluation({"p": "rsff", "q": "rrrr"}))


def test_a_reason_looks_the_same_on_every_page(evaluation):
    """Pushes that were survived have the same hatches with and without a fall beside them."""
    alone, beside = (episodes.ending_figure(evaluation({"p": letters})) for letters in ("rsrr", "rsff"))
    (pattern,) = re.findall(r"<pattern.*?</pattern>", alone, re.DOTALL)
    assert re.sub('id=".*?"', "", pattern) in re.sub('id=".*?"', "", beside)
    assert len(re.findall(r"<pattern", beside)) == 1
    unknown = evaluation({"p": "rf"})
    unknown.rows["p"][1]["failure_reason"] = "eaten"
    assert ">eaten<" in episodes.ending_figure(unknown)


def test_the_best_is_shown_beside_another_recipe(evaluation):
    found = evaluation({"two-stage": "rrff", "residual": "rrrr", "residual-seed1": "rrrf"})
    assert episodes.opponents(found) == ("residual", "two-stage")
    assert episodes.opponents(evaluation({"residual": "rr", "residual-seed1": "rf"})) is None


def test_the_weakest_push_of_either_side_tells(evaluation):
    found = evaluation({"a": "rrfrfr", "b": "frrffr"})  # only a: pushes 0 and 3; only b: push 2
    rows = found.rows["a"]
    weakest = min((0, 3), key=lambda k: rows[k]["impulse"])
    of_a, of_b = found.suite.scenarios[weakest], found.suite.scenarios[2]
    assert episodes.telling_pushes(found, "a", "b") == [of_a, of_b]
    assert episodes.telling_pushes(found, "b", "a") == [of_b, of_a]
    assert episodes.telling_pushes(evaluation({"a": "rf", "b": "ff"}), "b", "a") == [found.suite.scenarios[0]]


def test_pictures_stand_in_the_page_and_without_opengl_it_says_why(evaluation, monkeypatch):
    found = evaluation({"a": "rr", "b": "rf"}, "PushRecovery/Biped-v0")
    rows = {"x/first.safetensors": found.rows["a"], "b": found.rows["b"]}
    (found,) = labelled({"exact": replace(found, rows=rows)}).values()
    watched, camera = [], StripCamera()
    camera.frames, camera.after = [np.zeros((24, 32, 3), np.uint8)], [0.05]
    monkeypatch.setattr(episodes, "watch", lambda env_id, policy, scenario: watched.append(policy) or camera)
    ((caption, address),) = episodes.picture_part(found).pictures
    assert watched == ["a", "b"]  # by the names in the rows
    assert "x/first recovers; b falls 3.2 s into the walk" in caption
    kind, content = address.split(",")
    assert kind == "data:image/jpeg;base64"
    assert Image.open(io.BytesIO(base64.b64decode(content))).format == "JPEG"

    def fails(*_):
        raise InvalidValueError("no OpenGL here")

    monkeypatch.setattr(episodes, "watch", fails)
    assert episodes.picture_part(found) == episodes.PicturePart(reason="no OpenGL here")
    of_pendulum = evaluation({"a": "rr", "b": "rf"})
    assert episodes.picture_part(of_pendulum) == episodes.PicturePart()


def test_parts_of_a_bar_stand_beside_each_other(evaluation, monkeypatch):
    monkeypatch.setattr(page, "to_svg", lambda figure, words: figure)
    (axes,) = episodes.ending_figure(evaluation({"p": "rsff", "q": "rrrs"})).axes
    bars = {part.get_label(): [(bar.get_x(), bar.get_width()) for bar in part] for part in axes.containers}
    assert bars == {"recovered": [(0, 1), (0, 3)], "did not settle": [(1, 1), (3, 1)],
                    "sank too low": [(2, 2), (4, 0)]}  # fmt: skip
