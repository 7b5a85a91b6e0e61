"""From words to the options of a command, by tyro; bad words become one error of one line."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import redirect_stderr
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

from ...controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError

if TYPE_CHECKING:
    from .options import Options

PROGRAM = "push-recovery"
COMMANDS = {  # module, class and what it does; a module is loaded when its command is asked for
    "evaluate": (".commands.evaluate", "Evaluate",
                 "Score policies on a suite: recovery rates on the same pushes."),
    "compare": (".commands.compare", "Compare",
                "Compare two policies on the same pushes: exact McNemar test and score interval."),
    "frontier": (".commands.frontier", "Frontier",
                 "Find the largest recoverable push in each direction, at the start of a left stance after "
                 "four nominal steps."),
    "sensitivity": (".commands.sensitivity", "Sensitivity",
                    "Run a sample of a suite under other solvers, time steps, contacts, losses and "
                    "delays: what its outcomes depend on."),
    "ceiling": (".commands.ceiling", "CeilingCommand",
                "Search every push that all policies lose for actions that recover from it: a lower bound on "
                "what is possible."),
    "corrections": (".commands.corrections", "Corrections",
                    "Show what a residual adds to the planner, by the direction of the push and by step."),
    "reproduce": (".commands.reproduce", "Reproduce",
                  "Measure the paper's results again on the pendulum: scenarios, ablations, limits, "
                  "pictures."),
    "tune": (".tools.tune", "Tune",
             "Search the settings of planner and robot by CMA-ES, on pushes of their own. The best becomes "
             "DIR/preset.json; a stopped search goes on, also with more trials."),
    "bench": (".tools.bench", "Bench",
              "Time the physics, the planner and the closed loop on this machine, beside Humanoid-v5 and "
              "other solvers."),
    "list": (".tools.names", "Names", "List environments, policies and suites."),
    "protocol": (".sharing.protocol", "ProtocolCommand",
                 "Run the push protocols of other groups (kick, tour) beside what they published."),
    "submit": (".sharing.submit", "Submit",
               "Check results by running a sample of their rows again, and put them on a leaderboard."),
    "robot": (".sharing.robot", "RobotCommand",
              "Make a robot of your own from a model: robot new FILE.xml guesses its parts, for "
              "your review."),
    "suite": (".sharing.suite", "SuiteCommand",
              "Write a suite of your own: suite new --seed N --out FILE draws pushes that nobody has met."),
    "warmup": (".tools.warmup", "WarmUp",
               "Compile all kernels now, for every later process of this user. It takes minutes once, "
               "and seconds later."),
    "play": (".tools.play", "Play",
             "Push a walking robot in the browser; or write one push to a video, picture, log or plot."),
    "curves": (".tools.curves", "Curves",
               "Draw how policies learned: recovered against samples, beside planner and ceiling."),
    "export": (".tools.export", "Export",
               "Write a learned policy as ONNX, for runtimes that know nothing of this package."),
    "train": ("...training.cli.train", "Train",
              "Train with PPO of Stable-Baselines3: a residual on the planner, or from scratch."),
    "policies": ("...training.cli.policies", "Policies",
                 "Train the policies that come with the package again, each by its recipe."),
}  # fmt: skip
WORDS = {  # what tyro says of Python's own number types and of a group of options, and what this program says
    r":? invalid literal for int\(\) with base 10:": " must be an integer, got",
    r":? could not convert string to float:": " must be a number, got",
    r"'settings\.(\w+)'": r"'\1'",
}
FRAME = "╭╮╰╯│"
MEANT = "Perhaps you meant:"


def parse(name: str, words: Sequence[str]) -> Options:
    """The options of a command; those not given have its defaults.

    Raises:
        UnknownNameError: There is no such command.
        InvalidValueError: An option is unknown, lacks its value, or has an impossible one.
        SystemExit: Help was asked for, and has been printed.
    """
    if name not in COMMANDS:
        raise UnknownNameError("command", name, COMMANDS)
    module, kind, _ = COMMANDS[name]
    command: type[Options] = getattr(import_module(module, __package__), kind)
    options = _parse(name, command, words)
    default = options.defaults()
    return options if default is None else _parse(name, command, words, default)


def _parse(
    name: str, command: type[Options], words: Sequence[str], default: Options | None = None
) -> Options:
    import tyro

    said = io.StringIO()
    told = partial(
        tyro.cli, command, prog=f"{PROGRAM} {name}", description=COMMANDS[name][2], args=list(words),
        config=(tyro.conf.FlagCreatePairsOff,),
    )  # fmt: skip
    try:
        with redirect_stderr(said):
            return told() if default is None else told(default=default)
    except SystemExit as leave:
        if not leave.code:
            print(getattr(command, "EPILOG", ""), end="")
            raise
        raise (_cause(leave) or InvalidValueError(one_line(said.getvalue()))) from None


def _cause(error: BaseException | None) -> PushRecoveryError | None:
    """The error of this project that led to another one, if any: what the options themselves refused."""
    while error is not None and not isinstance(error, PushRecoveryError):
        error = error.__context__
    return error


def one_line(box: str) -> str:
    """What a framed message of tyro says, without its title, its frame, and its hints at the help."""
    lines = [line.strip(FRAME + " ") for line in box.splitlines()][1:]
    rules = [i for i, line in enumerate(lines) if len(line) > 1 and set(line) <= {"─", "-"}]
    began = 1 if rules[:1] == [0] else 0  # a terminal without UTF-8 has a rule below the title
    end = next((i for i in rules if i >= began), len(lines))
    text = " ".join(" ".join(lines[began:end]).split()).removeprefix("Error parsing ")
    hints = lines[lines.index(MEANT) :] if MEANT in lines else []
    meant = re.search(r"--[\w-]+", " ".join(hints))
    for theirs, ours in WORDS.items():
        text = re.sub(theirs, ours, text)
    return f"{text}; did you mean {meant[0]}?" if meant else text
