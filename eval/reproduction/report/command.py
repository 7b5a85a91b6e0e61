"""What `push-recovery reproduce` does with its parsed options."""

from __future__ import annotations

import argparse
import json

from ...output.tables import print_table
from .run import RESULT, TABLES, reproduce


def run(args: argparse.Namespace) -> int:
    """Reproduce, write everything into the directory, print the tables or the object."""
    found = reproduce(args.section, args.directions, args.workers, args.out, args.overwrite, args.page)
    if args.json:
        print(json.dumps(found.content, allow_nan=False))
        return 0
    for table in found.tables:
        print_table(*table)
    for path in (found.directory / RESULT, found.directory / TABLES, *found.pictures):
        print(path)
    return 0
