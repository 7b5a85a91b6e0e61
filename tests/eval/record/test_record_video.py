"""Gymnasium's own RecordVideo works with what the extra view brings."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("moviepy", reason="needs the extra view")
imageio = pytest.importorskip("imageio.v2", reason="needs the extra view")


def test_record_video_writes_every_step_at_the_rate_of_planning(tmp_path):
    env = gym.make("push_recovery:PushRecovery/Pendulum-v0", render_mode="rgb_array")
    env = gym.wrappers.RecordVideo(env, str(tmp_path), disable_logger=True)
    env.reset(seed=0)
    shape = env.render().shape
    for _ in range(5):
        env.step(np.zeros(7, np.float32))
    env.close()
    (path,) = tmp_path.glob("*.mp4")
    with imageio.get_reader(path) as reader:
        frames = list(reader.iter_data())  # whose number the reader does not know
        assert reader.get_meta_data()["fps"] == 100.0
    assert len(frames) == pytest.approx(6, abs=1)
    assert frames[0].shape == shape
