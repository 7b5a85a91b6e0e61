"""Pages from templates: figures as SVG, short labels, commands to type; nothing is asked for elsewhere."""

import hashlib
import html
import io
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path, PurePath
from typing import Any

from ...controllers.errors import MissingExtraError
from ...controllers.files import write_text
from ...envs.scenario.scenario import Scenario
from ..output.rows import machine_kind, source_commit, versions
from ..output.tables import file_stem, stem_or_hash
from ..record.words import direction_words
from ..rollout.environments import code_digest
from ..rollout.outcome import limit_words, reason_words
from ..score.report import KINDS

PROGRAM = "push-recovery"
WITHOUT_RESULT = {"workers", "ray", "out", "overwrite", "json"}  # options that change no outcome
OF_ROBOT = {"--env", "--preset", "--errors"}  # options of `play` that decide what a scenario is, too
OF_SUITE = OF_ROBOT | {"--suite"}
OF_PUSH = OF_ROBOT | {
    "--profile", "--duration", "--body", "--vx", "--vy", "--stand", "--replicas", "--replica-seed"
}  # fmt: skip
OF_PAGE = {"--policies", "--profile"}  # what a later page of a directory is named after
ASKED = re.compile('<meta name="command" content="(.*?)">')  # in a page


@dataclass(frozen=True)
class Command:
    """A command and those of its options that decide outcomes and are not at their defaults."""

    words: tuple[str, ...]  # its name, and what stands without an option
    options: tuple[tuple[str, tuple[str, ...]], ...] = ()  # as ("--suite", ("quick",))

    def page(self, directory: Path) -> str:
        """Name of the page that answers it in a directory, where report.html may answer another question.

        A question about policies by name, and one that comes later, has a page of its own.
        """
        if len(self.words) > 1:
            return f"{self.words[0]}-{stem_or_hash(self.words[1:], self.text)}.html"
        path = directory / PAGE
        asked = ASKED.search(path.read_text(encoding="utf-8")) if path.is_file() else None
        if asked is None or html.unescape(asked[1]) == self.text:
            return PAGE
        which = [value for option, values in self.options if option in OF_PAGE for value in values]
        return f"report-{stem_or_hash(which, self.text)}.html"

    @property
    def text(self) -> str:
        """The line for a shell."""
        words = [word for option, values in self.options for word in (option, *values)]
        return shlex.join([PROGRAM, *self.words, *words])

    def replay(self, profile: str, scenario_id: str, policy: str) -> str:
        """The line that draws one scenario of a suite under a profile and says what became of it."""
        under = {} if profile == "exact" else {"--profile": profile}
        more = {**under, "--scenario": scenario_id}
        return self._play(OF_SUITE, more, scenario_id, policy)

    def replay_push(self, psi_deg: float, force: float, policy: str, replica: int | None = None) -> str:
        """The line that draws the frontier's push of a force [N] towards psi [deg], or a replica of it."""
        which = {} if replica is None else {"--replica": str(replica)}
        more = {"--psi": f"{psi_deg:g}", "--force": f"{force:g}", **which}
        return self._play(OF_PUSH, more, f"{psi_deg:g}deg-{force:g}N", policy)

    def _play(self, kept: set[str], more: Mapping[str, str], stem: str, policy: str) -> str:
        """`play` with some of this command's options, others besides, and a picture's name."""
        picture = file_stem(f"{stem}-{policy}") + ".png"
        options = {name: values for name, values in self.options if name in kept}
        added = {name: (value,) for name, value in {**more, "--policy": policy, "--out": picture}.items()}
        return Command(("play",), (*options.items(), *added.items())).text


