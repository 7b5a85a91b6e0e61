"""Compiled kernels: the project's own `njit`, where its code is kept, when it is stale, and its threads.

Numba keeps compiled functions beside their module and compares that one file: it does not notice a changed
callee, or a changed constant, in another. Here they lie in a directory of the user's, one for each version of
each module, under a digest of all that the module's kernels depend on (`source_digest`). So an edit of a
callee compiles its callers anew, an installation that cannot be written works, and installations of equal
sources share what was compiled. A process waits for another that compiles what it needs. The first
compilation, which takes long, is announced on standard error, once for a command and its worker processes.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any
from zlib import crc32

import llvmlite
import numba
import numpy as np
from numba.core import event as events
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from platformdirs import user_cache_path

from .errors import InvalidValueError, is_integer, shown

# Statements at the top level only: what a function imports when it runs is no global of a kernel.
IMPORT = re.compile(rb"\n(?:from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)|(?:import|from) (\w+))")
NAME = re.compile(r"[A-Za-z_]\w*")
LENGTH = 16  # hexadecimal digits: two versions of one module do not meet


@cache
def source_digest(module: str) -> str:
    """Digest of a module's source and of everything that it is made of.

    That is its own text, the digests of the modules of this project that it imports at its top level, the
    package's data files where it names any, and the versions of the outside packages that it imports. Modules
    import in no circle, so neither has this recursion.

    The module, by its full name, is imported, or far enough to define a kernel. A source that cannot be read
    raises OSError.
    """
    text = source_of(module)
    digest, inside, outside = hashlib.sha256(text), set(), set()
    for dots, base, names, other in IMPORT.findall(b"\n" + text):
        if other:
            outside.add(other.decode())
        else:
            inside |= imported_modules(module, len(dots), base.decode(), names.decode())
    for name in sorted(inside - {module}):
        digest.update(source_digest(name).encode())
    for name in sorted(outside):
        digest.update(f"{name} {getattr(sys.modules.get(name), '__version__', '')}".encode())
    if b".json" in text or b".xml" in text:
        digest.update(data_digest(".".join(module.split(".")[:2])).encode())
    return digest.hexdigest()[:LENGTH]


def source_of(module: str) -> bytes:
    """Text of an imported module; one without a file raises FileNotFoundError."""
    path = getattr(sys.modules[module], "__file__", None)
    if path is None:
        raise FileNotFoundError(f"module {module} has no source file")
    return Path(path).read_bytes()


def imported_modules(module: str, dots: int, base: str, names: str) -> set[str]:
    """Modules that `from <dots><base> import <names>` means in a module; a name may be a module or not."""
    parts = module.split(".")
    above = ".".join([*parts[: len(parts) - dots], *([base] if base else [])])
    return {
        name for name in (above, *(f"{above}.{name}" for name in NAME.findall(names))) if name in sys.modules
    }


@cache
def data_digest(package: str) -> str:
    """Digest of all data files of an imported package."""
    digest = hashlib.sha256()
    for path in sorted(Path(sys.modules[package].__path__[0]).rglob("*")):
        if path.suffix in (".json", ".xml"):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


KEPT = 8  # versions of a module; the least lately used are deleted when another is compiled
FALLBACK = (
    "push-recovery: compiled kernels cannot be kept in {path} ({why}); they go to {other}. "
    "NUMBA_CACHE_DIR names another directory."
)


@cache
def cache_root() -> Path:
    """The directory of all kernels, made if need be.

    It is `push-recovery` in NUMBA_CACHE_DIR, or in the user's cache directory. Where that cannot be written,
    a directory for temporary files takes its place, with a warning.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    path = Path(given) / "push-recovery" if given else user_cache_path("push-recovery", appauthor=False)
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        other = own_temporary_directory()
        why = error.strerror or type(error).__name__
        warnings.warn(FALLBACK.format(path=path, why=why, other=other), RuntimeWarning, stacklevel=2)
        return other
    return path


def own_temporary_directory() -> Path:
    """A directory for temporary files that no other user can write to.

    Numba's files are pickles: whoever writes one has the reader run code. A name that others could have taken
    first is used only where it is a directory, belongs to this user, and is closed to all others.
    """
    if hasattr(os, "getuid"):
        path = Path(tempfile.gettempdir()) / f"push-recovery-kernels-{os.getuid()}"
        with suppress(OSError):
            path.mkdir(mode=0o700, exist_ok=True)
            found = path.lstat()
            closed = not stat.S_IMODE(found.st_mode) & 0o077
            if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and closed:
                return path
    return Path(tempfile.mkdtemp(prefix="push-recovery-kernels-"))


