"""Files that are whole or absent, and row files that survive a kill."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import write_atomically
from ...controllers.json_text import parse_json


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_atomically(path, text.encode())


LONGEST_LABEL = 150  # of a directory's name; file systems take 255 bytes


def default_directory(label: str, config: Mapping[str, Any]) -> Path:
    """runs/LABEL-HASH: the same configuration resumes, another one starts afresh."""
    digest = hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:8]
    return Path("runs") / f"{label[:LONGEST_LABEL]}-{digest}"


class RowFile:
    """Rows of JSON, one a line, appended as they finish; a second run goes on where the first stopped.

    `config.json` beside the rows says what they belong to; a directory of another configuration is refused.
    A last line torn by a kill is dropped.

    Args:
        directory: where the two files lie; made if absent.
        config: JSON object that must equal that of the directory.
        key: fields that identify a row.
        overwrite: start over where the directory already holds rows.
        fields: that each row must have besides those of the key.
    """

    def __init__(
        self,
        directory: Path,
        config: dict[str, Any],
        key: tuple[str, ...],
        overwrite: bool = False,
        fields: tuple[str, ...] = (),
    ):
        self.directory = directory
        self.path = directory / "outcomes.jsonl"
        self.key, self._fields = key, fields
        config_path = directory / "config.json"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            if overwrite:
                self.path.unlink(missing_ok=True)
                config_path.unlink(missing_ok=True)
            self._check_config(config_path, config)
            self.rows = self._read()
        except OSError as error:
            raise InvalidValueError(f"cannot use output directory {str(directory)!r}: {error}") from error
        self._file: IO[str] | None = None

    def _check_config(self, path: Path, config: dict[str, Any]) -> None:
        if not path.exists():
            if self.path.exists() and self.path.stat().st_size:
                raise InvalidValueError(
                    f"{str(self.path)!r} has no config.json beside it; choose another --out"
                )
            write_text(path, json.dumps(config, indent=1, sort_keys=True) + "\n")
            return
        present = parse_json(repr(str(path)), path.read_bytes())
        if present != json.loads(json.dumps(config)):
            known = present if isinstance(present, dict) else {}
            differs = [k for k in sorted({*known, *config}) if known.get(k) != config.get(k)]
            raise InvalidValueError(
                f"{str(path.parent)!r} holds results of another configuration (differs in: "
                f"{', '.join(differs)}); choose another --out, or --overwrite to start over"
            )

    def _read(self) -> dict[tuple[Any, ...], dict[str, Any]]:
        """Rows by key; cuts off a torn last line."""
        rows: dict[tuple[Any, ...], dict[str, Any]] = {}
        if not self.path.exists():
            return rows
        content = self.path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                row = parse_json("it", line)
                if lacks := [name for name in (*self.key, *self._fields) if name not in row]:
                    raise ValueError(f"it lacks {', '.join(lacks)}")
                rows.setdefault(tuple(row[name] for name in self.key), row)
            except (ValueError, KeyError, TypeError) as error:
                raise InvalidValueError(f"{str(self.path)!r} line {number} is no outcome: {error}") from error
        if len(whole) < len(content):
            os.truncate(self.path, len(whole))
        return rows

    def check_policies(self, digests: Mapping[str, str | None]) -> None:
        """Refuse rows of a policy file whose content has changed since; `digests` by policy."""
        for row in self.rows.values():
            name = row["policy"]
            if name in digests and row.get("policy_sha256") != digests[name]:
                raise InvalidValueError(
                    f"{str(self.path)!r} holds rows of another content of policy {name!r}; choose another "
                    "--out, or --overwrite to start over"
                )

    def append(self, row: dict[str, Any]) -> None:
        """Add one row unless its key is present already; on disk when this returns."""
        key = tuple(row[name] for name in self.key)
        if key in self.rows:
            return
        if self._file is None:
            self._file = self.path.open("a", encoding="utf-8")
        self._file.write(json.dumps(row, allow_nan=False) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.rows[key] = row

    def close(self) -> None:
        """Close the file; the rows stay readable."""
        if self._file is not None:
            self._file.close()
            self._file = None
