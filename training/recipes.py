"""Settings of the shipped policies by name: how each is trained stands here and nowhere else."""

from dataclasses import fields, replace
from pathlib import Path

from ..controllers.errors import InvalidValueError, UnknownNameError
from ..controllers.files import is_file
from ..controllers.policies.learned import policy_paths
from ..envs.scenario.scenario import FASTEST_TURN
from ..eval.rollout.load_policy import training_note
from .settings import TRAINING_PUSHES, TrainingSettings

RESIDUAL = TrainingSettings("residual")
# Half as long again and a smaller value network: more pushes are recovered from, and updates cost less
LONG_RESIDUAL = replace(RESIDUAL, timesteps=6_000_000, value_layers=(128, 128))
# What corrects torques has to know how to turn by itself
TURNING = replace(TRAINING_PUSHES, turn=FASTEST_TURN)
JOINT_RESIDUAL = TrainingSettings("joint-residual", pushes=TURNING, log_std=-2.5, gamma=0.995)
# An action on joints lasts half as long: as many seconds of simulation as `residual` has
LONG = 8_000_000
# Of networks that have no planner to fall back on: the easy ones, too
ALL_PUSHES = replace(TRAINING_PUSHES, impulse_min=5.0)
# Half on the pelvis, where `hard` has them, the others where the tour's punches bring a G1 down
ON_G1 = replace(
    TRAINING_PUSHES, impulse_min=30.0,
    bodies=(
        *8 * ("pelvis",), *2 * ("trunk",), "left_foot", "right_foot",
        *2 * ("link:left_elbow_joint",), "link:left_shoulder_yaw_joint",
        *2 * ("link:right_elbow_joint",), "link:right_shoulder_yaw_joint",
    ),
)  # fmt: skip
RECIPES = {  # in the order of `eval.shipped.names.NAMES`
    "residual": LONG_RESIDUAL,
    **{f"residual-seed{seed}": replace(LONG_RESIDUAL, seed=seed) for seed in range(1, 5)},
    "residual-hardware": replace(
        RESIDUAL, profile="hardware", initial="residual", critic=("push", "sensing"), value_first=100_000,
        learning_rate=2e-4, timesteps=2_000_000,
    ),
    "scratch": TrainingSettings("scratch", pushes=ALL_PUSHES),
    # Imitation only: from nothing PPO survives more and keeps less to its command (docs/training.md)
    "joint": TrainingSettings("joint", teacher=True, reward="recovery", policy_layers=(256, 256),
                              timesteps=0),
    "joint-residual": replace(JOINT_RESIDUAL, timesteps=LONG),
    "joint-residual-hardware": replace(
        JOINT_RESIDUAL, profile="hardware", initial="joint-residual", critic=("push", "sensing"),
        value_first=100_000, learning_rate=2e-4, timesteps=2_000_000,
    ),
    "residual-g1": replace(RESIDUAL, env_id="PushRecovery/G1-v0", pushes=ON_G1),
}  # fmt: skip


def get_recipe(name: str) -> TrainingSettings:
    """The settings of a shipped policy, by name, or those that the policy of a file was trained with.

    Raises:
        UnknownNameError: neither a name nor a file; lists the names.
        InvalidValueError: the file can't be read, or says nothing of a training by this version's settings.
    """
    if name in RECIPES:
        return RECIPES[name]
    path = policy_paths(name)[1]
    if not is_file(path):
        raise UnknownNameError("recipe", name, [*RECIPES, "FILE.json of a policy"])
    return file_settings(path)


def file_settings(path: Path) -> TrainingSettings:
    """Settings that stand under `training` in a policy's JSON.

    Raises:
        InvalidValueError: see `get_recipe`.
    """
    note = training_note(path)
    try:
        settings = note["settings"]
    except (KeyError, TypeError):
        raise InvalidValueError(f"{path} does not say what its policy was trained with") from None
    return TrainingSettings.from_json(settings)


def difference(recipe: TrainingSettings, settings: TrainingSettings) -> str | None:
    """A setting in which a run differs from a recipe, or None; where the recipe says None any value will do.

    A run has settled what its recipe leaves to the environment.
    """
    for entry in fields(TrainingSettings):
        asked = getattr(recipe, entry.name)
        if asked is not None and asked != getattr(settings, entry.name):
            return entry.name
    return None


def command_of(settings: TrainingSettings, file: str) -> str:
    """The command that trains with these settings again; `file` is the policy's where no recipe has them."""
    name = next((name for name, recipe in RECIPES.items() if difference(recipe, settings) is None), file)
    return f"push-recovery train --recipe {name}"
