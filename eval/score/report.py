"""An evaluation as tables: rates, pairs, kinds of push, effort, reasons, limits; several side by side."""

import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

from ...controllers.files import write_text
from ...controllers.settings import VARIANTS
from ...controllers.whole_body.limits import LIMIT_NAMES
from ...envs.scenario.push import Disturbance
from ...envs.scenario.scenario import Scenario
from ..output.statistics import PairedCounts, holm
from ..output.tables import Table, markdown_page, named_apart, write_reports
from ..rollout.outcome import MEASURES, Measure, Row, Score, driven_joints, limit_words, reason_words
from ..rollout.policy_source import search_words, stated_trials
from ..rollout.strategy import STRATEGIES, strategy_of
from .draw import count_of, walk_of
from .evaluate import Comparison, Evaluation, limit_summary, limits_met

Evaluations = Mapping[
    str, Evaluation
]  # by profile, the first one what the others are held against, or by suite
RECOVERED_NOTE = (
    "Recovered: no fall until {}; over the last two steps DCM offset within 5 cm "
    "of nominal and mean velocity within 0.15 m/s of the command. Intervals: Wilson, 95 %."
)
TURNED_NOTE = (
    "Turned: of those recovered, how many end over 30 degrees off the commanded heading. Bent: how many had "
    "a trunk that leaned over 90 degrees."
)
DRIVEN_NOTE = (
    "Targets of: how many joints, arms included, a policy moves that was trained elsewhere and knows neither "
    "model nor velocity; it stands at rest, and its recovered asks for one second within 0.15 m/s of the "
    "command and 20 degrees of upright, wherever its feet are. Others move legs and waist and know the model."
)
SEARCH_NOTE = (
    "Found by: trials of the search for a planner's settings, or actions of a policy's training and the "
    "bodies that were pushed, or the kinds of suites, in it: other pushes are new to it. Imitation is "
    "training without any."
)
PAIRS_NOTE = "Differences with Newcombe's 95 % interval; p: exact McNemar, and corrected for several pairs."
LIMITS_NOTE = (
    "Limits count from the start of the first push on; docs/evaluation.md says what each is. First: falls "
    "that met it first. Met: share of the episodes that met it. Time: mean share of the time until the end."
)
STRATEGIES_NOTE = (
    "Recovered of how many, by what answered the pushes of a robot that stood. Ankle: the centre of pressure "
    "alone could have caught it. Hip: the swing of the trunk was needed, too. Step: a foot stepped. "
    "Needless: it lifted while the robot could still have been caught in place."
)
SMALLEST_P = 0.0001  # that is written out
MINUS = "\N{MINUS SIGN}"
EXPLAINED = {  # why an episode does not count as recovered
    "not_settled": "stayed up, but was not back in its commanded walk at the end",
    "com_height": "the centre of mass sank too low above the standing foot",
    "pelvis_tilt": "the pelvis leaned over by more than 60 degrees",
    "not_finite": "the simulation ran out of numbers",
    "dcm_diverged": "its motion ran away farther than any step can catch",
}
LIMITS = {  # of controllers/whole_body/limits.py, in words
    "step_length": "the planned step is as long as it may be",
    "step_width": "the planned step is as wide or as narrow as it may be",
    "step_time": "the foot cannot come down any sooner",
    "cop": "the planned centre of pressure is at the edge of where it may be",
    "trunk_torque": "the trunk is swung as hard as it may be",
    "trunk_angle": "the trunk leans as far as it may",
    "leg_reach": "the foothold is farther than the leg reaches",
    "joint_torque": "a motor gives all it can",
    "sole_edge": "the pressure under the sole is at its edge",
    "contact": "friction or load under the foot is at its bound",
    "touchdown_error": "the foot landed elsewhere or later than planned",
    "dcm_tracking": "the robot's motion is not what was planned",
}


def _names(names: Iterable[str]) -> str:
    return " and ".join(sorted(set(names))) or "none"


def _parts(scenario: Scenario) -> tuple[Disturbance, ...]:
    return *scenario.pushes, *scenario.kicks, *scenario.disturbances


def floor_of(scenario: Scenario) -> str:
    """What the floor is made of, or that it is level."""
    return " and ".join(part.label for part in scenario.errors.terrains) or "level"


KINDS: dict[str, Callable[[Scenario], str]] = {  # a question about a scenario, whose answers split a suite
    "disturbance": lambda scenario: _names(part.json_name for part in _parts(scenario)),
    "body": lambda scenario: _names(push.body for push in scenario.forces if any(push.force)),
    "count": count_of,
    "command": walk_of,
    "floor": floor_of,
}