def command_of(name: str, options: Any, positional: Sequence[str] = ()) -> Command:
    """The command of a dataclass of options; the values of `positional` fields stand without an option."""
    given = []
    for entry in fields(options):
        value = getattr(options, entry.name)
        default = entry.default if entry.default_factory is MISSING else entry.default_factory()
        if value == default or entry.name in {*positional, *WITHOUT_RESULT}:
            continue
        several = value if isinstance(value, tuple) else () if value is True else (value,)
        values = tuple(map(str, several))
        given.append(("--" + entry.name.replace("_", "-"), values))
    return Command((name, *(str(getattr(options, field)) for field in positional)), tuple(given))


BLUE, ORANGE, INK, GREY, PALE = "#0b5394", "#c4610a", "#1c1c1c", "#6f6f6f", "#d9d9d9"
PANEL = 3.55  # width of a figure [in]; 340 pixels, less than a phone has
LONGEST_LABEL = 24  # characters beside an axis
HALF = 20  # characters of a legend's entry that has another one beside it
LEGEND_LINE = 0.17  # height [in]
POINTS = 72.0  # an inch


def legend_below(figure: Any) -> None:
    """A legend below the axes, for which the figure grows; short entries stand two beside each other."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    columns = 2 if max(map(len, labels)) <= HALF else 1
    figure.set_figheight(figure.get_figheight() + LEGEND_LINE * -(-len(labels) // columns))
    figure.legend(handles, labels, loc="outside lower left", frameon=False, fontsize=8.0, ncols=columns)


@contextmanager
def panel(height: float, polar: bool = False) -> Iterator[tuple[Any, Any]]:
    """A figure [in] with one pair of axes that needs no display; draw it, and turn it into SVG."""
    import matplotlib
    from matplotlib.figure import Figure

    settings: Any = {
        "font.family": "sans-serif", "font.size": 8.5, "axes.titlesize": 9.0, "axes.labelsize": 8.5,
        "xtick.labelsize": 8.0, "ytick.labelsize": 8.0, "axes.spines.top": False, "axes.spines.right": False,
        "axes.edgecolor": GREY, "axes.linewidth": 0.7, "axes.titlelocation": "left",
        "hatch.linewidth": 0.6, "svg.fonttype": "none",
    }  # fmt: skip
    with matplotlib.rc_context(settings):
        figure = Figure(figsize=(PANEL, height), layout="constrained")
        yield figure, figure.add_subplot(projection="polar" if polar else None)


def to_svg(figure: Any, text: str) -> str:
    """The figure as an element of HTML, with words for those who cannot see it.

    Names are taken out but for those that are referred to, which are made from `text`, so that many figures
    stand in one page.
    """
    import matplotlib

    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": text}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    drawn = buffer.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r'(<g) id="[^"]*"', r"\1", drawn)
    drawn = re.sub(r"<!--.*?-->", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r"\n\s*", "\n", re.sub(r"(\d\.\d\d)\d+", r"\1", drawn))  # a hundredth of a point will do
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawn)
    width, height = (float(side) for side in box.groups()) if box else (PANEL * POINTS, PANEL * POINTS)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{html.escape(text)}">'
    )
    return re.sub(r"<svg[^>]*>", lambda _: head, drawn, count=1).strip()


def beside_axis(label: str) -> str:
    """A label cut in its middle where it is too long to stand beside an axis."""
    if len(label) <= LONGEST_LABEL:
        return label
    half = (LONGEST_LABEL - 3) // 2
    return f"{label[:half]}...{label[-half:]}"


def breaking(label: str) -> Any:
    """A label as HTML that may break after a hyphen, plus, slash or underscore, and in no word or unit."""
    from markupsafe import Markup, escape

    label = re.sub(r"\[.*?\]| %", lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), label)
    return Markup("<wbr>").join(escape(part) for part in re.findall(r"[^-+/_.:]*[-+/_.:]|[^-+/_.:]+", label))


def unbroken(command: str) -> Any:
    """A command as HTML whose lines do not break within an option or another short word."""
    from markupsafe import Markup, escape

    parts = (Markup("<span>{}</span>").format(part) if len(part) <= LONGEST_LABEL else escape(part)
             for part in command.split(" "))  # fmt: skip
    return Markup(" ").join(parts)


Row = Mapping[str, Any]


def short_labels(names: Iterable[str]) -> dict[str, str]:
    """Policy -> label: of a file its folder and stem, where that tells it apart; any other name as it is."""
    short = {}
    for name in names:
        path = PurePath(name)
        in_folder = "/".join([*path.parts[-2:-1], path.stem])
        short[name] = in_folder if path.suffix == ".safetensors" else name
    taken = list(short.values())
    return {name: label if taken.count(label) == 1 else name for name, label in short.items()}


def scenario_words(scenario: Scenario) -> str:
    """A scenario in words: its first push, how many there are, and on which walk."""
    kind, walk, count = (KINDS[name](scenario) for name in ("disturbance", "command", "count"))
    words = f"{'' if walk == 'turning' else 'walking '}{walk}"
    if not scenario.forces:
        return f"no push, {words}"
    push = scenario.forces[0]
    if push.law is not None:
        return f"{kind}, {words}"
    return (
        f"{push.body}, {push.impulse_magnitude:.0f} N s {direction_words(*push.force[:2])} within "
        f"{push.duration:.2f} s, {count}, {words}"
    )


def outcome_words(row: Row) -> str:
    """The end of an episode in words, and the first limit that a fall met.

    Its time counts from the first push, if one has begun and the row says when.
    """
    if row["recovered"]:
        return "recovers"
    if row["survived"]:
        return "stays up, does not settle"
    first = row.get("first_limit")
    why = reason_words(row["failure_reason"]) + (f", first limit met: {limit_words(first)}" if first else "")
    start = row.get("measures", {}).get("first_push")
    when = "into the walk" if start is None else "after the first push"
    return f"falls {row['end_time'] - (start or 0.0):.1f} s {when} ({why})"


PAGE, INDEX = "report.html", "index.html"
TEMPLATES = Path(__file__).parent / "templates"


def require_report() -> None:
    """Raise MissingExtraError where jinja2 is not installed."""
    if find_spec("jinja2") is None:
        raise MissingExtraError("jinja2", "report")


def write_page(
    directory: Path, template: str, content: Mapping[str, Any], command: Command | None = None
) -> Path:
    """Write a page from a template, which escapes every text but the SVG of figures; returns its path.

    It is report.html, or what `Command.page` says of a `command`. Where the directory has other pages,
    index.html names all of them.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    require_report()
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    env = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    env.filters["figure"] = Markup  # of to_svg, which escapes its text
    env.filters["breaking"] = breaking
    env.filters["unbroken"] = unbroken
    path = directory / (PAGE if command is None else command.page(directory))
    asked = {} if command is None else {"command": command.text}
    write_text(path, env.get_template(template).render(content, **asked))
    pages = sorted(one.name for one in directory.glob("*.html") if one.name != INDEX)
    if len(pages) > 1:
        titled = {"title": "Pages of these results", "pages": pages}
        write_text(directory / INDEX, env.get_template("index.html").render(titled))
    return path


def rows_hash(directory: Path) -> tuple[str, str]:
    """Hash of the rows in a directory of results, as a line of the manifest."""
    rows = (directory / "outcomes.jsonl").read_bytes()
    return "outcomes.jsonl", f"sha256 {hashlib.sha256(rows).hexdigest()}"


def manifest(command: Command, hashes: Sequence[tuple[str, str]], seeds: str) -> list[tuple[str, str]]:
    """Names and values of all that a page is made from; `seeds` tells what is random."""
    return [
        ("command", command.text),
        *hashes,
        ("code of controllers and envs", f"sha256 {code_digest()}"),
        ("seeds", seeds),
        ("versions", ", ".join(f"{name} {number}" for name, number in versions().items())),
        ("git commit", source_commit() or "none: installed from a package"),
        ("machine", machine_kind()),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
    ]
