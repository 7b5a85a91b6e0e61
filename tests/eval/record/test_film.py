"""Films say what happened: the right push, the right outcome, at the right time, in files of a known size."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from push_recovery.eval.cli.main import main
from push_recovery.eval.record import film as films
from push_recovery.eval.record.words import pushes_words
from push_recovery.eval.score.suites import Suite, get_suite

PENDULUM = "PushRecovery/Pendulum-v0"


def shot(policy="two-stage", end=3.0, grey=0, starts=(1.0,), **told):
    """An episode of 100 Hz with pushes of 30 N s to the right from 1 s on, whose pictures are of one grey."""
    shot = films.Shot(policy, 0.01, 50.0)
    frame = np.full((48, 64, 3), grey, np.uint8)
    info = {"failure_reason": None, "recovered_at": None} | told
    count = round(100 * end)
    for i in range(count + 1):
        env = SimpleNamespace(render=lambda: frame)
        push = {"impulse": (0.0, -30.0, 0.0), "start": max([s for s in starts if s <= i / 100], default=None)}
        shot(SimpleNamespace(env=env, info={**info, "push": push, "time": i / 100}, ended=i == count))
    return shot


def has(picture, colour):
    return bool((picture == colour).all(axis=-1).any())


def test_a_camera_keeps_frames_at_its_rate_and_the_last_one():
    camera = shot(end=1.63)
    np.testing.assert_allclose(np.diff(camera.times)[:-1], 0.02)
    assert camera.times[-1] == 1.63
    assert camera.push_start == 1.0
    assert camera.times[shot().frame_at(-0.5)] == pytest.approx(0.5)


def test_the_outcome_is_written_once_it_is_decided_and_in_its_colour():
    fell = shot("stage-1", end=1.8, failure_reason="com_height")
    stood = shot(recovered_at=2.2)
    assert fell.push == "30.0 N s to the right"
    width, line = films.PANEL[0], slice(2 + 2 * films.LINE, films.HEAD)
    for after, told in ((0.7, (False, False)), (1.0, (True, False)), (1.3, (True, True))):
        picture = films.compose([fell, stood], after, 0.5)
        found = has(picture[line, :width], films.BAD), has(picture[line, width:], films.GOOD)
        assert found == told, after


def test_a_contact_sheet_has_six_moments_and_tells_its_markers():
    strip = np.asarray(Image.open(io.BytesIO(films.strip(shot(grey=90, recovered_at=2.2)))))
    assert strip.shape[1] >= len(films.STRIP) * films.STRIP_PANEL[0]
    assert (strip[strip.shape[0] // 2] == 90).all(axis=-1).sum() == len(films.STRIP) * films.STRIP_PANEL[0]
    below = strip[films.STRIP_PANEL[1] + films.LINE :]
    assert all(has(below, colour) for colour in films.LEGEND.values())
    fell = np.asarray(Image.open(io.BytesIO(films.strip(shot(grey=90, failure_reason="com_height")))))
    assert (fell[films.STRIP_PANEL[1] + films.LINE :] != below).any()  # words of another ending


def test_each_policy_has_its_own_picture_and_the_markers_are_told():
    picture = films.compose([shot(grey=40), shot(grey=90)], 0.0, 0.5)
    assert picture.shape[1] >= 2 * films.PANEL[0]
    middle = films.HEAD + films.PANEL[1] // 2
    assert picture[middle, films.PANEL[0] // 2].tolist() == [40] * 3
    assert picture[middle, -films.PANEL[0] // 2].tolist() == [90] * 3
    assert all(has(picture[films.HEAD + films.PANEL[1] :], colour) for colour in films.LEGEND.values())


def test_the_path_of_a_long_file_is_cut_at_its_front():
    names = "a" * 300 + "/mine.safetensors", "a" * 400 + "/mine.safetensors", "a" * 300 + "/yours.safetensors"
    short, long, other = (films.compose([shot(name)], 0.0, 1.0) for name in names)
    np.testing.assert_array_equal(short, long)
    assert (short != other).any()


def test_a_film_ends_shortly_after_all_is_decided():
    frames = films.side_by_side(
        [shot(end=1.8, failure_reason="com_height"), shot(recovered_at=2.2)], 0.5, 25.0
    )
    assert len(frames) == pytest.approx((films.BEFORE + 1.2 + films.LINGER) * 50, abs=2)
    never = films.side_by_side([shot(end=9.0)], 0.5, 25.0)
    assert len(never) == pytest.approx((films.BEFORE + films.LONGEST) * 50, abs=2)


def test_repeated_pushes_are_counted_and_time_runs_from_the_first_one():
    pushed = shot(end=9.0, starts=(1.0, 2.5, 4.0, 5.5), recovered_at=6.5)
    assert pushed.push == "4 x 30.0 N s to the right"
    assert (pushed.push_start, pushed.pushed_for, pushed.decided) == (1.0, 4.5, 5.5)
    assert pushed.ending == "recovered after 5.5 s"
    frames = films.side_by_side([pushed], 0.5, 25.0)
    assert len(frames) == pytest.approx((films.BEFORE + 5.5 + films.LINGER) * 50, abs=2)
    early = shot(end=3.0, starts=(1.0, 2.5, 4.0, 5.5), failure_reason="com_height")
    assert early.ending == "fell after 2.0 s (sank too low)"
    assert early.push == "2 x 30.0 N s to the right"  # the others never came
    assert shot(starts=(9.0,)).push == "30.0 N s to the right"  # nor did this one


def test_pushes_are_told_by_their_number_size_and_direction():
    def told(*impulses):
        return pushes_words([{"impulse": impulse} for impulse in impulses])

    assert told() == "no push"
    assert told((0.0, 40.0, 0.0), (0.0, 60.0, 0.0)) == "2 x 40.0-60.0 N s to the left"
    assert told((9.0, 0.0, 0.0), (0.0, -9.0, 0.0), (-9.0, 0.0, 0.0)) == "3 x 9.0 N s in several directions"


def test_a_gif_stays_below_its_limit_at_its_rate_and_keeps_colours():
    random = np.random.default_rng(0)
    noise = [random.integers(0, 255, (200, 300, 3), np.uint8) for _ in range(6)]
    for frame in noise:
        frame[:40, :40] = (200, 30, 25)
    content = films.gif_bytes(noise, 12.5, [(200, 30, 25)], limit=60_000)
    assert len(content) < 60_000
    film = Image.open(io.BytesIO(content))
    assert (film.n_frames, film.info["duration"], film.info["loop"]) == (6, 80, 0)
    assert film.width < 300
    assert film.width / film.height == pytest.approx(1.5, abs=0.05)
    assert film.convert("RGB").getpixel((5, 5)) == (200, 30, 25)
    assert Image.open(io.BytesIO(films.gif_bytes(noise, 12.5))).size == (300, 200)


def test_an_mp4_has_every_frame_at_its_rate():
    imageio = pytest.importorskip("imageio.v2", reason="needs the extra view")
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra view")
    frames = [np.full((64, 96, 3), 20 * i, np.uint8) for i in range(8)]
    with imageio.get_reader(io.BytesIO(films.mp4_bytes(frames, 25.0)), format="mp4") as reader:
        assert reader.get_meta_data()["fps"] == 25.0
        greys = [float(frame.mean()) for frame in reader]
    np.testing.assert_allclose(greys, [20 * i for i in range(8)], atol=6)


def test_both_sides_of_a_disagreement_take_turns(evaluation):
    found = films.disagreements(evaluation({"a": "rrrrfr", "b": "rfffrf"}))
    assert [one.place for one in found] == [1, 4, 2, 3, 5]
    assert {one.policies for one in found} == {("a", "b")}


def test_of_many_policies_the_first_of_each_kind_is_shown_in_their_order(evaluation):
    found = films.disagreements(evaluation({"a": "rrf", "b": "rff", "c": "rfr"}))
    assert {one.place: one.policies for one in found} == {1: ("a", "b"), 2: ("a", "c")}


def test_compare_films_what_its_rows_say(tmp_path, capsys, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra view")
    monkeypatch.setattr(films, "RATE", 6)  # to have fewer pictures
    suite = tmp_path / "suite.json"
    first = replace(get_suite("standard").scenarios[0], settle_time=2.0)
    Suite("few", "1", (first,)).save(suite)
    argv = ["compare", "two-stage", "passive", "--env", PENDULUM, "--suite", str(suite), "--workers", "1"]
    out = tmp_path / "out"
    assert main([*argv, "--out", str(out), "--film", "discordant", "--films", "1"]) == 0
    told = capsys.readouterr()
    assert f"films: {out / 'films'}" in told.out
    assert "films of 1 of the 1 pushes on which the policies disagree: about 10 seconds" in told.err
    gif, mp4 = sorted((out / "films").iterdir())
    assert gif.stat().st_size < 1_000_000
    assert (gif.suffix, mp4.suffix, gif.stem) == (".gif", ".mp4", mp4.stem)
    assert films.film_name(3, "../a b/ü") == "0003-.._a_b_"  # holds no path
    assert main([*argv, "--film", "all"]) == 2
    assert "discordant" in capsys.readouterr().err


def watched(push_at: float, end: float, period: float = 0.01) -> films.StripCamera:
    """An episode whose picture at each time is of one grey: the time in hundredths of a second."""
    camera, now = films.StripCamera(), [0.0]
    env = SimpleNamespace(render=lambda: np.full((24, 32, 3), round(100 * now[0]) % 256, np.uint8))
    for k in range(round(end / period) + 1):
        now[0] = k * period
        push = {"start": push_at} if now[0] >= push_at else None
        info = {"time": now[0], "push": push}
        camera(SimpleNamespace(env=env, info=info, ended=k == round(end / period)))
    return camera


def test_it_draws_at_its_moments_after_the_push_and_at_the_end():
    whole = watched(1.0, 4.0)
    np.testing.assert_allclose(whole.after, films.STRIP, atol=0.0101)
    greys = [round(100 * (1 + after)) % 256 for after in whole.after]
    assert [int(frame[0, 0, 0]) for frame in whole.frames] == greys
    short = watched(1.0, 1.63)
    np.testing.assert_allclose(short.after, [*films.STRIP[:3], 0.63], atol=0.0101)
    assert watched(5.0, 4.0).frames == []


def test_a_sheet_has_a_row_for_each_policy():
    picture = Image.open(io.BytesIO(films.sheet([("a", watched(1.0, 4.0)), ("b", watched(1.0, 1.63))])))
    grey = np.asarray(picture.convert("L"), dtype=int)
    first, second = np.array_split(grey, 2)
    assert picture.width == pytest.approx(900)
    assert (first[-60:-30, -60:-30] < 250).all()  # the last moment of the first
    assert (second[-60:-30, -60:-30] > 250).all()  # the second had fallen before it


def test_a_film_is_half_as_fast_in_frames_and_as_fast_in_time_as_a_gif(monkeypatch, tmp_path):
    """Seven frames of 25 a second: every second one, each for 80 ms."""
    frames = [np.full((24, 32, 3), grey, np.uint8) for grey in range(0, 280, 40)]
    monkeypatch.setattr(films, "side_by_side", lambda *_: frames)
    monkeypatch.setattr(films, "mp4_bytes", lambda frames, rate: b"")
    films.write_pair([], tmp_path / "x")
    gif = Image.open(tmp_path / "x.gif")
    assert (gif.n_frames, gif.info["duration"]) == (4, 80)


def test_a_sheet_is_stretched_over_several_pushes():
    """Pushed at 1 and 5 s: 2 s become 6 s."""
    seen = shot(end=9.0, starts=(1.0, 5.0), recovered_at=7.0)
    seen.frames = [np.full((48, 64, 3), round(20 * time), np.uint8) for time in seen.times]
    picture, (width, height) = np.asarray(Image.open(io.BytesIO(films.strip(seen)))), films.STRIP_PANEL
    row, columns = films.LINE + height // 2, [c * (width + films.GAP) + width // 2 for c in range(6)]
    assert picture[row, columns, 0].tolist() == pytest.approx([23, 35, 50, 68, 98, 140], abs=1)


def test_what_was_trusted_is_filmed_as_it_was_scored(monkeypatch, evaluation):
    taken = []
    monkeypatch.setattr(films, "shoot", lambda env_id, policy, *_: taken.append(policy))
    monkeypatch.setattr(films, "write_pair", lambda *_: [])
    trusted = SimpleNamespace(predict=lambda observation: None)
    found = evaluation({"a": "rf", "b": "rr"})
    films.film_discordant(found, 1, [{"a": trusted}, "b"])
    assert taken == [{"a": trusted}, {"b": "b"}]


def test_of_a_wide_frame_the_middle_is_kept():
    """Of 4 rows 3 : 2 allows 6 columns, and 5 : 1 all ten."""
    frame = np.repeat(np.arange(10, dtype=np.uint8)[None, :, None], 4, axis=0).repeat(3, axis=2)
    assert films.middle(frame, (3, 2))[0, :, 0].tolist() == [2, 3, 4, 5, 6, 7]
    assert films.middle(frame, (5, 1)).shape == (4, 10, 3)


def test_a_sheet_is_squeezed_where_the_episode_ends_early():
    """Pushed at 1 s and down at 1.8 s: 2 s become 0.8 s."""
    seen = shot(end=1.8, failure_reason="com_height")
    seen.frames = [np.full((48, 64, 3), round(200 * max(time - 1.0, 0.0)), np.uint8) for time in seen.times]
    picture, (width, height) = np.asarray(Image.open(io.BytesIO(films.strip(seen)))), films.STRIP_PANEL
    row, columns = films.LINE + height // 2, [c * (width + films.GAP) + width // 2 for c in range(6)]
    assert picture[row, columns, 0].tolist() == pytest.approx([4, 20, 40, 64, 104, 160], abs=1)


@pytest.mark.parametrize(("period", "rate"), [(0.01, 25.0), (0.05, 20.0), (0.02, 25.0), (0.025, 20.0)])
def test_a_film_of_one_episode_runs_at_the_speed_of_time(monkeypatch, period, rate):
    """At any planning rate; a GIF has every second frame."""
    said = []

    def compose(shots, after, speed):
        said.append((round(after, 6), speed))
        return np.full((8, 8, 3), 9 * len(said), np.uint8)

    monkeypatch.setattr(films, "compose", compose)
    monkeypatch.setattr(films, "mp4_bytes", lambda frames, rate: (len(frames), rate))
    seen, frame = films.Shot("p", period), np.zeros((48, 64, 3), np.uint8)
    seen.times = [round(0.9 + i / rate, 6) for i in range(5)]
    seen.frames = [frame] * 5
    monkeypatch.setattr(films.Shot, "push_start", 1.0)
    assert films.episode_film(seen, ".mp4") == (5, pytest.approx(rate))
    assert said == [(round(time - 1.0, 6), 1.0) for time in seen.times]
    gif = Image.open(io.BytesIO(films.episode_film(seen, ".gif")))
    assert (gif.n_frames, gif.info["duration"]) == (3, 2000 / rate)
