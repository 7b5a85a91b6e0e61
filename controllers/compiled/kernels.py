"""`njit` for this project's kernels: compiled once on a machine, and anew when what they are made of changes.

Numba keeps compiled functions beside their module and compares that one file. Here they lie in a directory of
the user's under a digest of all that the module's kernels depend on (`source_digest`), so that an edit of a
callee compiles its callers anew, an installation that cannot be written works, and installations of equal
sources share what was compiled. A process waits for another that compiles what it needs.
"""

from __future__ import annotations

import functools
import hashlib
import pickle
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any
from zlib import crc32

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from .cache_place import cache_root, make_room, module_directory, platform_versions
from .source_digest import LENGTH, source_digest

try:
    import fcntl
except ImportError:  # not on Windows: there processes may compile the same kernel twice
    fcntl = None


def njit(*, cache: bool, **options: Any) -> Callable[[Callable], Any]:
    """`numba.njit` whose compiled code is kept by this module.

    Args:
        cache: whether compiled code is kept on disk.
        options: those of `numba.njit`.
    """

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


@functools.cache
def module_key(module: str) -> str:
    """Digest under which a module's kernels are kept."""
    text = f"{platform_versions()} {source_digest(module)}"
    return hashlib.sha256(text.encode()).hexdigest()[:LENGTH]


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
    file, held = _lock_file(), False
    if file is not None and fcntl is not None:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX, 1, crc32(name.encode()))
            held = True
        except OSError:
            pass
    try:
        yield
    finally:
        if held and file is not None and fcntl is not None:
            fcntl.lockf(file, fcntl.LOCK_UN, 1, crc32(name.encode()))


@functools.cache
def _lock_file() -> Any:
    """The file whose bytes are locked, open as long as the process lives; None where none can be made."""
    if fcntl is None:
        return None
    try:
        return (cache_root() / "lock").open("wb")
    except OSError:
        return None
