"""`push-recovery protocol kick|tour`, `submit`, `robot new`, `policy inspect|check` and `suite new`."""

from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from ...controllers.errors import InvalidValueError
from ...controllers.validation import parse_json
from . import options
from .options import Count, EnvOptions, JsonOption, RunningOptions, within

MOST = {"kick": 200, "tour": 3000}  # from there on run ids are of pushes for tuning


@dataclass(frozen=True, kw_only=True)
class ProtocolCommand(EnvOptions, options.TrustOption, RunningOptions):
    """Run policies under the push protocol of another group, beside what it published of the same pushes."""

    protocol: Positional[Literal["kick", "tour"]]
    """kick: RecoverFormer's jumps of the base's velocity; tour: the teleop-walking-benchmark's punches on a
    tour of 90 s."""
    policies: options.Policies = ("two-stage",)
    form: Annotated[
        Literal["stated", "coded", "force"] | None,
        arg(metavar="NAME", help_behavior_hint="(default: stated)"),
    ] = None
    """Form of kick: stated, as the paper says (8 directions, horizontal); coded, as its program does; or
    force, the same impulse as a force of 0.1 s on the pelvis."""
    episodes: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: 200, of tour 64)")] = (
        field(default=None, metadata=within(1))
    )
    """Number of episodes of each level of kick (200 at most), or of run ids of tour, counted from 0."""
    collisions: Annotated[bool, arg(help_behavior_hint="")] = True
    """Let only feet and shanks collide (by default all legs, arms and the trunk collide with each other and
    with the floor)."""
    stand: bool = False
    """Let robots that are at rest stand on both feet (otherwise they step in place)."""

    arms: Annotated[
        Literal["own", "held", "walking"] | None, arg(metavar="NAME", help_behavior_hint="(default: own)")
    ] = None
    """Arms of a G1 on tour: left to the policy, or, as the benchmark's harness has them, held or walking at
    random; then a policy must drive all joints (docs/contenders.md)."""
    punches: Annotated[bool, arg(help_behavior_hint="")] = True
    """Walk the tour without punches."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.arms is not None and self.protocol != "tour":
            raise InvalidValueError(f"--arms is for tour, not {self.protocol}")
        if not self.punches and self.protocol != "tour":
            raise InvalidValueError(f"--no-punches is for tour, not {self.protocol}")
        if self.form is not None and self.protocol != "kick":
            raise InvalidValueError(f"--form is for kick, not {self.protocol}")
        if self.episodes is not None and self.episodes > MOST[self.protocol]:
            raise InvalidValueError(
                f"--episodes must be at most {MOST[self.protocol]} of {self.protocol}, got {self.episodes}"
            )

    def run(self) -> None:
        """Run it, print one table or object, write the reports."""
        from ..protocols import kick, report, run, tour

        driven = self.arms in run.ARMS
        robot = run.biped_of(self.env_id, driven)
        form = f"arms {self.arms}" if driven else self.form or "stated"
        if self.protocol == "tour":
            scenarios = tuple(tour.tour_scenario(one, robot) for one in range(self.episodes or 64))
        else:
            levels = kick.kick_scenarios(form, self.episodes or MOST["kick"], robot.robot.mass).values()
            scenarios = tuple(scenario for level in levels for scenario in level)
        asked = run.PushProtocol(self.protocol, form, robot.robot, scenarios)
        asked = asked.with_collisions() if self.collisions else asked
        asked = asked.standing() if self.stand else asked
        asked = asked if self.punches else asked.unpushed()
        policies = self.trusted(self.policies)
        found = run.run_protocol(asked, self.env_id, policies, self.processes, self.directory, self.overwrite)
        lines = [f"report: {report.write_protocol_reports(found)}"]
        self.show(report.to_dict(found), report.result_tables(found)[:1], lines)


@dataclass(frozen=True, kw_only=True)
class Submit(options.WorkerOptions):
    """Check results by running a random sample of their rows again, and put them on a leaderboard."""

    directory: Annotated[Positional[str], arg(metavar="DIR")]
    """Directory that evaluate has written, with all rows of its suite."""
    suite: options.NameOrFile = None
    """Suite of the results, if it is a file of your own; its hash has to be that of the results."""
    board: Annotated[str, arg(metavar="DIR")] = "leaderboard"
    """Folder of the leaderboard. It gets a file for each policy on each suite, and a page made of them."""
    sample: Count = field(default=32, metadata=within(1))
    """Number of rows of each policy that are run again."""
    seed: Annotated[
        int | None, arg(metavar="N", help_behavior_hint="(default: another sample every time)")
    ] = field(default=None, metadata=within(0))
    """Seed of the sample."""
    trust: options.Flag = False
    """Import the modules that environment or policies of the results name, which runs their code, as you
    (docs/reliability.md)."""

    def run(self) -> None:
        """Check, add the entries, write the page; one writer a board, whose page is made of all entries."""
        from ..output.rows import Writer, require_place
        from ..score import leaderboard

        board = Path(self.board)
        submission = leaderboard.read_submission(Path(self.directory), self.suite, self.trust)
        page = board / leaderboard.PAGE
        with Writer(board):
            require_place(page)
            leaderboard.read_board(board)  # refuses what is no entry before anything is run and written
            samples = leaderboard.sample_of(submission, self.sample, self.seed)
            leaderboard.run_again(submission, samples, self.processes, self.trust)
            entries = {
                name: leaderboard.entry_of(submission, name, len(samples[name])) for name in submission.rows
            }
            files = {name: str(leaderboard.add_entry(board, entry)) for name, entry in entries.items()}
        lines = [
            f"{name}: {entry['score']['recovered']} of {entry['score']['episodes']} recovered, "
            f"{entry['checked']} rows run again: {files[name]}"
            for name, entry in entries.items()
        ]
        lines.append(f"page: {page}")
        self.show({"entries": entries, "files": files, "page": str(page)}, lines=lines)


@dataclass(frozen=True, kw_only=True)
class RobotCommand(JsonOption):
    """Write a robot file and a preset from a model; --env NAME.robot.json of other commands takes it."""

    action: Positional[Literal["new"]]
    """new: guess the parts of a robot and derive its sizes."""
    model: Annotated[Positional[str], arg(metavar="FILE.xml")]
    """MJCF or URDF of the robot: a file, or PACKAGE/PATH in a package of the extra robots."""
    name: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: that of the model)")] = None
    """Name of the robot and of its files."""
    out: Annotated[str, arg(metavar="DIR")] = "."
    """Folder that NAME.robot.json and NAME.preset.json are written to."""

    def run(self) -> None:
        """Guess, derive, write, and print what was guessed."""
        from ...envs.robots.model_files import model_file
        from ..robot_tools.new_robot import new_robot, save, summary

        name = self.name or model_file(self.model).stem
        if not name.replace("-", "").replace("_", "").isalnum():
            raise InvalidValueError(f"--name has letters, digits, - and _ only, got {name!r:.200}")
        robot = new_robot(self.model, name)
        paths = save(robot, Path(self.out))
        about = summary(robot)
        lines = [
            *_guess_lines(about), f"\nRead {paths[0]} and change what is wrong; then",
            f"  push-recovery evaluate --env {quote(str(paths[0]))} --policies two-stage --suite quick",
        ]  # fmt: skip
        self.show({**about, "files": [str(path) for path in paths]}, lines=lines)


def _guess_lines(about: dict[str, Any]) -> list[str]:
    """Guessed parts and sizes, for review."""
    robot, limits = about["robot"], about["limits"]
    rows = {
        "pelvis, trunk": f"{about['pelvis']}, {about['trunk']}",
        "left leg": ", ".join(about["left_leg"]),
        "right leg": ", ".join(about["right_leg"]),
        "waist pitch, roll": ", ".join(str(joint or "none") for joint in about["waist"]),
        "held at [rad]": ", ".join(f"{joint} {angle:g}" for joint, angle in about["held"].items()) or "none",
        "no joints here": ", ".join(about["fixed"]) or "none",
        "soles [m]": " and ".join("{:g} x {:g}".format(*sole["size"]) for sole in about["soles"]),
        "mass [kg]": f"{robot['mass']:.1f}",
        "CoM height [m]": f"{robot['com_height']:.3f}",
        "trunk about the waist": f"{robot['trunk_inertia']:.2f} kg m^2, {robot['trunk_torque_max']:g} N m"
        if any(about["waist"])
        else "no flywheel",
        "steps [m]": f"{limits['length_min']:.2f} to {limits['length_max']:.2f} long, "
        f"{limits['width_min']:.2f} to {limits['width_max']:.2f} wide",
        "F* [N], 0.1 s, every 45 degrees": ", ".join(f"{force:.0f}" for force in about["limit_N"]),
    }
    return [f"{name:32}{text}" for name, text in rows.items()]


SHOWN = 60  # characters of a field's value


@dataclass(frozen=True, kw_only=True)
class PolicyCommand(JsonOption):
    """Read and try the contract of a policy that was trained elsewhere (docs/contenders.md)."""

    action: Positional[Literal["inspect", "check"]]
    """inspect: print the contract, and where each field comes from. check: let the policy stand and walk five
    commands without a push, and say whether the contract is at fault or the policy is weak."""
    file: Annotated[Positional[str], arg(metavar="FILE")]
    """FILE.onnx, deploy.yaml, a configuration of unitree_rl_gym, CONTRACT.yaml, or a name such as
    holosoma-g1-ppo."""
    set: Annotated[tuple[str, ...] | None, arg(metavar="FIELD=VALUE", help_behavior_hint="")] = None
    """Fields of the contract, as YAML, above what the files say."""
    out: options.FileName = None
    """CONTRACT.yaml to write, which evaluate and all other commands take as a policy; of check, with the
    change that mends it, if there is one."""
    robot: Annotated[
        str | None, arg(metavar="NAME|FILE", help_behavior_hint="(default: the one with its joints)")
    ] = None
    """Robot of check: its name or robot file."""
    trust: options.Flag = False
    """Let check load a network in TorchScript, which runs the code that is in it, as you
    (docs/reliability.md)."""

    def run(self) -> None:
        """Read, write, print; with check: run the controls."""
        from ..output.rows import require_place
        from ..rollout.contract_files import changes_of, read_contract

        if self.out is not None and Path(self.out).suffix not in (".yaml", ".yml"):
            raise InvalidValueError(
                f"--out must end in .yaml or .yml to be taken as a policy, got {self.out!r}"
            )
        contract = read_contract(self.file, changes_of(self.set or ()))
        lines = [f"note: {note}" for note in contract.notes]
        if self.out is not None:
            require_place(Path(self.out))
        if self.action == "inspect":
            lines += self._written(contract)
            self.show(contract.contract.to_dict(), [_contract_table(contract)], lines)
        else:
            self._check(contract, lines)

    def _written(self, contract: Any) -> list[str]:
        """Write a contract where that is asked for, and say so."""
        if self.out is None:
            return []
        contract.write(Path(self.out))
        return [f"contract: {self.out}"]

    def _check(self, contract: Any, lines: list[str]) -> None:
        from ..output.tables import Table
        from ..robot_tools import policy_check

        robot = self.robot or policy_check.robot_of(contract)
        found = policy_check.diagnose(contract, policy_check.Controls(robot, self.trust))
        rows = [
            (name, f"{c.command.vx:g}, {c.command.vy:g}, {c.command.turn:g}",
             "-" if c.fell_at is None else f"{c.fell_at:.2f}",
             f"{c.velocity[0]:.2f}, {c.velocity[1]:.2f}, {c.turn:.2f}", f"{c.drift:.3f}",
             "yes" if c.passed else "no")
            for name, c in found.controls.items()
        ]  # fmt: skip
        columns = ("control", "command [m/s, m/s, rad/s]", "fell at [s]", "measured", "moved [m]", "passed")
        repair = found.repair
        why = "it stands and walks as commanded" if found.passed else "none of the changes tried helps"
        lines += self._written(contract if repair is None else repair.contract)
        if repair is not None:
            why = f"{repair.field}, {repair.what}, and it passes every control"
        content = {"robot": robot, "verdict": found.verdict, "passed": found.passed,
                   "field": None if repair is None else repair.field,
                   "controls": {name: c.to_dict() for name, c in found.controls.items()}}  # fmt: skip
        lines = [f"{found.verdict}: {why}", *lines]
        self.show(content, [Table(f"{contract.name} on {robot}, unpushed", columns, rows)], lines)


def _contract_table(contract: Any) -> Any:
    """Fields of a contract, their values and where each comes from."""
    from ..output.tables import Table
    from ..rollout.contract import fields_of

    rows = [
        (path, text if len(text) <= SHOWN else f"{text[:SHOWN]}...",
         f"{origin.source}: {origin.detail}".rstrip(": "))
        for path, text, origin in fields_of(contract)
    ]  # fmt: skip
    return Table(f"contract of {contract.name}", ("field", "value", "source"), rows)


@dataclass(frozen=True, kw_only=True)
class SuiteCommand(JsonOption):
    """Write a suite of pushes that nobody has met; --suite FILE of other commands runs it."""

    action: Positional[Literal["new"]]
    """new: draw a suite."""
    like: Annotated[str, arg(metavar="NAME")] = "varied"
    """Pushes that are drawn: standard, hard, quick, varied, standing, disturbances, terrain, terrain-blind,
    or one of the shifts (docs/evaluation.md#suites)."""
    seed: Count = field(metadata=within(0))
    """Seed of the draw; the same seed gives the same suite on every machine."""
    scenarios: Count = field(default=256, metadata=within(1, 65536))
    """Number of scenarios; every whole 256 of them are stratified."""
    name: Annotated[
        str | None, arg(metavar="NAME", help_behavior_hint="(default: the kind and the seed)")
    ] = None
    """Name of the suite."""
    pushes: Annotated[str, arg(metavar="JSON")] = "{}"
    """Ranges in place of those of standard or hard, by fields of PushDistribution,
    such as '{"impulse_min": 150, "impulse_max": 180, "push_duration": 0.2}'."""
    out: Annotated[str, arg(metavar="FILE")]
    """Suite file to write."""

    def run(self) -> None:
        """Draw and write the suite, and print its hash."""
        from ..output.rows import require_place
        from ..score.suites import new_suite

        pushes = parse_json("text of --pushes", self.pushes)
        if not isinstance(pushes, dict):
            raise InvalidValueError(f"--pushes must be a JSON object, got {self.pushes!r:.200}")
        suite = new_suite(self.like, self.seed, self.scenarios, self.name, pushes)
        path = Path(self.out)
        require_place(path)
        suite.save(path)
        line = f"{path}: suite {suite.name}, {len(suite.scenarios)} pushes, sha256 {suite.sha256}"
        self.show({**suite.summary(), "out": str(path)}, lines=[line])
