"""Results on disk: rows of JSON that survive a kill, one writer a directory, versions of what wrote them."""

import contextlib
import errno
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any, Self

from ...controllers.errors import InvalidValueError, PushRecoveryError
from ...controllers.files import read_file, sync_names, write_text
from ...controllers.validation import parse_json


def require_place(path: Path) -> None:
    """Make the folder of a file to come, and try to write there.

    Raises:
        InvalidValueError: nothing can be written there, or the name is that of a folder.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        reason = "its folder is a file" if isinstance(error, FileExistsError) else error.strerror
        raise InvalidValueError(f"can't write to {str(path)!r}: {reason}") from error


PACKAGES = ("mujoco", "numpy", "numba", "scipy", "gymnasium", "osqp", "daqp")  # that outcomes may hang on


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Versions of this package, of Python and of others, as far as they are installed."""
    found = {
        "push-recovery": sys.modules[__name__.partition(".")[0]].__version__,
        "python": platform.python_version(),
    }
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine_kind() -> str:
    """Operating system, processor family and number of cores; no name of the machine."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def source_commit(file: Path = Path(__file__)) -> str | None:
    """Commit of the repository that tracks a file, "-dirty" where files differ from it; None without one."""
    if _git(file.parent, "ls-files", "--error-unmatch", file.name) is None:
        return None  # in no repository, or in one that is not ours
    return _git(file.parent, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def _git(folder: Path, *words: str) -> str | None:
    """Output of git in a folder; None where it fails or is not installed."""
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=True)  # noqa: S603, S607
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


LOCK = ".lock"
# Names of what tells of rows
OF_ROWS = re.compile(r"(report.*|compare-.*|index|profiles.*|frontier.*|basin.*)\.(html|json|md|png|svg)")
PATIENCE = 0.1  # with a lock that is being released [s]


class Writer:
    """The right to write to a directory, for one holder at a time until it is released; a context manager.

    The system's lock on the file LOCK says so: it ends with the process that holds it, however that ends, and
    a file that a killed process has left behind means nothing. On release the file goes, and with it the
    folders that were made for it and are empty.

    Args:
        directory: made if absent.

    Raises:
        InvalidValueError: another process, or another run in this one, writes there; or nobody can.
    """

    def __init__(self, directory: Path):
        from filelock import FileLock, Timeout

        self._path = directory / LOCK
        self._lock = FileLock(
            self._path, timeout=PATIENCE, thread_local=False, poll_interval=0.02, fallback_to_soft=False
        )
        try:
            self._made = [folder for folder in (directory, *directory.parents) if not folder.exists()]
            directory.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
        except Timeout:
            raise InvalidValueError(
                f"another run{_holder(self._path)} is writing to {str(directory)!r}: wait for its end, or "
                "choose another directory"
            ) from None
        except OSError as error:
            raise InvalidValueError(f"can't write to the directory {str(directory)!r}: {error}") from error
        with contextlib.suppress(OSError):  # only for the message of others: no space is no reason
            self._path.write_text(str(os.getpid()))

    def release(self) -> None:
        """Let others write; may be called twice."""
        if not self._lock.is_locked:
            return
        with contextlib.suppress(OSError):
            self._path.unlink()  # before the lock goes: what is locked next is a new file
        self._lock.release()
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def _holder(path: Path) -> str:
    """The process that holds the lock, where it says so."""
    try:
        number = path.read_bytes()
    except OSError:
        return ""
    return f" (process {int(number)})" if number.isdigit() else ""


LONGEST_LABEL = 150  # of a directory's name; file systems take 255 bytes


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Names of the entries in which two records differ, sorted."""
    return [name for name in sorted({*one, *other}) if one.get(name) != other.get(name)]


def read_content(path: Path, what: str = "") -> bytes:
    """The content of a file of a kind; raises InvalidValueError where it can't be read."""
    try:
        return read_file(path)
    except (OSError, ValueError) as error:  # which a name with a null is
        name, reason = f"{what} {str(path)!r}".lstrip(), getattr(error, "strerror", None) or error
        raise InvalidValueError(f"cannot read {name}: {reason}") from error


def read_json(path: Path, what: str = "") -> Any:
    """The content of a JSON file of a kind; raises InvalidValueError where it can't be read or is none."""
    return parse_json(f"{what} {str(path)!r}".lstrip(), read_content(path, what))


class UnwrittenRowError(PushRecoveryError):
    """A row could not be written; those before it are kept."""


def default_directory(label: str, config: Mapping[str, Any]) -> Path:
    """runs/LABEL-HASH: the same configuration resumes, another one starts afresh."""
    digest = hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:8]
    return Path("runs") / f"{label[:LONGEST_LABEL]}-{digest}"


