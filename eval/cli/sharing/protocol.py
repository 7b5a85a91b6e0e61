"""`push-recovery protocol kick|tour`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from ....controllers.errors import InvalidValueError
from ..options import EnvOptions, RunningOptions, within

if TYPE_CHECKING:
    from ...protocols.run import Protocol

FORM_TEXT = (
    "Form of kick: stated, as the paper says (8 directions, horizontal); coded, as its program does; or "
    "force, the same impulse as a force of 0.1 s on the pelvis."
)
EPISODES_TEXT = (
    "Number of episodes of each level of kick (200 at most), or of run ids of tour, counted from 0."
)
MOST = {"kick": 200, "tour": 5120}


@dataclass(frozen=True, kw_only=True)
class ProtocolCommand(EnvOptions, RunningOptions):
    """Run policies under the push protocol of another group; its published rows stand beside them."""

    protocol: Positional[Literal["kick", "tour"]]
    """kick: RecoverFormer's jumps of the base's velocity; tour: the teleop-walking-benchmark's punches on a
    tour of 90 s."""
    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE")] = ("two-stage",)
    """Policies to run: names (see list), policy files, or MODULE:ATTRIBUTE."""
    form: Annotated[
        Literal["stated", "coded", "force"] | None,
        arg(metavar="NAME", help=FORM_TEXT, help_behavior_hint="(default: stated)"),
    ] = None
    episodes: Annotated[
        int | None, arg(metavar="N", help=EPISODES_TEXT, help_behavior_hint="(default: 200, of tour 64)")
    ] = field(default=None, metadata=within(1))
    collisions: bool = False
    """Let all legs, arms and the trunk collide with each other and with the floor (otherwise: feet and
    shanks alone)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.form is not None and self.protocol != "kick":
            raise InvalidValueError(f"--form is for kick, not {self.protocol}")
        if self.episodes is not None and self.episodes > MOST[self.protocol]:
            raise InvalidValueError(
                f"--episodes must be at most {MOST[self.protocol]} of {self.protocol}, got {self.episodes}"
            )

    @property
    def asked(self) -> Protocol:
        """The protocol with its scenarios."""
        return self._plain.with_collisions() if self.collisions else self._plain

    @property
    def _plain(self) -> Protocol:
        from ...protocols.kick import kick_scenarios
        from ...protocols.run import Protocol
        from ...protocols.tour import tour_scenario
        from ...protocols.watched import biped_of

        robot = biped_of(self.env_id)
        if self.protocol == "tour":
            ids = range(self.episodes or 64)
            return Protocol("tour", "stated", robot.robot, tuple(tour_scenario(one, robot) for one in ids))
        form = self.form or "stated"
        levels = kick_scenarios(form, self.episodes or MOST["kick"], robot.robot.mass).values()
        scenarios = tuple(scenario for level in levels for scenario in level)
        return Protocol("kick", form, robot.robot, scenarios)

    def run(self) -> None:
        """Run it, print one table or object, write the reports."""
        from ...output.tables import print_table
        from ...protocols import report
        from ...protocols.run import run_protocol

        found = run_protocol(
            self.asked, self.env_id, self.policies, self.processes, self.directory, self.overwrite
        )
        path = report.write_reports(found)
        if self.json:
            self.print_json(report.to_dict(found))
        elif self.protocol == "kick":
            title = f"{report.kick_title(found)}. {report.STOOD}"
            print_table(title, report.kick_columns(found, "stood"), report.kick_cells(found, "stood"))
        else:
            print_table(report.tour_title(found), report.TOUR_COLUMNS, report.tour_cells(found))
        if not self.json:
            print(f"report: {path}")
