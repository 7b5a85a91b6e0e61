"""Episodes of policies in environments; here the names that the command line offers, quick to load."""

import os

from ...controllers.settings import ON_REQUEST, VARIANTS

NAMESPACE = "PushRecovery/"
DEFAULT_ENV = "PushRecovery/Biped-v0"
TABLE_VARIANTS = tuple(name for name in VARIANTS if name not in ON_REQUEST)
SUITE_NAMES = (  # of `score.suites.SUITES`
    "quick", "standard", "hard", "varied", "hardware", "standing", "disturbances", "terrain", "terrain-blind",
    "quick-sealed", "varied-sealed", "hardware-sealed", "hard-sealed", "standing-sealed",
    "disturbances-sealed", "terrain-sealed", "terrain-blind-sealed", "quick-1", "shift-duration",
    "shift-body", "shift-model", "shift-magnitude", "shift-floor", "shift-repeated", "kick", "kick-coded",
)  # fmt: skip
REPLICAS = 32  # of a push of `frontier`, by default


def default_workers() -> int:
    """Processes that this machine has cores for."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
