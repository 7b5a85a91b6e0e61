"""A recorded episode as a file: NumPy's npz, or text with a column for each quantity."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np

from ...controllers.files import write_atomically
from .record import EpisodeRecord

LOG_FORMATS = (".npz", ".csv")


def log_bytes(record: EpisodeRecord, suffix: str) -> bytes:
    """An episode in one of LOG_FORMATS; the same episode gives the same bytes.

    npz: an array for each column, `columns` and `units` with their names in order, and `scenario` and
    `outcome` as JSON. csv: a head of `name [unit]`, and a line for each sample with digits enough to read the
    same numbers back.
    """
    return _npz(record) if suffix == ".npz" else _csv(record)


def write_log(record: EpisodeRecord, path: Path) -> None:
    """Write an episode whole or not at all, in the format of the suffix."""
    write_atomically(path, log_bytes(record, path.suffix.lower()))


def _npz(record: EpisodeRecord) -> bytes:
    buffer = io.BytesIO()
    about = {
        "columns": np.array(list(record.columns)),
        "units": np.array([record.units[name] for name in record.columns]),
        "scenario": np.array(record.scenario.to_json()),
        "outcome": np.array(json.dumps(record.outcome.to_dict(), sort_keys=True)),
    }
    np.savez_compressed(buffer, allow_pickle=False, **about, **record.columns)
    return buffer.getvalue()


def _csv(record: EpisodeRecord) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{name} [{record.units[name]}]" for name in record.columns])
    for row in zip(*(column.tolist() for column in record.columns.values()), strict=True):
        writer.writerow([repr(value) for value in row])
    return text.getvalue().encode()
