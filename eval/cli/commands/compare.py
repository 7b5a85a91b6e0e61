"""`push-recovery compare`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from ..options import RobotOptions
from ..page import print_page, write_or_say
from .evaluate import SuiteOptions

if TYPE_CHECKING:
    from ...score.compare import Comparison


@dataclass(frozen=True, kw_only=True)
class Compare(SuiteOptions, RobotOptions):
    """Compare two policies on the same pushes."""

    a: Annotated[Positional[str], arg(metavar="A")]
    """First policy: name (see list), file, or MODULE:ATTRIBUTE."""
    b: Annotated[Positional[str], arg(metavar="B")]
    """Second policy, in the same form."""

    def run(self) -> None:
        """Compare two policies, print the table or the object."""
        from ...output.tables import print_table
        from ...score.compare import compare
        from ..archives import trusted

        self.check_film()
        env_id = self.env_id
        a, b = trusted((self.a, self.b), self.trust)
        comparison = compare(
            a,
            b,
            self.pushes_under(self.profile),
            env_id,
            self.processes,
            self.directory,
            self.overwrite,
        )
        content = comparison.to_dict()
        page = self._page(comparison)
        if self.json:
            self.write_films(comparison.evaluation)
            self.print_json(content)
            return
        low, high = content["ci95"]
        cells = [
            ("both recovered", str(content["both"])),
            (f"only {self.a}", str(content["only_a"])),
            (f"only {self.b}", str(content["only_b"])),
            ("neither", str(content["neither"])),
            (
                f"rate of {self.a} minus rate of {self.b}",
                f"{content['rate_difference']:+.3f} ({low:+.3f} to {high:+.3f})",
            ),
            (f"survived {self.a}, {self.b}", f"{content['survived_a']}, {content['survived_b']}"),
            ("exact McNemar p", f"{content['mcnemar_p']:.3g}"),
        ]
        print_table(f"{env_id}: {content['pairs']} pairs of suite {content['suite']}", ("", "value"), cells)
        print(f"outcomes: {comparison.directory / 'outcomes.jsonl'}")
        self.write_films(comparison.evaluation)
        print_page(page)

    def _page(self, comparison: Comparison) -> Path | None:
        """The page of both policies, beside their rows."""
        from ...report.pages.evaluation import with_pictures
        from ...report.replay import command_of

        found = {self.profile: comparison.evaluation}
        command = command_of("compare", self, ("a", "b"))
        return write_or_say(lambda: with_pictures(found, command, comparison.directory))
