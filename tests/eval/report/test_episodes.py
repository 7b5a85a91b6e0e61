"""What became of pushes, and limits met, on rows that are known."""

import base64
import io

import numpy as np
from PIL import Image
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.whole_body.limits import BOUNDS
from push_recovery.eval.record.film import StripCamera
from push_recovery.eval.report import episodes as pictures
from push_recovery.eval.report.episodes import (
    PicturePart,
    ending_figure,
    explained,
    limit_cells,
    opponents,
    picture_part,
    reason_cells,
    reasons_of,
    telling_pushes,
)
from push_recovery.eval.report.page import LIMITS, REASONS

LABELS = {"p": "P", "q": "Q"}


def test_reasons_are_counted_and_explained(evaluation):
    found = evaluation({"p": "rsff", "q": "rrrr"})
    found.rows["p"][3]["failure_reason"] = "of_its_own"
    assert reasons_of(found) == ["not_settled", "com_height", "of_its_own"]
    assert reason_cells(found, LABELS) == [("P", "1", "1", "1", "1"), ("Q", "4", "0", "0", "0")]
    assert explained(["com_height", "of_its_own", "com_height"]) == [("com_height", REASONS["com_height"])]
    assert "<pattern" in ending_figure(found, LABELS)  # grey print tells the parts apart


def test_limits_of_falls_and_recoveries(evaluation):
    found = evaluation({"p": "rsff", "q": "rrrr"})
    found.rows["q"][0]["limit_shares"] = {"step_time": 0.4}
    columns, cells = limit_cells(found, LABELS)
    assert columns == ["limit", "met while", "P", "Q"]
    assert cells == [
        ("step_time", LIMITS["step_time"], "0 % / 0 %", "0 % / 10 %"),
        ("cop", LIMITS["cop"], "50 % / 0 %", "0 % / 0 %"),
    ]


def test_every_limit_has_words():
    assert set(LIMITS) == set(BOUNDS)


LABELS_PICTURES = {name: name for name in ("residual", "residual-seed1", "two-stage")}


def drawn() -> StripCamera:
    camera = StripCamera()
    camera.frames, camera.after = [np.zeros((24, 32, 3), np.uint8)], [0.05]
    return camera


def test_the_best_is_shown_beside_another_recipe(evaluation):
    found = evaluation({"two-stage": "rrff", "residual": "rrrr", "residual-seed1": "rrrf"})
    assert opponents(found, LABELS_PICTURES) == ("residual", "two-stage")
    assert opponents(evaluation({"residual": "rr", "residual-seed1": "rf"}), LABELS_PICTURES) is None


def test_the_weakest_push_of_either_side_tells(evaluation):
    found = evaluation({"a": "rrfrfr", "b": "frrffr"})  # only a: pushes 0 and 3; only b: push 2
    rows = found.rows["a"]
    weakest = min((0, 3), key=lambda k: rows[k]["impulse"])
    assert telling_pushes(found, "a", "b") == [found.suite.scenarios[weakest], found.suite.scenarios[2]]
    assert telling_pushes(found, "b", "a") == [found.suite.scenarios[2], found.suite.scenarios[weakest]]
    assert telling_pushes(evaluation({"a": "rf", "b": "ff"}), "b", "a") == [found.suite.scenarios[0]]


def test_pictures_stand_in_the_page_and_without_opengl_it_says_why(evaluation, monkeypatch):
    found = evaluation({"a": "rr", "b": "rf"}, "PushRecovery/Biped-v0")
    labels = {"a": "first", "b": "second"}
    monkeypatch.setattr(pictures, "watch", lambda *_: drawn())
    (one,) = picture_part(found, labels).pictures
    assert "first recovers; second falls at 3.2 s" in one.caption
    kind, content = one.content.split(",")
    assert kind == "data:image/jpeg;base64"
    assert Image.open(io.BytesIO(base64.b64decode(content))).format == "JPEG"

    def fails(*_):
        raise InvalidValueError("no OpenGL here")

    monkeypatch.setattr(pictures, "watch", fails)
    assert picture_part(found, labels) == PicturePart(reason="no OpenGL here")
    assert picture_part(evaluation({"a": "rr", "b": "rf"}), labels) == PicturePart()  # of the pendulum none