def shown_measures() -> dict[str, Measure]:
    """The measures that have a column, by name."""
    return {name: one for name, one in MEASURES.items() if one.label}


def measure_of(name: str, row: Row, scenario: Scenario) -> float | None:
    """A measure of an episode in the row's own unit; None where the row has none."""
    value = MEASURES[name].value
    return row.get("measures", {}).get(name) if value is None else value(row, scenario)


def brief_measures(row: Row) -> str:
    """Measures of an episode in few words; empty where the row lacks one of the measures for it."""
    brief = {name: one for name, one in MEASURES.items() if one.brief}
    values = [row.get("measures", {}).get(name) for name in brief]
    if None in values:
        return ""
    pairs = zip(brief.values(), values, strict=True)
    return ", ".join(measure.brief.format(value * measure.factor) for measure, value in pairs)


def recovering_from_none(evaluation: Evaluation) -> list[str]:
    """Policies without a recovery."""
    return [name for name, rows in evaluation.rows.items() if not any(row["recovered"] for row in rows)]


def effort_summary(evaluation: Evaluation) -> tuple[int, dict[str, dict[str, float | None]]]:
    """How many pushes all policies recover from, and medians over them by policy, in the rows' own units.

    A policy that recovers from none stands aside. None where no row has a measure, as of a pendulum's motors.
    What follows from the end of an episode is of those that end a settling time after the last push.
    """
    aside = recovering_from_none(evaluation)
    able = [place for place, name in enumerate(evaluation.rows) if name not in aside]
    together = [
        pair
        for pair in evaluation.by_scenario()
        if able and all(pair[1][place]["recovered"] for place in able)
    ]
    free = [(scenario, rows) for scenario, rows in together if scenario.duration is None]
    found: dict[str, dict[str, float | None]] = {policy: {} for policy in evaluation.rows}
    for place, summary in enumerate(found.values()):
        for name in shown_measures():
            pairs = (together if MEASURES[name].value is None else free) if place in able else []
            values = (measure_of(name, rows[place], scenario) for scenario, rows in pairs)
            known = [value for value in values if value is not None]
            summary[name] = statistics.median(known) if known else None
    return len(together), found


def effort_table(evaluation: Evaluation) -> Table:
    """Medians of what recovering took; no rows where no episode has measures."""
    together, summary = effort_summary(evaluation)
    shown = shown_measures()
    in_rows = [name for name, measure in shown.items() if measure.value is None]
    measured = any(one[name] is not None for one in summary.values() for name in in_rows)
    headings = (f"{one.label} [{one.unit}]" if one.unit else one.label for one in shown.values())
    pushes = f"{together} of {len(evaluation.suite.scenarios)} pushes"
    lines = [
        (policy, *(measure.text(one[name]) for name, measure in shown.items()))
        for policy, one in (summary.items() if measured else ())
    ]
    aside = ", ".join(recovering_from_none(evaluation))
    but = f" but {aside} (which recovers from none)" if aside else ""
    note = f"Medians over the {pushes} that every policy{but} recovers from; docs/evaluation.md says more."
    return Table("Effort", ("policy", *headings), lines, note)


def groups_of(scenarios: Sequence[Scenario]) -> dict[str, tuple[str, ...]]:
    """Group -> ids of its scenarios, for each kind that has more than one group, in the order they come."""
    found: dict[str, tuple[str, ...]] = {}
    for answer in KINDS.values():
        groups: dict[str, list[str]] = {}
        for scenario in scenarios:
            groups.setdefault(answer(scenario), []).append(scenario.id)
        if len(groups) > 1:
            found |= {name: tuple(groups[name]) for name in sorted(groups)}
    return found


def kinds_table(evaluation: Evaluation) -> Table:
    """Recovered and survived by kind of push; no rows where all pushes are of one kind."""
    place = {scenario.id: i for i, scenario in enumerate(evaluation.suite.scenarios)}

    def cell(rows: Sequence[Row], ids: Sequence[str]) -> str:
        recovered, survived = (
            sum(rows[place[name]][key] for name in ids) for key in ("recovered", "survived")
        )
        return f"{recovered}/{survived}"

    groups = groups_of(evaluation.suite.scenarios)
    lines = [
        (name, str(len(ids)), *(cell(rows, ids) for rows in evaluation.rows.values()))
        for name, ids in groups.items()
    ]
    columns = ("kind of push", "pushes", *evaluation.rows)
    return Table("Kinds of push", columns, lines, "Recovered/survived.")


