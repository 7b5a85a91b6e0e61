"""`push-recovery policies`: train the shipped policies again, each by its recipe, into one folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file, write_atomically
from ...controllers.learned.policy_file import policy_paths
from ...controllers.validation import require_choice
from ...eval.cli.options import Directory, Options
from ..recipes import RECIPES, difference, file_settings
from ..settings import TrainingSettings
from .extras import require_training
from .train import with_progress, work_of

if TYPE_CHECKING:
    from ..ppo import Report

FOLDER = Path("runs/policies")


@dataclass(frozen=True, kw_only=True)
class Policies(Options):
    """One run after the other; what is complete stays, what was stopped goes on."""

    names: Annotated[Positional[tuple[str, ...]], arg(metavar="[NAME ...]")] = tuple(RECIPES)
    """Names of the policies to train; without a name all of them."""
    out: Directory = None
    """Directory for NAME.safetensors and NAME.json; each run is in DIR/NAME (default: runs/policies)."""

    def run(self) -> None:
        """Train, and say where each policy is.

        Raises:
            UnknownNameError: No recipe has this name.
            InvalidValueError: A folder holds a run with other settings than the recipe's.
            MissingExtraError: torch or Stable-Baselines3 is not installed.
        """
        require_training()
        folder = FOLDER if self.out is None else Path(self.out)
        for name in self.names:
            require_choice("recipe", name, tuple(RECIPES))
        for name in self.names:
            if not is_complete(folder, name):
                settings = RECIPES[name]
                with_progress(
                    work_of(settings, folder / name),
                    settings,
                    lambda report, name=name: train_recipe(name, folder, report),
                )
            print(policy_paths(folder / name)[1])


def is_complete(folder: Path, name: str) -> bool:
    """Whether a folder holds the policy of a recipe, trained with the recipe's settings of today."""
    weights, description = policy_paths(folder / name)
    if not (weights.is_file() and description.is_file()):
        return False
    return difference(RECIPES[name], file_settings(description)) is None


def train_recipe(name: str, folder: Path, report: Report) -> None:
    """Train by a recipe in FOLDER/NAME, or go on there; then put the policy beside it.

    Raises:
        InvalidValueError: The run there has other settings.
    """
    from ..checkpoint import find_checkpoints, load_checkpoint
    from ..ppo import POLICY, resume, train

    settings, run = RECIPES[name], folder / name
    if find_checkpoints(run):
        _require_agreement(run, load_checkpoint(run).settings, settings)
        resume(run, report=report)
    else:
        train(settings, run, report, folder)
    for path, place in zip(policy_paths(run / POLICY), policy_paths(folder / name), strict=True):
        write_atomically(place, read_file(path))  # the description last: it says that both are there


def _require_agreement(run: Path, theirs: TrainingSettings, recipe: TrainingSettings) -> None:
    name = difference(recipe, theirs)
    if name is not None:
        raise InvalidValueError(
            f"the run in {run} has {name} {getattr(theirs, name)!r}, its recipe {getattr(recipe, name)!r}: "
            "choose another --out, or remove that folder"
        )