def module_directory(module: str, digest: str) -> Path:
    """Directory of one version of a module's kernels by its digest, not made yet; it counts as used now."""
    path = cache_root() / f"{module.removeprefix('push_recovery.')}-{digest}"
    with suppress(OSError):  # not there yet, or another's
        os.utime(path)
    return path


def make_room(path: Path) -> None:
    """Delete the least lately used versions of a new directory's module, all but `KEPT` with the new one."""
    of_module = re.compile(re.escape(path.name.rpartition("-")[0]) + "-[0-9a-f]+")
    others = []
    for other in path.parent.iterdir():
        if other != path and of_module.fullmatch(other.name):
            try:
                others.append((other.stat().st_mtime, other))
            except FileNotFoundError:
                continue  # another process deletes, too
    for _, old in sorted(others, reverse=True)[KEPT - 1 :]:
        shutil.rmtree(old, ignore_errors=True)


try:
    import fcntl
except ImportError:  # not on Windows: there processes may compile the same kernel twice
    fcntl = None


def njit(*, cache: bool, **options: Any) -> Callable[[Callable], Any]:
    """`numba.njit` with its options; where `cache` says so, this module keeps the compiled code on disk."""

    def compiled(function: Callable) -> Any:
        kernel = numba.njit(**options)(function)
        if cache and isinstance(kernel, Dispatcher):  # NUMBA_DISABLE_JIT leaves the function as it is
            _keep(kernel, function)
        return kernel

    return compiled


def _keep(kernel: Any, function: Callable) -> None:
    """Have a kernel's compiled code kept, and compiled by one process at a time."""
    try:
        kernel._cache = _KernelCache(function)
    except OSError:  # its source is no file, as in an archive
        return
    compile_alone, name = kernel.compile, f"{function.__module__}.{function.__qualname__}"

    def compile_once(sig: Any) -> Any:
        # The process's own lock first, so that two of its threads never wait for one another.
        with global_compiler_lock, _only_process(name):
            return compile_alone(sig)

    kernel.compile = compile_once


@cache
def module_key(module: str) -> str:
    """Digest under which a module's kernels are kept: of its sources, Python and what compiles."""
    python = f"{sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')}"
    versions = f"{python} numba {numba.__version__} llvmlite {llvmlite.__version__} numpy {np.__version__}"
    return hashlib.sha256(f"{versions} {source_digest(module)}".encode()).hexdigest()[:LENGTH]


def _identity(value: Any) -> Any:
    """Name what a closure holds by its sources, alike in every process; a kernel's pickle is not."""
    value = getattr(value, "py_func", value)
    if not isinstance(value, type | FunctionType):
        return value
    held = [_identity(cell.cell_contents) for cell in getattr(value, "__closure__", None) or ()]
    return value.__qualname__, module_key(value.__module__), held


class _KernelLocator(_CacheLocator):
    """Names the directory and the version of a kernel's files."""

    def __init__(self, function: Any, path: str):
        self._py_file = path
        self._line = function.__code__.co_firstlineno
        self._key = module_key(function.__module__)
        self._path = module_directory(function.__module__, self._key)

    def ensure_cache_path(self) -> None:
        if not self._path.is_dir():
            self._path.mkdir(parents=True, exist_ok=True)
            make_room(self._path)

    def get_cache_path(self) -> Any:
        return str(self._path)

    def get_source_stamp(self) -> Any:
        return self._key

    def get_disambiguator(self) -> Any:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _KernelLocator:
        return cls(py_func, py_file)


class _KernelFiles(CompileResultCacheImpl):
    _locator_classes = [_KernelLocator]  # noqa: RUF012 (numba's own form)


class _KernelCache(FunctionCache):
    """Numba's cache in a directory of ours; a file that cannot be read or written costs a compilation."""

    _impl_class = _KernelFiles

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        if self._py_func.__closure__ is None:
            return super()._index_key(sig, codegen)
        held = repr(_identity(self._py_func)).encode()
        return sig, codegen.magic_tuple(), hashlib.sha256(held).hexdigest()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except (OSError, EOFError, pickle.UnpicklingError):
            with suppress(OSError):
                self.flush()  # an index that cannot be read could not be added to either
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            warnings.warn(
                f"push-recovery: a compiled kernel was not kept: {error}", RuntimeWarning, stacklevel=2
            )


