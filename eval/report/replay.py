"""Commands as a user would type them: the one behind a report, and those that replay its episodes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

PROGRAM = "push-recovery"
WITHOUT_RESULT = {"workers", "ray", "out", "overwrite", "json"}  # options that change no outcome
OF_ROBOT = {"--env", "--preset", "--errors"}  # options of `play` that decide what a scenario is, too
OF_SUITE = OF_ROBOT | {"--suite"}
OF_PUSH = OF_ROBOT | {"--profile", "--duration", "--body", "--vx", "--vy"}


@dataclass(frozen=True)
class Command:
    """A command and those of its options that decide outcomes and are not at their defaults."""

    words: tuple[str, ...]  # its name, and what stands without an option
    options: tuple[tuple[str, tuple[str, ...]], ...] = ()  # as ("--suite", ("quick",))

    @property
    def text(self) -> str:
        """The line for a shell."""
        said = [word for option, values in self.options for word in (option, *values)]
        return shlex.join([PROGRAM, *self.words, *said])

    def replay(self, profile: str, scenario_id: str, policy: str) -> str:
        """The line that draws one scenario of a suite under a profile and says what became of it."""
        said = () if profile == "exact" else (("--profile", profile),)
        return self._play(OF_SUITE, (*said, ("--scenario", scenario_id)), scenario_id, policy)

    def replay_push(self, psi_deg: float, force: float, policy: str) -> str:
        """The line that draws the frontier's push of a force [N] towards psi [deg]."""
        said = ("--psi", f"{psi_deg:g}"), ("--force", f"{force:g}")
        return self._play(OF_PUSH, said, f"{psi_deg:g}deg-{force:g}N", policy)

    def _play(self, kept: set[str], said: Sequence[tuple[str, str]], stem: str, policy: str) -> str:
        """`play` with some of this command's options, others besides, and a picture's name."""
        picture = re.sub(r"[^\w+.-]+", "-", f"{stem}-{policy}").strip("-.") + ".png"
        more = (*said, ("--policy", policy), ("--out", picture))
        options = [entry for entry in self.options if entry[0] in kept]
        return Command(("play",), (*options, *((name, (value,)) for name, value in more))).text


def command_of(name: str, options: Any, positional: Sequence[str] = ()) -> Command:
    """The command that a dataclass of options stands for.

    Args:
        name: of the command.
        options: its fields are the options, as in `cli/options.py`.
        positional: fields whose values stand without an option.
    """
    said = []
    for entry in fields(options):
        value = getattr(options, entry.name)
        default = entry.default if entry.default_factory is MISSING else entry.default_factory()
        if value == default or entry.name in {*positional, *WITHOUT_RESULT}:
            continue
        values = (
            () if value is True else tuple(map(str, value)) if isinstance(value, tuple) else (str(value),)
        )
        said.append(("--" + entry.name.replace("_", "-"), values))
    return Command((name, *(str(getattr(options, field)) for field in positional)), tuple(said))