def strategies_table(evaluation: Evaluation) -> Table:
    """Recoveries by the strategy that answered, steps, and steps not needed; no rows where no robot stood."""
    lines, stood = [], False
    for policy, rows in evaluation.rows.items():
        answered: dict[str | None, list[Row]] = {}
        for row in rows:
            measures = row.get("measures", {})
            strategy = strategy_of(measures.get("soles_margin"), measures.get("lift_off_margin"))
            answered.setdefault(strategy, []).append(row)
        answered.pop(None, None)
        stood = stood or bool(answered)
        stepped = [row["measures"] for row in answered.get("step", ())]
        needless = sum(measures["lift_off_margin"] > 0.0 for measures in stepped)
        cells = (answered.get(strategy, []) for strategy in STRATEGIES)
        lines.append(
            (
                policy,
                *(f"{sum(row['recovered'] for row in cell)} of {len(cell)}" for cell in cells),
                f"{statistics.median(measures['steps'] for measures in stepped):g}" if stepped else "-",
                f"{needless} of {len(stepped)}",
            )
        )
    if not stood:
        return Table("Strategies", (), ())
    columns = ("policy", *STRATEGIES, "median steps", "needless")
    return Table("Strategies", columns, lines, STRATEGIES_NOTE)


def rate_cells(score: Score) -> tuple[str, str]:
    """Rate and Wilson interval as text."""
    low, high = score.ci95
    return f"{score.rate:.3f}", f"{low:.3f}-{high:.3f}"


def count_cells(*counts: int | None) -> tuple[str, ...]:
    """Counts as text; what was not measured is a dash."""
    return tuple("-" if count is None else str(count) for count in counts)


def evaluation_title(evaluation: Evaluation) -> str:
    """Suite, version, hash and environment in one line."""
    suite = evaluation.suite
    return (
        f"{evaluation.env_id}: suite {suite.name} v{suite.version}, {len(suite.scenarios)} pushes, "
        f"sha256 {suite.sha256[:12]}"
    )


def origin_columns(evaluation: Evaluation) -> tuple[dict[str, dict[str, str]], str]:
    """Columns on where policies come from, each cell by policy, and a note on them.

    How much search or training found a policy, and how many joints one drives that acts on all of them; a
    column of which nothing is known is left out.
    """
    of_rows = {name: {str(row.get("policy", name)) for row in rows} for name, rows in evaluation.rows.items()}
    sources = {name: next(iter(found)) if len(found) == 1 else name for name, found in of_rows.items()}
    trials = stated_trials(evaluation.env_id) if set(sources.values()) & set(VARIANTS) else {}
    search = {name: search_words(source, trials) for name, source in sources.items()}
    driven = {name: driven_joints(rows) for name, rows in evaluation.rows.items()}
    columns = {"found by": (search, SEARCH_NOTE), "targets of": (driven, DRIVEN_NOTE)}
    known = {name: pair for name, pair in columns.items() if set(pair[0].values()) != {"-"}}
    return {name: cells for name, (cells, _) in known.items()}, " ".join(note for _, note in known.values())


def recovered_note(*evaluations: Evaluation) -> str:
    """What recovered means, with the times after the last push at which the suites' scenarios end."""
    every = [scenario for one in evaluations for scenario in one.suite.scenarios]
    times = [scenario.settle_time for scenario in every if scenario.duration is None]
    if not times:
        return RECOVERED_NOTE.format("the end")
    ends = " to ".join(dict.fromkeys(f"{time:.3g}" for time in (min(times), max(times))))
    return RECOVERED_NOTE.format(f"{ends} s after the last push")


def rates_table(evaluation: Evaluation) -> Table:
    """Recovered and survived of each policy, and where it comes from."""
    lines, (origins, origin_note) = [], origin_columns(evaluation)
    for name in evaluation.rows:
        score = evaluation.score(name)
        counts = count_cells(score.survived, score.turned, score.bent)
        own = (cells[name] for cells in origins.values())
        lines.append((name, f"{score.recovered}/{score.episodes}", *rate_cells(score), *counts, *own))
    columns = ("policy", "recovered", "rate", "95 % interval", "survived", "turned", "bent", *origins)
    note = f"{recovered_note(evaluation)} {TURNED_NOTE} {origin_note}".strip()
    return Table(evaluation_title(evaluation), columns, lines, note)


def reasons_of(evaluation: Evaluation) -> list[str]:
    """Why episodes did not recover, in the order of EXPLAINED, unknown ones last."""
    met = {reason for name in evaluation.rows for reason in evaluation.score(name).failures}
    return [*(reason for reason in EXPLAINED if reason in met), *sorted(met - EXPLAINED.keys())]