@contextmanager
def _only_process(name: str) -> Iterator[None]:
    """Wait until no other process is between the load and the save of a kernel of this name.

    One byte of a common file is locked for each name. Kernels wait for their callees only, which form no
    circle; a file system without locks costs a second compilation.
    """
    file, byte, held = _lock_file(), crc32(name.encode()), False
    if file is not None and fcntl is not None:
        with suppress(OSError):
            fcntl.lockf(file, fcntl.LOCK_EX, 1, byte)
            held = True
    try:
        yield
    finally:
        if held and file is not None and fcntl is not None:
            fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)


@cache
def _lock_file() -> Any:
    """The file whose bytes are locked, open as long as the process lives; None where none can be made."""
    if fcntl is None:
        return None
    try:
        return (cache_root() / "lock").open("wb")
    except OSError:
        return None


MOST_THREADS = 1024
Job = Callable[[int, int, int], object]  # (worker, first, end)


class RangeThreads:
    """Splits 0..n-1 into one range for each thread, of which the calling thread is the first.

    Worth it for compiled jobs that release the interpreter lock. The threads, 1 to MOST_THREADS of them,
    start at first use and anew in a forked process, which has none of its parent's.
    """

    def __init__(self, threads: int = 1):
        if not (is_integer(threads) and 1 <= threads <= MOST_THREADS):
            raise InvalidValueError(
                f"threads must be a whole number from 1 to {MOST_THREADS}, got {shown(threads)}"
            )
        self.threads = int(threads)
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def __reduce__(self) -> tuple[Any, ...]:
        return RangeThreads, (self.threads,)

    def run(self, job: Job, n: int, least: int = 1) -> None:
        """Call job(worker, first, end) for ranges that cover 0..n-1, and wait for all of them.

        No two calls of one `run` have the same worker, 0..threads-1. `least` is the smallest range worth a
        thread of its own.
        """
        count = min(self.threads, n // least)
        if count <= 1:
            job(0, 0, n)
            return
        pool = self._started()
        others = [pool.submit(job, w, n * w // count, n * (w + 1) // count) for w in range(1, count)]
        try:
            job(0, 0, n // count)
        finally:
            errors = [other.exception() for other in others]
        for error in errors:
            if error is not None:
                raise error

    def _started(self) -> ThreadPoolExecutor:
        if self._pool is None or self._process != os.getpid():
            self._pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="robots")
            self._process = os.getpid()
        return self._pool


MESSAGE = (
    "push-recovery: compiling kernels, once on this machine and after a change of their sources; "
    "all of them take about two minutes ..."
)
LATELY = 600.0  # for which one word of a group of processes is enough [s]


class _Announcement(events.Listener):
    """Prints `MESSAGE` at the first compilation of a function of this package; loading from disk is none."""

    made = False

    def on_start(self, event: events.Event) -> None:
        dispatcher = (event.data or {}).get("dispatcher")
        module = str(getattr(getattr(dispatcher, "py_func", None), "__module__", ""))
        if not self.made and module.startswith("push_recovery."):
            self.made = True
            if _first_to_say():
                print(MESSAGE, file=sys.stderr, flush=True)

    def on_end(self, event: events.Event) -> None:
        pass


def _announcement_file() -> Path:
    """What a group of processes that has announced its compilation leaves."""
    return cache_root() / f"announced-{os.getpgrp() if hasattr(os, 'getpgrp') else os.getppid()}"


def compiles_lately() -> bool:
    """Whether a process of this group, a command with its workers, has announced a compilation lately."""
    try:
        return time.time() - _announcement_file().stat().st_mtime <= LATELY
    except OSError:
        return False


def _first_to_say() -> bool:
    """Whether no process of this group, a command with its workers, has said it lately."""
    path = _announcement_file()
    try:
        if path.exists() and not compiles_lately():
            path.unlink()
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        return True
    return True


@cache
def announce_compilation() -> None:
    """Have the first compilation of this process announced; to be called by what will need compiled code."""
    events.register("numba:compile", _Announcement())
