"""What each subcommand does with its parsed options."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import Any

from ...controllers.errors import UnknownNameError
from ...envs.scenario.model_errors import ModelErrors
from ...envs.scenario.scenario import Command, Scenario
from ..rollout.outcome import Outcome
from ..score.suites import SUITES, Suite, get_suite, with_errors


def _env(args: argparse.Namespace) -> str:
    """Environment id of the options, with their preset."""
    from ..rollout.environments import with_preset

    return with_preset(args.env, args.preset)


def _print_json(content: dict[str, Any]) -> None:
    print(json.dumps(content, allow_nan=False))


def _suite(args: argparse.Namespace) -> Suite:
    return with_errors(get_suite(args.suite), ModelErrors.from_json(args.errors))


def run_evaluate(args: argparse.Namespace) -> int:
    """Evaluate, print the table or the object, write the reports."""
    from ..output.tables import print_table
    from ..score.evaluate import evaluate, write_reports
    from ..score.report import COLUMNS, evaluation_cells, evaluation_markdown, evaluation_title

    suite = _suite(args)
    evaluation = evaluate(suite, _env(args), args.policies, args.workers, args.out, args.overwrite)
    report = write_reports(evaluation, evaluation_markdown(evaluation))
    if args.json:
        _print_json(evaluation.to_dict())
        return 0
    print_table(evaluation_title(evaluation), COLUMNS, evaluation_cells(evaluation))
    print(f"report: {report}")
    return 0


def run_compare(args: argparse.Namespace) -> int:
    """Compare two policies, print the table or the object."""
    from ..output.tables import print_table
    from ..score.compare import compare

    comparison = compare(args.a, args.b, _suite(args), _env(args), args.workers, args.out, args.overwrite)
    content = comparison.to_dict()
    if args.json:
        _print_json(content)
        return 0
    low, high = content["ci95"]
    cells = [
        ("both recovered", str(content["both"])),
        (f"only {args.a}", str(content["only_a"])),
        (f"only {args.b}", str(content["only_b"])),
        ("neither", str(content["neither"])),
        (
            f"rate of {args.a} minus rate of {args.b}",
            f"{content['rate_difference']:+.3f} ({low:+.3f} to {high:+.3f})",
        ),
        ("exact McNemar p", f"{content['mcnemar_p']:.3g}"),
    ]
    print_table(f"{_env(args)}: {content['pairs']} pairs of suite {content['suite']}", ("", "value"), cells)
    print(f"outcomes: {comparison.directory / 'outcomes.jsonl'}")
    return 0


def run_frontier(args: argparse.Namespace) -> int:
    """Scan the directions, write picture and frontier.json, print the table or the object."""
    from ...controllers.files import write_text
    from ..frontier.plot import save_pictures
    from ..frontier.report import frontier_cells, frontier_columns, write_frontier_reports
    from ..frontier.scan import FrontierSettings, default_grid, frontier
    from ..output.tables import print_table

    settings = FrontierSettings(
        _env(args),
        args.grid or default_grid(_env(args)),
        args.duration,
        args.body,
        Command(args.vx, args.vy),
        ModelErrors.from_json(args.errors),
    )
    result = frontier(settings, args.policies, args.directions, args.workers, args.out, args.overwrite)
    objects = {name: result.to_dict(name) for name in result.rows}
    content = next(iter(objects.values())) if len(objects) == 1 else {"policies": objects}
    write_text(result.directory / "frontier.json", json.dumps(content, indent=1) + "\n")
    pictures = save_pictures(result)
    title = f"{_env(args)}: largest force before the first failure [N]"
    report = write_frontier_reports(result, title)
    if args.json:
        _print_json(content)
        return 0
    title = f"{title} (share of F* of its own box, of the paper's; largest survived)"
    print_table(title, frontier_columns(result), frontier_cells(result))
    print(f"report: {report}")
    print("pictures: " + ", ".join(str(path) for path in pictures))
    return 0


def run_reproduce(args: argparse.Namespace) -> int:
    """Measure the paper's results again, print the tables or the object."""
    from ..reproduction.report.command import run

    return run(args)


def run_tune(args: argparse.Namespace) -> int:
    """Run or resume a study, print its tables or the object."""
    from ..tuning.command import run

    return run(args)


def run_bench(args: argparse.Namespace) -> int:
    """Measure and print."""
    from ..bench.run import bench
    from ..bench.tables import print_tables

    content = bench(_env(args), args.seconds)
    if args.json:
        _print_json(content)
    else:
        print_tables(content)
    return 0


def run_warmup(args: argparse.Namespace) -> int:
    """Compile all kernels, with a bar over the environments that are run for it."""
    from ...controllers.compiled.cache_place import cache_root
    from ..bench.warmup import names, warm_up
    from ..output.progress import progress_bars

    with progress_bars(("kernels",), len(names())) as bars:
        for done, name in enumerate(warm_up()):
            bars.set("kernels", done, name)
        bars.set("kernels", len(names()))
    if args.json:
        _print_json({"cache": str(cache_root())})
    else:
        print(f"kernels: {cache_root()}")
    return 0


def run_list(args: argparse.Namespace) -> int:
    """Names that the other commands take."""
    from ..rollout.environments import env_ids
    from ..rollout.load_policy import FORMS, policy_names

    suites = {name: make().summary() for name, make in SUITES.items()}
    if args.json:
        _print_json({"envs": env_ids(), "policies": list(policy_names()), "suites": list(suites.values())})
        return 0
    print("environments:", *env_ids(), sep="\n  ")
    print("policies:", *policy_names(), *FORMS, sep="\n  ")
    print("suites:")
    for name, suite in suites.items():
        print(f"  {name} v{suite['version']}: {suite['scenarios']} pushes, sha256 {suite['sha256']}")
    return 0


def run_play(args: argparse.Namespace) -> int:
    """Render one episode."""
    from .play import play

    scenario = _play_scenario(args)
    outcome, path = play(_env(args), args.policy, scenario, args.out)
    print(f"{scenario.id}: {_verdict(outcome)}" + (f"; {path}" if path else ""))
    return 0


def _verdict(outcome: Outcome) -> str:
    """What became of an episode, for people."""
    if outcome.recovered_at is not None and outcome.recovered:
        return f"recovered, from {outcome.recovered_at:.2f} s on"
    if outcome.survived:
        return f"survived {outcome.end_time:.2f} s, not settled"
    return f"fell after {outcome.end_time:.2f} s ({outcome.failure_reason})"


def _play_scenario(args: argparse.Namespace) -> Scenario:
    """The scenario named, or the frontier's push with the options' force and direction."""
    errors = ModelErrors.from_json(args.errors)
    if args.suite is not None or args.scenario is not None:
        suite = with_errors(get_suite("quick" if args.suite is None else args.suite), errors)
        ids = [scenario.id for scenario in suite.scenarios]
        name = ids[0] if args.scenario is None else args.scenario
        if name not in ids:
            raise UnknownNameError(
                f"scenario of suite {suite.name}", name, [*ids[:3], f"... {len(ids)} in all"]
            )
        return suite.scenarios[ids.index(name)]
    from ..frontier.scan import FrontierSettings

    settings = FrontierSettings(
        _env(args), duration=args.duration, body=args.body, command=Command(args.vx, args.vy), errors=errors
    )
    scenario = settings.scenario(args.psi, args.force)
    return replace(scenario, id=f"push-{args.force:g}N-{args.psi:g}deg")