class RowFile:
    """Rows of JSON, one a line, appended as they finish; a second run goes on where the first stopped.

    `config.json` beside the rows says what they belong to; a directory of another configuration is refused,
    and so is one to which another run is writing. A last line torn by a kill is dropped. A context manager,
    which leaves nothing of a run that began here and failed before its first row.

    Args:
        directory: where the two files lie; made if absent.
        config: JSON object that must equal that of the directory.
        key: fields that identify a row.
        overwrite: start over where the directory already holds rows; what tells of them goes, too.
        fields: that each row must have besides those of the key.

    Raises:
        InvalidValueError: the directory belongs to something else or to another run, or can't be used.
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
        self._lines: dict[tuple[Any, ...], int] = {}  # of the rows that were read, counted from 1
        self._begun: tuple[Path, ...] = ()  # files of a run that begins here
        self._file: IO[bytes] | None = None
        self._writer = Writer(directory)
        try:
            self._open(directory / "config.json", config, overwrite)
        except OSError as error:
            self.close()
            raise InvalidValueError(f"cannot use output directory {str(directory)!r}: {error}") from error
        except BaseException:
            self.close()
            raise

    def _open(self, path: Path, config: dict[str, Any], overwrite: bool) -> None:
        """Read what is there; the configuration is written last, so that a refusal leaves none behind."""
        if overwrite:
            told = (one for one in path.parent.iterdir() if OF_ROWS.fullmatch(one.name) and one.is_file())
            for one in (self.path, path, *told):
                one.unlink(missing_ok=True)
        known = path.exists()
        if known:
            _check_config(path, config)
        elif self.path.exists() and self.path.stat().st_size:
            raise InvalidValueError(f"{str(self.path)!r} has no config.json beside it; choose another --out")
        self.rows = self._read()
        if not known:
            write_text(path, json.dumps(config, indent=1, sort_keys=True) + "\n")
            self._begun = path, self.path

    def _read(self) -> dict[tuple[Any, ...], dict[str, Any]]:
        """Rows by key; cuts off a torn last line."""
        rows: dict[tuple[Any, ...], dict[str, Any]] = {}
        if not self.path.exists():
            return rows
        content = read_file(self.path)
        whole = content[: content.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                row = parse_json("it", line)
                if lacks := [name for name in (*self.key, *self._fields) if name not in row]:
                    raise ValueError(f"it lacks {', '.join(lacks)}")
                key = tuple(row[name] for name in self.key)
                rows.setdefault(key, row)
                self._lines.setdefault(key, number)
            except (ValueError, KeyError, TypeError) as error:
                raise InvalidValueError(f"{str(self.path)!r} line {number} is no outcome: {error}") from error
        if len(whole) < len(content):
            os.truncate(self.path, len(whole))
        return rows

    def check_rows(self, check: Callable[[dict[str, Any]], object]) -> None:
        """Refuse rows that were read and that a check refuses; the error names the line."""
        for key, number in self._lines.items():
            try:
                check(self.rows[key])
            except InvalidValueError as error:
                raise InvalidValueError(f"{str(self.path)!r} line {number} is no outcome: {error}") from error

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
        """Add one row unless its key is present already; on disk when this returns.

        Raises:
            UnwrittenRowError: it can't be written, as on a full disk; the file ends with the row before.
        """
        key = tuple(row[name] for name in self.key)
        if key in self.rows:
            return
        line = json.dumps(row, allow_nan=False).encode() + b"\n"
        try:
            self._write(line)
        except OSError as error:
            raise UnwrittenRowError(
                f"can't write to {str(self.path)!r}: {error.strerror}; what was done is kept, and the same "
                "command goes on from there"
            ) from error
        self.rows[key] = row

    def _write(self, line: bytes) -> None:
        """Write a line whole or not at all, as far as this process lives."""
        if self._file is None:
            self._file = self.path.open("ab", buffering=0)
            sync_names(self.directory)
        end = os.fstat(self._file.fileno()).st_size
        try:
            rest = memoryview(line)
            while rest:
                rest = rest[self._file.write(rest) :]
        except BaseException:
            self._file.truncate(end)
            raise
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file and let others write; the rows stay readable."""
        if self._file is not None:
            self._file.close()
            self._file = None
        self._writer.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and not self.rows:
            with contextlib.suppress(OSError):
                for one in self._begun:
                    one.unlink(missing_ok=True)
        self.close()


def _check_config(path: Path, config: dict[str, Any]) -> None:
    """Raise InvalidValueError where the configuration of a directory is another one."""
    present = parse_json(repr(str(path)), read_file(path))
    if present != json.loads(json.dumps(config)):
        known = present if isinstance(present, dict) else {}
        raise InvalidValueError(
            f"{str(path.parent)!r} holds results of another configuration (differs in: "
            f"{', '.join(differing(known, config))}); choose another --out, or --overwrite to start over"
        )
