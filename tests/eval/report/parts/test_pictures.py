import base64
import io

import numpy as np
from PIL import Image
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.record.film import Moments
from push_recovery.eval.report import episodes as pictures
from push_recovery.eval.report.episodes import PicturePart, opponents, picture_part, telling_pushes

LABELS = {name: name for name in ("residual", "residual-seed1", "two-stage")}


def drawn() -> Moments:
    moments = Moments()
    moments.frames, moments.after = [np.zeros((24, 32, 3), np.uint8)], [0.05]
    return moments


def test_the_best_is_shown_beside_another_recipe(evaluation):
    found = evaluation({"two-stage": "rrff", "residual": "rrrr", "residual-seed1": "rrrf"})
    assert opponents(found, LABELS) == ("residual", "two-stage")
    assert opponents(evaluation({"residual": "rr", "residual-seed1": "rf"}), LABELS) is None


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
