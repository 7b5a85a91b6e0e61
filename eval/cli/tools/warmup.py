"""`push-recovery warmup`."""

from __future__ import annotations

from dataclasses import dataclass

from ..options import JsonOption


@dataclass(frozen=True, kw_only=True)
class WarmUp(JsonOption):
    """Compile all kernels ahead of their first use."""

    def run(self) -> None:
        """Compile, with a bar over the environments that are run for it."""
        from ....controllers.compiled.cache_place import cache_root
        from ...bench.warmup import names, warm_up
        from ...output.progress import progress_bars
        from ...output.work import Work

        work = Work(
            "all kernels", "about 2 minutes where they are to be compiled, else seconds", cache_root()
        )
        with progress_bars(("kernels",), len(names()), work) as bars:
            for done, name in enumerate(warm_up()):
                bars.set("kernels", done, name)
            bars.set("kernels", len(names()))
        if self.json:
            self.print_json({"cache": str(cache_root())})
        else:
            print(f"kernels: {cache_root()}")