def first_limits(rows: Sequence[Row]) -> str:
    """Limits that falls met first, the most frequent first, with their counts."""
    falls = limits_met(row for row in rows if not row["survived"])
    counts = sorted((-entry["first"], name) for name, entry in falls.items() if entry["first"])
    return ", ".join(f"{limit_words(name)} {-count}" for count, name in counts) or "-"


def reasons_table(evaluation: Evaluation) -> Table:
    """Number of pushes that each policy recovered from and lost for each reason, and what falls met first."""
    reasons, lines = reasons_of(evaluation), []
    for name, rows in evaluation.rows.items():
        score = evaluation.score(name)
        lost = (str(score.failures.get(reason, 0)) for reason in reasons)
        lines.append((name, str(score.recovered), *lost, first_limits(rows)))
    columns = ("policy", "recovered", *map(reason_words, reasons), "first limit of the falls")
    return Table("Why pushes are lost", columns, lines)


def ranked(evaluation: Evaluation) -> list[str]:
    """Policies, the one that recovers most first; equal ones in the order given."""
    return sorted(evaluation.rows, key=lambda name: -evaluation.score(name).recovered)


def points(share: float) -> str:
    """A difference of shares in points of per cent, with its sign."""
    return f"{100.0 * share:+.1f}".replace("-", MINUS)


def p_words(p: float) -> str:
    """A p value as people write it."""
    return f"p < {SMALLEST_P:g}" if p < SMALLEST_P else f"p = {p:.2g}"


def pairs_table(evaluation: Evaluation) -> Table:
    """Every two policies on the same pushes, the better ones first; no rows where there is one alone."""
    pairs = {
        (a, b): PairedCounts.of_rows(evaluation.rows[a], evaluation.rows[b])
        for a, b in combinations(ranked(evaluation), 2)
    }
    corrected, lines = holm([counts.p_value for counts in pairs.values()]), []
    for ((a, b), counts), p in zip(pairs.items(), corrected, strict=True):
        low, high = counts.interval
        difference = f"{points(counts.rate_difference)} ({points(low)} to {points(high)})"
        numbers = map(str, (counts.both, counts.only_a, counts.only_b, counts.neither))
        ps = (p_words(value).removeprefix("p ").removeprefix("= ") for value in (counts.p_value, p))
        lines.append((f"{a} and {b}", *numbers, difference, *ps))
    columns = ("A and B", "both", "only A", "only B", "neither", "A minus B [points]", "p", "p, Holm")
    return Table("Pairs", columns, lines, PAIRS_NOTE)


def limits_table(evaluation: Evaluation) -> Table:
    """Mean share of the time at each limit that was met, of falls and of recoveries."""
    summaries = [limit_summary(rows) for rows in evaluation.rows.values()]

    def cell(summary: Mapping[str, Mapping[str, Mapping[str, float]]], limit: str) -> str:
        times = (summary[part].get(limit, {}).get("time", 0.0) for part in ("falls", "recovered"))
        return "/".join(f"{100.0 * time:.0f}" for time in times)

    return Table(
        "Limits met",
        ("limit", "met while", *evaluation.rows),
        [
            (limit_words(limit), LIMITS.get(limit, ""), *(cell(summary, limit) for summary in summaries))
            for limit in LIMIT_NAMES
            if any(limit in part for summary in summaries for part in summary.values())
        ],
        f"Mean share of the time [%], of falls/of recoveries. {LIMITS_NOTE}",
        words=2,
    )


def limit_details(evaluation: Evaluation) -> list[Table]:
    """Limits that each policy met: how often first and at all, and for how long."""
    columns = [f"{what} in {part}" for part in ("falls", "recovered") for what in ("first", "met", "time")]
    columns.remove("first in recovered")
    nothing, tables = {"first": 0, "met": 0.0, "time": 0.0}, []
    for name, rows in evaluation.rows.items():
        summary, lines = limit_summary(rows), []
        for limit in LIMIT_NAMES:
            if any(limit in part for part in summary.values()):
                fell, stood = (part.get(limit, nothing) for part in summary.values())
                numbers = (f"{part[what]:.2f}" for part in (fell, stood) for what in ("met", "time"))
                lines.append((limit_words(limit), str(fell["first"]), *numbers))
        tables.append(Table(f"Limits of {name}", ("limit", *columns), lines))
    return tables


def evaluation_tables(evaluation: Evaluation) -> dict[str, Table]:
    """The tables of an evaluation by the part of a report that they are in."""
    return {
        "rates": rates_table(evaluation),
        "pairs": pairs_table(evaluation),
        "kinds": kinds_table(evaluation),
        "strategies": strategies_table(evaluation),
        "effort": effort_table(evaluation),
        "reasons": reasons_table(evaluation),
        "limits": limits_table(evaluation),
    }


