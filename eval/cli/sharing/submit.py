"""`push-recovery submit`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from ..options import Count, WorkerOptions, within


@dataclass(frozen=True, kw_only=True)
class Submit(WorkerOptions):
    """Check results by running a random sample of their rows again, and put them on a leaderboard."""

    directory: Annotated[Positional[str], arg(metavar="DIR")]
    """Directory that evaluate has written, with all rows of its suite."""
    suite: Annotated[str | None, arg(metavar="NAME|FILE", help_behavior_hint="")] = None
    """Suite of the results, if it is a file of your own; its hash has to be that of the results."""
    board: Annotated[str, arg(metavar="DIR")] = "leaderboard"
    """Folder of the leaderboard. It gets a file for each policy on each suite, and a page made of them."""
    sample: Count = field(default=32, metadata=within(1))
    """Number of rows of each policy that are run again."""
    seed: Annotated[
        int | None, arg(metavar="N", help_behavior_hint="(default: another sample every time)")
    ] = field(default=None, metadata=within(0))
    """Seed of the sample."""

    def run(self) -> None:
        """Check, add the entries, write the page; one writer a board, whose page is made of all entries."""
        from ...leaderboard.again import run_again, sample_of
        from ...leaderboard.board import PAGE, add_entry, entry_of
        from ...leaderboard.submission import read_submission
        from ...output.place import require_place
        from ...processes.writer import Writer

        board = Path(self.board)
        submission = read_submission(Path(self.directory), self.suite)
        require_place(board / PAGE)
        with Writer(board):
            samples = sample_of(submission, self.sample, self.seed)
            run_again(submission, samples, self.processes)
            entries = {name: entry_of(submission, name, len(samples[name])) for name in submission.rows}
            files = {name: str(add_entry(board, entry)) for name, entry in entries.items()}
        if self.json:
            self.print_json({"entries": entries, "files": files, "page": str(board / PAGE)})
            return
        for name, entry in entries.items():
            score = entry["score"]
            print(
                f"{name}: {score['recovered']} of {score['episodes']} recovered, {entry['checked']} rows run "
                f"again: {files[name]}"
            )
        print(f"page: {board / PAGE}")
