"""`push-recovery bench`, `list`, `warmup`, `curves`, `export` and `tune`."""

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from ...controllers.errors import InvalidValueError
from ..output.tables import stem_or_hash
from . import options
from .options import Count, EnvOptions, JsonOption, within


@dataclass(frozen=True, kw_only=True)
class Bench(EnvOptions, JsonOption):
    """Time the parts on this machine."""

    seconds: options.Real = field(default=20.0, metadata=within(0.1, 600))
    """Simulated time of one robot's closed loop [s]. With less than 5 only what is quick is measured: without
    Humanoid-v5, other solvers, more than 64 robots, and the start of a process."""

    @classmethod
    def epilog(cls) -> str:
        """The meaning of the keys of `--json`."""
        from ..bench import EPILOG

        return EPILOG

    def run(self) -> None:
        """Measure and print."""
        from ..bench.run import bench, result_tables

        content = bench(self.env_id, self.seconds)
        self.show(content, result_tables(content))


@dataclass(frozen=True, kw_only=True)
class Names(JsonOption):
    """Names that the other commands take."""

    def run(self) -> None:
        """Print the names."""
        from ..rollout import environments, load_policy
        from ..score.suites import SUITES

        envs, policies = environments.env_ids(), load_policy.policy_names()
        suites = [{**make().summary(), "name": name} for name, make in SUITES.items()]
        texts = map("{name} v{version}: {scenarios} pushes, sha256 {sha256}".format_map, suites)
        parts = {"environments": envs, "policies": [*policies, *load_policy.FORMS], "suites": texts}
        lines = ["\n  ".join([f"{title}:", *names]) for title, names in parts.items()]
        self.show({"envs": envs, "policies": list(policies), "suites": suites}, lines=lines)


@dataclass(frozen=True, kw_only=True)
class WarmUp(JsonOption):
    """Compile all kernels ahead of their first use."""

    def run(self) -> None:
        """Compile, with a bar over the environments that are run for it."""
        from ...controllers.jit import cache_root
        from ..bench import run as warmup
        from ..output.progress import Work, progress_bars

        names, length = warmup.names(), "about 2 minutes where they are to be compiled, else seconds"
        with progress_bars(("kernels",), len(names), Work("all kernels", length, cache_root())) as bars:
            for done, name in enumerate(warmup.warm_up()):
                bars.set("kernels", done, name)
            bars.set("kernels", len(names))
        self.show({"cache": str(cache_root())}, lines=[f"kernels: {cache_root()}"])


FOLDER = Path("runs/curves")
BASE = "residual"  # whose curve begins at the planner's own share


@dataclass(frozen=True, kw_only=True)
class Curves(options.Options):
    """Draw learning curves of policies from their files."""

    policies: Annotated[
        Positional[tuple[str, ...]], arg(metavar="[NAME|FILE ...]", help_behavior_hint="")
    ] = ("",)
    """Learned policies by name or file (by default all that come with the package)."""
    ceiling: options.RealOrNone = field(default=None, metadata=within(0, 1))
    """Share of pushes, 0 to 1, that is drawn as the ceiling, such as that of hard (docs/hindsight.md)."""
    out: options.Directory = None
    """Directory for curves.png and curves.svg, or curves-A-B.* of named policies (default: runs/curves)."""

    def run(self) -> None:
        """Draw, and print the last point of each."""
        from ..output.rows import require_place
        from ..record.plot import learning_curve, save_learning_curves
        from ..rollout.load_policy import shipped_names

        names = shipped_names() if self.policies == ("",) else self.policies
        if not names:
            raise InvalidValueError("no trained policy comes with this version: name a policy file")
        curves = [learning_curve(name) for name in names]
        lines = [(f"two-stage, {c.profile}", c.recovered[0]) for c in curves if c.name == BASE]
        if self.ceiling is not None:
            lines.append(("ceiling", self.ceiling))
        directory = FOLDER if self.out is None else Path(self.out)
        named = "" if self.policies == ("",) else f"-{stem_or_hash(names, ' '.join(names))}"
        require_place(directory / f"curves{named}.png")
        for curve in curves:
            first, last, steps = curve.recovered[0], curve.recovered[-1], curve.timesteps[-1]
            print(f"{curve.name}, {curve.profile}: {first:.3f} -> {last:.3f} after {steps} actions")
        for path in save_learning_curves(curves, lines, directory, f"curves{named}"):
            print(path)


@dataclass(frozen=True, kw_only=True)
class Export(EnvOptions):
    """Write a learned policy in the format of others."""

    policy: Annotated[Positional[str], arg(metavar="POLICY")]
    """Learned policy by name (see list) or file."""
    onnx: Annotated[str, arg(metavar="FILE")]
    """ONNX file to write. It holds normalisation and network as float32; its metadata say what a residual's
    output means (docs/policies.md)."""

    def run(self) -> None:
        """Write the file, and say how well it agrees; one that does not compute the same is not written."""
        from ...controllers.policies.learned import NetworkPolicy
        from ..record.onnx_export import export_onnx, require_onnx
        from ..rollout import environments, policy_source

        require_onnx()
        source = policy_source.policy_sources(self.policy)[self.policy]
        env = environments.make_env_for(source.origin, self.env_id)
        try:
            policy = source.load(env)
            if not isinstance(policy, NetworkPolicy):
                raise InvalidValueError(f"policy {self.policy!r} has no network: name a learned one")
            difference = export_onnx(policy, env, Path(self.onnx))
        finally:
            env.close()
        print(f"{self.onnx}: agrees with numpy to {difference:.1e} in the action")


