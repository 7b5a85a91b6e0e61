"""`push-recovery bench`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from ...bench.keys import EPILOG
from ..options import EnvOptions, JsonOption, Real, within


@dataclass(frozen=True, kw_only=True)
class Bench(EnvOptions, JsonOption):
    """Time the parts on this machine."""

    EPILOG: ClassVar[str] = EPILOG  # below the help

    seconds: Real = field(default=20.0, metadata=within(0.1, 600))
    """Simulated time of one robot's closed loop [s]. With less than 5 only what is quick is measured: without
    Humanoid-v5, other solvers, more than 64 robots, and the start of a process."""

    def run(self) -> None:
        """Measure and print."""
        from ...bench.run import bench
        from ...bench.tables import print_tables

        content = bench(self.env_id, self.seconds)
        if self.json:
            self.print_json(content)
        else:
            print_tables(content)