def write_evaluation_reports(evaluation: Evaluation, reported: Evaluation) -> Path:
    """Write report.json of an evaluation, and report.md, whose path is returned.

    The latter is of `reported`: the same, or with a stored ceiling among its policies.
    """
    content = evaluation.to_dict()
    for name, entry in content["policies"].items():
        entry["limits"] = limit_summary(evaluation.rows[name])
    content["wall_time_s"] = round(evaluation.wall_time, 3)
    tables = [*evaluation_tables(reported).values(), *limit_details(reported)]
    return write_reports(evaluation.directory, content, markdown_page("Evaluation", tables))


def comparison_table(comparison: Comparison) -> Table:
    """Pairs of outcomes of two policies, the difference of their rates, and its p."""
    a, b, content = comparison.a, comparison.b, comparison.to_dict()
    (low, high), scores = content["ci95"], [comparison.evaluation.score(name) for name in (a, b)]
    counted = [
        ("turned", *count_cells(*(one.turned for one in scores))),
        ("bent", *count_cells(*(one.bent for one in scores))),
    ]
    origins, note = origin_columns(comparison.evaluation)
    counted += [(name, cells[a], cells[b]) for name, cells in origins.items()]
    return Table(
        f"{comparison.evaluation.env_id}: {content['pairs']} pairs of suite {content['suite']}",
        ("", "value"),
        [
            ("both recovered", str(content["both"])),
            (f"only {a}", str(content["only_a"])),
            (f"only {b}", str(content["only_b"])),
            ("neither", str(content["neither"])),
            (f"rate of {a} minus rate of {b}",
             f"{content['rate_difference']:+.3f} ({low:+.3f} to {high:+.3f})"),
            (f"survived {a}, {b}", f"{content['survived_a']}, {content['survived_b']}"),
            *((f"{name} {a}, {b}", ", ".join(counts)) for name, *counts in counted),
            ("exact McNemar p", f"{content['mcnemar_p']:.3g}"),
        ],
        f"{TURNED_NOTE} {note}".strip(),
    )  # fmt: skip


def beside_table(evaluations: Evaluations) -> Table:
    """Rates of the same policies in several evaluations, by profile or by suite, and where they come from."""
    every = list(evaluations.values())
    first, lines = every[0], []
    origins, origin_note = origin_columns(first)
    for policy in first.rows:
        cells: list[str] = []
        for evaluation in every:
            one = evaluation.score(policy)
            rates = "{} ({})".format(*rate_cells(one)), f"{one.survived / one.episodes:.3f}"
            cells += *rates, *count_cells(one.turned, one.bent)
        lines.append((policy, *cells, *(column[policy] for column in origins.values())))
    headings = (text for name in evaluations for text in (f"recovered, {name}", "survived", "turned", "bent"))
    note = f"{recovered_note(*every)} {TURNED_NOTE} {origin_note}".strip()
    ids = {tuple(scenario.id for scenario in one.suite.scenarios) for one in every}
    title = evaluation_title(first) if len(ids) == 1 else f"{first.env_id}: {len(every)} suites"
    return Table(title, ("policy", *headings, *origins), lines, note)


def kept_table(a: Evaluation, b: Evaluation, title: str) -> Table:
    """Recoveries and survivals under b, beside those under a.

    Shares of its own number under a; lost and gained recoveries on the same pushes; exact McNemar p.
    """
    lines = []
    for policy in a.rows:
        pairs = PairedCounts.of_rows(a.rows[policy], b.rows[policy])
        before, after = a.score(policy), b.score(policy)
        shares = (after.recovered, before.recovered), (after.survived, before.survived)
        kept = (f"{new / old:.3f}" if old else "-" for new, old in shares)
        lines.append((policy, *kept, str(pairs.only_a), str(pairs.only_b), f"{pairs.p_value:.2g}"))
    columns = ("policy", "recovers of its own", "survives of its own", "lost", "gained", "p")
    return Table(title, columns, lines)


def write_profiles(evaluations: Evaluations, directory: Path) -> Path:
    """Write profiles-exact-hardware.md: rates side by side, then each against the first; returns its path.

    Policies are added as to the reports of the first profile, which come before.
    """
    (first, base), *others = evaluations.items()
    tables = [kept_table(base, one, f"{name} against {first}") for name, one in others]
    path = directory / f"profiles-{'-'.join(evaluations)}{named_apart(base.directory, base.rows)}.md"
    write_text(path, markdown_page("Profiles", [beside_table(evaluations), *tables]))
    return path