@dataclass(frozen=True, kw_only=True)
class DatasetCommand(EnvOptions, options.RobotOptions, options.JsonOption):
    """Write what policies do on a suite as Minari data sets, one for each policy."""

    policies: options.Policies = ("two-stage",)
    suite: options.SuiteName = "quick"
    out: options.Directory = None
    """Minari's folder of data sets (default: that of MINARI_DATASETS_PATH, otherwise ~/.minari/datasets). A
    data set that is there and of the same suite, policies and code is kept."""
    workers: options.Count = field(default_factory=options.default_workers, metadata=within(1))
    """Number of threads that share the robots; it changes no result."""

    def run(self) -> None:
        """Run, write, and print what there is."""
        from ..output.progress import progress_bars
        from ..output.tables import Table
        from ..record.dataset import write_datasets

        suite = options.pushes_of(self, self.suite, self.profile)
        root = None if self.out is None else Path(self.out)
        with progress_bars(self.policies, len(suite.scenarios)) as bars:
            found = write_datasets(suite, self.env_id, self.policies, root, self.workers, bars)
        rows = [(one.id, str(one.episodes), str(one.transitions), str(one.recovered)) for one in found]
        columns = ("data set", "episodes", "transitions", "recovered")
        content = {
            "suite": suite.summary(),
            "datasets": [{**vars(one), "path": str(one.path)} for one in found],
        }
        lines = [f"{one.path}: minari.load_dataset({one.id!r})" for one in found]
        self.show(content, [Table("data sets", columns, rows)], lines)


RACED = 0.5  # of the pushes that a trial runs on average, as the worse ones end early
PushesToTuneOn = Literal["tuning", "tuning-varied", "tuning-quick", "tuning-punches"]


@dataclass(frozen=True, kw_only=True)
class Tune(EnvOptions, options.ErrorOptions, options.RunningOptions):
    """Search settings; the defaults are those of `TuningSettings`."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME")] = ("two-stage",)
    """Planners that are tuned one after the other, each by a search of its own."""
    space: Literal["planner", "robot", "both"] = "planner"
    """What is searched: the planner's gains; the robot's gait box, gait machine and whole-body control; or
    both."""
    only: Annotated[tuple[str, ...] | None, arg(metavar="FIELD", help_behavior_hint="")] = None
    """Groups or fields of the space, such as limits or gait.apex (by default all of it)."""
    trials: Count = field(default=100, metadata=within(1))
    """Number of trials of each planner."""
    suite: Annotated[PushesToTuneOn | None, arg(help_behavior_hint="")] = None
    """Pushes of the search: tuning has single pushes at the pelvis, tuning-varied has pushes of every kind
    under both profiles, tuning-quick such pushes as strong as those of quick, tuning-punches has punches of
    the tour (docs/protocols.md) all over the robot (by default tuning-varied on robots)."""
    scenarios: Count = field(default=256, metadata=within(8))
    """Number of scenarios of a trial that is not stopped early."""
    held_out: Count = field(default=256, metadata=within(8))
    """Number of pushes that the search does not see; start and best meet them at its end."""
    seed: Count = field(default=0, metadata=within(0))
    """Seed of the search."""
    errors: Annotated[str, arg(metavar="JSON")] = "{}"
    """Model errors of every second robot; half of these have the mass error negated (docs/tuning.md)."""

    @property
    def settings(self) -> Any:
        """Settings of each study but for its number of trials, with the first policy's name."""
        from ..tuning.study import TuningSettings

        return TuningSettings(
            self.env, self.policies[0], self.space, self.only or (), self.preset or "", self.seed,
            self.suite or "", self.scenarios, self.held_out, self.model_errors,
        )  # fmt: skip

    def run(self) -> None:
        """Run the studies, print the tables or the object."""
        from ..output.progress import Work, about, episode_seconds, progress_bars
        from ..tuning import study, variants

        each = variants.check_variants(self.settings, self.policies)  # unknown names fail before the bars
        suites = study.suites_of(self.settings)
        trial, held_out = (episode_seconds(self.env, one.scenarios, self.processes) for one in suites)
        length = about(len(each) * (RACED * self.trials * trial + 2 * held_out))
        what = f"{self.trials} trials of {', '.join(each)} on {self.scenarios} pushes"
        place = self.directory or variants.place_of(self.settings, list(each))
        work = Work(what, length, place)
        bars: list[Any] = []

        def show(row: dict[str, Any], best: dict[str, Any], policy: str) -> None:
            bars[0].set(policy, row["trial"], f"best {best['score']:.3f} (trial {best['trial']})")

        with ExitStack() as stack:
            found = variants.tune_variants(
                self.settings, self.policies, self.trials, self.processes, place, self.overwrite,
                {name: partial(show, policy=name) for name in each},
                lambda: bars.append(stack.enter_context(progress_bars(list(each), self.trials, work))),
            )  # fmt: skip
        lines = [f"preset with all of these variants: {found.path}"]
        self.show(variants.summary(found), variants.result_tables(found), lines)
