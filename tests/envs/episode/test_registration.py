"""Every registered environment: both checkers, JSON keywords, vector form."""

import json
import sys
from pathlib import Path
from types import ModuleType

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordVideo
from push_recovery.envs.rendering import RenderError
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

import push_recovery  # noqa: F401

FORMS = "", "Residual", "Joint", "JointResidual", "FullBody"
PUSHED = Scenario("pushed", (Push((300.0, 0.0, 0.0), 0.1, 0.0),))
REGISTERED = sorted(name for name in gym.registry if name.startswith("PushRecovery/"))
IDS = [name for name in REGISTERED if "robot" not in gym.spec(name).kwargs]  # others: biped/robots/adapted


def test_the_promised_ids_are_there():
    robots = "Biped", "G1", "T1", "JVRC1", "Apollo", "Berkeley", "OP3"
    forms = [f"{name}{form}" for name in robots for form in FORMS]
    assert {f"PushRecovery/{name}-v0" for name in ("Pendulum", *forms)} <= set(REGISTERED)


@pytest.mark.filterwarnings(
    "ignore:.*different from the unwrapped version.*", "ignore:.*Box observation space.*"
)
@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker_passes(name):
    env = gym.make(name).unwrapped if "Residual" not in name else gym.make(name, disable_env_checker=True)
    check_env(env, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_stable_baselines_checker_passes(name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make(name)
    checker.check_env(env, warn=False, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_spec_makes_the_same_environment_again(name):
    env = gym.make(f"push_recovery:{name}", control_hz=50.0)
    spec = env.spec
    assert spec is not None
    assert json.loads(json.dumps(spec.kwargs)) == {"control_hz": 50.0}
    again = gym.make(type(spec).from_json(spec.to_json()))
    assert {"human", "rgb_array"} <= set(env.metadata["render_modes"])
    for made in (env, again):
        made.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(5)]
    runs = []
    for made in (env, again):
        made.reset(seed=4)
        runs.append(np.array([made.step(action)[0] for action in actions]))
        made.close()
    assert runs[0].tobytes() == runs[1].tobytes()


@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_video_recorder_takes_the_pictures_at_the_planning_rate(name, tmp_path, monkeypatch):
    clips = []

    class Clip:
        """What Gymnasium makes a film of, in place of moviepy's."""

        def __init__(self, frames, fps):
            clips.append((np.array(frames), fps))

        def write_videofile(self, path, logger):
            Path(path).touch()

    writer = ModuleType("moviepy.video.io.ImageSequenceClip")
    writer.ImageSequenceClip = Clip
    for module in (
        ModuleType("moviepy"),
        ModuleType("moviepy.video"),
        ModuleType("moviepy.video.io"),
        writer,
    ):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    env = gym.make(name, render_mode="rgb_array", control_hz=50.0)
    recorder = RecordVideo(env, str(tmp_path), episode_trigger=lambda episode: True, disable_logger=True)
    try:
        recorder.reset(options={"scenario": PUSHED})
        for _ in range(4):
            recorder.step(np.zeros(env.action_space.shape, np.float32))
    except RenderError as error:
        pytest.skip(str(error))
    finally:
        recorder.close()
    ((frames, fps),) = clips
    assert fps == 50
    assert frames.shape == (5, 480, 640, 3)
    assert frames.dtype == np.uint8
    assert (frames[0] != frames[-1]).any()
    assert [path.name for path in tmp_path.iterdir()] == ["rl-video-episode-0.mp4"]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("name", IDS)
def test_vectors_state_their_autoreset_mode_and_start_episodes_anew(name, mode):
    """Robots that are pushed hard fall, and stand again at the start of an episode."""
    falls = {"impulse_min": 300.0, "impulse_max": 300.0, "first_step": 0, "settle_time": 1.0}
    vector = gym.make_vec(
        name,
        num_envs=2,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        push_distribution=falls,
    )
    assert vector.metadata["autoreset_mode"] == mode
    observations, _ = vector.reset(seed=1)
    assert observations.shape == vector.observation_space.shape
    # an entry that is zero then: the time in the step, or how fast the base turns
    began = {"PushRecovery/BipedJoint-v0": -1, "PushRecovery/BipedFullBody-v0": 4}.get(name, 0)
    seen, due = np.zeros(2, bool), np.zeros(2, bool)
    for _ in range(400):
        action = np.zeros(vector.action_space.shape, np.float32)
        observations, rewards, terminated, truncated, _ = vector.step(action)
        assert np.isfinite(observations).all()
        ended = terminated | truncated
        fresh = ended if mode == AutoresetMode.SAME_STEP else due
        assert not observations[fresh, began].any()
        if mode == AutoresetMode.NEXT_STEP:
            assert not rewards[fresh].any()
        due, seen = ended, seen | ended
        if seen.all() and not due.any():
            break
    assert seen.all()
    vector.close()


@pytest.mark.parametrize("name", IDS)
def test_robots_of_a_vector_are_those_alone(name):
    vector = gym.make_vec(name, num_envs=2, vectorization_mode="sync")
    alone = [gym.make(name) for _ in range(2)]
    together, _ = vector.reset(seed=5)  # and 6
    for k, env in enumerate(alone):
        assert env.reset(seed=5 + k)[0].tobytes() == together[k].tobytes()
    rng = np.random.default_rng(0)
    for _ in range(15):
        actions = rng.uniform(-0.2, 0.2, vector.action_space.shape).astype(np.float32)
        together = vector.step(actions)[0]
        for k, env in enumerate(alone):
            assert env.step(actions[k])[0].tobytes() == together[k].tobytes()
    vector.close()
