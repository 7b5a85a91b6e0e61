"""An offscreen OpenGL canvas for MuJoCo scenes: EGL without a display, OSMesa where EGL fails."""

from __future__ import annotations

import atexit
import importlib
import os
import sys
import threading
import warnings
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import PushRecoveryError

BACKENDS = ("egl", "osmesa")  # tried in this order on Linux unless MUJOCO_GL names one


class RenderError(PushRecoveryError):
    """No picture can be drawn here."""


class Owner:
    """The process and the thread that opened a picture, and alone can draw it.

    OpenGL's state and MuJoCo's window belong to them: a forked child has neither their threads nor a
    connection of its own, and would wait for an answer for ever.
    """

    _first: ClassVar[int | None] = None  # process that first opened a picture; a forked child knows it, too

    def __init__(self) -> None:
        """Be the owner of a picture that is about to be opened.

        Raises:
            RenderError: this process was forked from one that had opened a picture.
        """
        Owner._first = Owner._first or os.getpid()
        self._process, self._thread = os.getpid(), threading.get_ident()
        if Owner._first != self._process:
            raise RenderError(self._forked(Owner._first))

    @staticmethod
    def _forked(process: int) -> str:
        return (
            f"a picture was opened in process {process}, of which this one ({os.getpid()}) was forked, and "
            "OpenGL does not survive that: start processes that draw by 'spawn' or 'forkserver' "
            "(multiprocessing.get_context), or draw in the first one"
        )

    def is_here(self) -> bool:
        """Whether this is the owner."""
        return (self._process, self._thread) == (os.getpid(), threading.get_ident())

    def check(self) -> None:
        """Raise RenderError in another process or thread."""
        if self._process != os.getpid():
            raise RenderError(self._forked(self._process))
        if self._thread != threading.get_ident():
            raise RenderError(
                "a picture is drawn by the thread that opened it, with the first render(): this is another "
                "one; make an environment in each thread that draws"
            )


def require_display() -> None:
    """Ask for a display first: MuJoCo's viewer ends the process where it finds none.

    Raises:
        RenderError: none answers.
    """
    if not sys.platform.startswith("linux"):
        return
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")) and glfw.init()
    if not found:
        raise RenderError(
            "render_mode 'human' needs a display, and none answers (DISPLAY="
            f"{os.environ.get('DISPLAY', '')!r}); use render_mode 'rgb_array', or "
            "push-recovery play --out FILE.mp4"
        )


def window_opens() -> bool:
    """Whether there is a display; where none is, a warning: the environment then runs unseen."""
    try:
        require_display()
    except RenderError as error:
        warnings.warn(f"{error}. Nothing is shown", RuntimeWarning, stacklevel=2)
        return False
    return True


def make_context(width: int, height: int) -> Any:
    """A current OpenGL context; `free()` releases it.

    MuJoCo itself picks its backend once, when it is first imported, and then takes the one that needs a
    display. Here the backend is picked when a picture is first drawn.

    Raises:
        RenderError: no backend works; says why, for each.
    """
    named = os.environ.get("MUJOCO_GL", "").lower().strip()
    if not sys.platform.startswith("linux") or named not in {"", *BACKENDS}:
        try:
            return _current(mujoco.GLContext(width, height))
        except Exception as error:
            raise RenderError(_refusal(f"{named or 'default'}: {error or type(error).__name__}")) from error
    reasons: list[str] = []
    for backend in (named,) if named else BACKENDS:
        try:
            with _backend_variables(backend):
                module = importlib.import_module(f"mujoco.{backend}")
                return _current(module.GLContext(width, height))
        except Exception as error:  # drivers fail in many ways: ImportError, AttributeError, GLError ...
            reasons.append(f"{backend}: {type(error).__name__}: {error}")
            _forget_opengl(backend)
    raise RenderError(_refusal("; ".join(reasons)))


def _refusal(reasons: str) -> str:
    return (
        f"no OpenGL for offscreen rendering ({reasons}). On Linux install EGL (libegl1 with a driver, such "
        "as libgl1-mesa-dri) or OSMesa (libosmesa6), and leave MUJOCO_GL unset or set it to one of "
        f"{', '.join(BACKENDS)}"
    )


def _current(context: Any) -> Any:
    context.make_current()
    return context


@contextmanager
def _backend_variables(backend: str) -> Iterator[None]:
    """Set MUJOCO_GL, by which MuJoCo's loader of OpenGL functions chooses a backend's table."""
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = backend
    try:
        yield
    except BaseException:
        if before is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = before
        raise


def _forget_opengl(backend: str) -> None:
    """Undo what a failed backend left behind: PyOpenGL binds itself to one platform at import."""
    if os.environ.get("PYOPENGL_PLATFORM") == backend:
        del os.environ["PYOPENGL_PLATFORM"]
    for name in list(sys.modules):
        if name == "OpenGL" or name.startswith(("OpenGL.", f"mujoco.{backend}")):
            del sys.modules[name]


_ABANDONED: list[Any] = []


class Canvas:
    """Draws scenes of one model into an array; shadows, reflections and multisampling are off for speed."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int):
        self._shape, self._owner = (height, width, 3), Owner()
        self._context: Any = make_context(width, height)
        try:
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except mujoco.FatalError as error:
            raise RenderError(_refusal(str(error))) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        mujoco.mjr_resizeOffscreen(width, height, self._renderer)  # what is not read need not be cleared
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        atexit.register(_close, weakref.ref(self))  # before the interpreter takes the backend down

    def draw(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """The scene as an image (height, width, 3)."""
        if self._context is None:
            raise RenderError("the picture has been closed")
        self._owner.check()
        self._context.make_current()
        mujoco.mjr_render(self._rectangle, scene, self._renderer)
        image = np.empty(self._shape, np.uint8)
        mujoco.mjr_readPixels(image, None, self._rectangle, self._renderer)
        return np.ascontiguousarray(image[::-1])

    def close(self) -> None:
        """Release OpenGL's memory; may be called twice. Away from its owner it is left to the system."""
        if self._context is not None and not self._owner.is_here():
            _ABANDONED.append((self._context, self._renderer))  # whose finalizers would call OpenGL
            self._context = None
        elif self._context is not None:
            self._context.make_current()
            self._renderer.free()
            self._context.free()
            self._context = None


def _close(reference: weakref.ref[Canvas]) -> None:
    canvas = reference()
    if canvas is not None:
        canvas.close()
