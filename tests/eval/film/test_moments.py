"""Six moments of a push, drawn when they come."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from push_recovery.eval.record.film import STRIP, Moments, Row, sheet


def watched(push_at: float, end: float, period: float = 0.01) -> Moments:
    """An episode whose picture at each time is of one grey: the time in hundredths of a second."""
    moments, now = Moments(), [0.0]
    env = SimpleNamespace(render=lambda: np.full((24, 32, 3), round(100 * now[0]) % 256, np.uint8))
    for k in range(round(end / period) + 1):
        now[0] = k * period
        push = {"start": push_at} if now[0] >= push_at else None
        info = {"time": now[0], "push": push}
        moments(SimpleNamespace(env=env, info=info, ended=k == round(end / period)))
    return moments


def test_it_draws_at_its_moments_after_the_push_and_at_the_end():
    whole = watched(1.0, 4.0)
    np.testing.assert_allclose(whole.after, STRIP, atol=0.0101)
    assert [int(frame[0, 0, 0]) for frame in whole.frames] == [
        round(100 * (1 + t)) % 256 for t in whole.after
    ]
    short = watched(1.0, 1.63)
    np.testing.assert_allclose(short.after, [*STRIP[:3], 0.63], atol=0.0101)
    assert watched(5.0, 4.0).frames == []


def test_a_sheet_has_a_row_for_each_policy():
    picture = Image.open(io.BytesIO(sheet([Row("a", watched(1.0, 4.0)), Row("b", watched(1.0, 1.63))])))
    grey = np.asarray(picture.convert("L"), dtype=int)
    first, second = np.array_split(grey, 2)
    assert picture.width == pytest.approx(900)
    assert (first[-60:-30, -60:-30] < 250).all()  # the last moment of the first
    assert (second[-60:-30, -60:-30] > 250).all()  # the second had fallen before it
