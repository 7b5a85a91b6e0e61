"""Quadratic programs solved by DAQP and OSQP from Python, and by DAQP from compiled loops.

    min 0.5 x'Hx + f'x + 0.5 sum_i w_i s_i^2   s.t.  lower_i <= (A x)_i + s_i <= upper_i

with s_i = 0 on hard rows (w_i = 0) and free on soft rows (w_i > 0). Every solve starts cold, so that the
answer depends on the problem alone. `LeastDistance` is the case H = I, f = 0: daqp's wheel exports its C
functions, a problem owns one C workspace, set up once for its shape, and a compiled loop then only rewrites
the matrix and the bounds in place.
"""

from __future__ import annotations

import ctypes
import functools
import weakref
from ctypes import POINTER, Structure, byref, c_double, c_int, c_void_p
from dataclasses import dataclass
from importlib.metadata import version
from typing import Literal

import daqp
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from .errors import PushRecoveryError, UnknownNameError
from .jit import njit

SolverName = Literal["daqp", "osqp"]


@dataclass(frozen=True)
class QuadraticProgram:
    """A strictly convex quadratic program with two-sided, partly soft rows."""

    H: NDArray[np.float64]  # (n, n), symmetric positive definite
    f: NDArray[np.float64]  # (n,)
    A: NDArray[np.float64]  # (m, n)
    lower: NDArray[np.float64]  # (m,)
    upper: NDArray[np.float64]  # (m,)
    soft_weight: NDArray[np.float64]  # (m,), w_i; zero marks a hard row


@dataclass(frozen=True)
class QpSolution:
    """A primal-dual pair: H x + f + A'dual = 0, dual_i > 0 at the upper bound, < 0 at the lower."""

    x: NDArray[np.float64]  # (n,)
    dual: NDArray[np.float64]  # (m,)
    status: Literal["solved", "infeasible", "failed"]
    iterations: int


def solve_qp(problem: QuadraticProgram, solver: SolverName = "daqp") -> QpSolution:
    """Solve one problem from a cold start; its arrays are not changed.

    Args:
        problem: the problem.
        solver: one of `SOLVERS`: "daqp" (dual active set, exact) or "osqp" (first order, tight tolerances).

    Returns:
        The solution; `x` is NaN unless the status is "solved".
    """
    if solver not in SOLVERS:
        raise UnknownNameError("QP solver", solver, SOLVERS)
    return SOLVERS[solver](problem)


def _with_slacks(problem: QuadraticProgram) -> tuple[NDArray, NDArray, NDArray]:
    """H, f and A of the same problem with the slacks as further variables."""
    soft = np.flatnonzero(problem.soft_weight > 0)
    n, m, k = problem.f.size, problem.lower.size, soft.size
    H = np.zeros((n + k, n + k))
    H[:n, :n] = problem.H
    H[range(n, n + k), range(n, n + k)] = problem.soft_weight[soft]
    A = np.zeros((m, n + k))
    A[:, :n] = problem.A
    A[soft, range(n, n + k)] = 1.0
    return H, np.concatenate([problem.f, np.zeros(k)]), A


def _solve_daqp(problem: QuadraticProgram) -> QpSolution:
    H, f, A = _with_slacks(problem)
    upper, lower = np.ascontiguousarray(problem.upper), np.ascontiguousarray(problem.lower)
    sense = np.zeros(upper.size, dtype=np.int32)
    x, _, flag, info = daqp.solve(H, f, A, upper, lower, sense, primal_tol=1e-10)
    if flag > 0:
        n = problem.f.size
        return QpSolution(np.array(x[:n]), np.array(info["lam"]), "solved", int(info["iterations"]))
    return _no_solution(problem, "infeasible" if flag == -1 else "failed", int(info["iterations"]))


def _solve_osqp(problem: QuadraticProgram) -> QpSolution:
    """OSQP on y = L'x with H = LL' and rows of unit length: conditioning decides how fast it converges."""
    import osqp
    from scipy import linalg, sparse

    H, f, A = _with_slacks(problem)
    L = np.linalg.cholesky(H)
    whitened = linalg.solve_triangular(L, np.column_stack([f, A.T]), lower=True)
    rows = whitened[:, 1:].T
    norm = np.linalg.norm(rows, axis=1)
    norm[norm == 0] = 1.0
    solver = osqp.OSQP()
    solver.setup(
        P=sparse.identity(f.size, format="csc"), q=whitened[:, 0], A=sparse.csc_matrix(rows / norm[:, None]),
        l=problem.lower / norm, u=problem.upper / norm, verbose=False, eps_abs=1e-9, eps_rel=1e-9,
        max_iter=20_000, scaling=0, alpha=1.8, adaptive_rho_interval=25, check_termination=25,
        polishing=False,
    )  # fmt: skip
    result = solver.solve(raise_error=False)
    if result.info.status == "solved":
        x = linalg.solve_triangular(L, result.x, lower=True, trans=1)[: problem.f.size]
        return QpSolution(x, np.array(result.y) / norm, "solved", int(result.info.iter))
    status = "infeasible" if "infeasible" in result.info.status else "failed"
    return _no_solution(problem, status, int(result.info.iter))


SOLVERS = {"daqp": _solve_daqp, "osqp": _solve_osqp}


def _no_solution(
    problem: QuadraticProgram, status: Literal["infeasible", "failed"], iterations: int
) -> QpSolution:
    x, dual = np.full(problem.f.size, np.nan), np.full(problem.lower.size, np.nan)
    return QpSolution(x, dual, status, iterations)


# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false


SUPPORTED = "0.11."
_SOFT = 8  # DAQP_SOFT
_UPDATE = 2 | 8 | 16  # DAQP_UPDATE_M | DAQP_UPDATE_d | DAQP_UPDATE_sense
_FUNCTIONS = (
    "daqp_default_settings", "setup_daqp", "daqp_set_soft_weights", "daqp_update_ldp", "daqp_solve",
    "free_daqp_workspace", "free_daqp_ldp",
)  # fmt: skip
PRIMAL_TOLERANCE = 1e-9  # of every row, in its own unit


class _Problem(Structure):
    _fields_ = [
        *((name, c_int) for name in ("n", "m", "ms")),
        *((name, c_void_p) for name in ("H", "f", "A", "bupper", "blower", "sense", "break_points")),
        ("nh", c_int), ("problem_type", c_int),
    ]  # fmt: skip


class _Settings(Structure):
    _fields_ = [
        *((name, c_double) for name in ("primal_tol", "dual_tol", "zero_tol", "pivot_tol", "progress_tol")),
        ("cycle_tol", c_int), ("iter_limit", c_int), ("fval_bound", c_double),
        *((name, c_double) for name in ("eps_prox", "eta_prox", "rho_soft", "rel_subopt", "abs_subopt")),
        *((name, c_double) for name in ("sing_tol", "refactor_tol", "time_limit", "w_soft")),
        ("eq_reduction", c_int), ("presolve", c_int),
    ]  # fmt: skip


class _Workspace(Structure):
    """The fields up to `settings`; the allocation below leaves ample room for the rest."""

    _fields_ = [
        ("qp", c_void_p), ("n", c_int), ("m", c_int), ("ms", c_int),
        *((name, c_void_p) for name in ("M", "dupper", "dlower", "Rinv", "v", "sense", "scaling", "RinvD")),
        *((name, c_void_p) for name in ("x", "xold", "lam", "lam_star", "u")), ("fval", c_double),
        *((name, c_void_p) for name in ("L", "D", "xldl", "zldl")), ("reuse_ind", c_int),
        ("WS", c_void_p), ("n_active", c_int), ("iterations", c_int), ("sing_ind", c_int),
        ("prox_mask", c_void_p), ("n_prox", c_int), ("soft_slack", c_double), ("settings", c_void_p),
    ]  # fmt: skip


_WORKSPACE_BYTES = 4096  # the structure of daqp 0.11 takes 416


class _Result(Structure):
    _fields_ = [
        ("x", c_void_p), ("lam", c_void_p), ("fval", c_double), ("soft_slack", c_double),
        ("exitflag", c_int), ("iter", c_int), ("nodes", c_int),
        ("solve_time", c_double), ("setup_time", c_double),
    ]  # fmt: skip


@functools.cache
def _library() -> ctypes.CDLL:
    found = version("daqp")
    remedy = f"install it with: pip install 'daqp=={SUPPORTED}*'"
    if not found.startswith(SUPPORTED):
        raise PushRecoveryError(f"daqp {found} is installed, the planner needs {SUPPORTED}*; {remedy}")
    library = ctypes.CDLL(daqp.__file__)
    for name in _FUNCTIONS:
        if not hasattr(library, name):
            raise PushRecoveryError(f"the installed daqp does not export {name}; {remedy} from a wheel")
    library.daqp_default_settings.argtypes = [POINTER(_Settings)]
    library.setup_daqp.argtypes = [POINTER(_Problem), c_void_p, c_void_p]
    library.daqp_set_soft_weights.argtypes = [c_void_p] * 5
    library.free_daqp_workspace.argtypes = library.free_daqp_ldp.argtypes = [c_void_p]
    return library


def _address(name: str) -> int:
    return ctypes.cast(getattr(_library(), name), c_void_p).value or 0


class LeastDistance:
    """One problem of fixed shape for `solve_least_distance`, which takes its `handle`.

        min 0.5 |v|^2   s.t.   lower_i <= (M v)_i + s_i <= upper_i,   soft rows at the cost 0.5 w_i s_i^2

    The arrays are kept: every solve reads `M`, `lower` and `upper` anew and writes `x`. The C structures are
    laid out as in daqp 0.11; that is checked here, and another layout raises PushRecoveryError.

    Args:
        M: (m, n), C-contiguous.
        soft_weight: (m,), zero marks a hard row.
        lower: (m,), allocated if not given; so are `upper` and the solution `x` (n,).
        upper: (m,).
        x: (n,), the solution v.
    """

    def __init__(
        self,
        M: NDArray[np.float64],
        soft_weight: NDArray[np.float64],
        lower: NDArray[np.float64] | None = None,
        upper: NDArray[np.float64] | None = None,
        x: NDArray[np.float64] | None = None,
    ):
        m, n = M.shape
        if not (M.flags.c_contiguous and M.dtype == np.float64):
            raise PushRecoveryError("M must be C-contiguous float64")
        self.M = M
        self.lower = np.zeros(m) if lower is None else lower
        self.upper = np.zeros(m) if upper is None else upper
        self.x = np.zeros(n) if x is None else x
        self.lower[:], self.upper[:] = -1.0, 1.0
        self._sense = np.where(soft_weight > 0, _SOFT, 0).astype(np.int32)
        self._reciprocal = np.divide(1.0, soft_weight, out=np.zeros(m), where=soft_weight > 0)
        self._settings, self._result = _default_settings(), _Result(x=self.x.ctypes.data)
        self._problem = _Problem(n=n, m=m, ms=0, A=M.ctypes.data, bupper=self.upper.ctypes.data,
                                 blower=self.lower.ctypes.data, sense=self._sense.ctypes.data)  # fmt: skip
        self._memory = self._set_up(n, m)
        weights = self._reciprocal.ctypes.data
        if soft_weight.any() and not _library().daqp_set_soft_weights(
            self._memory, weights, weights, None, None
        ):
            raise PushRecoveryError("the installed daqp was built without weights of soft constraints")
        weakref.finalize(self, _free, self._memory)
        result = ctypes.addressof(self._result)
        self.handle = np.array(
            [_address("daqp_update_ldp"), _address("daqp_solve"), ctypes.addressof(self._memory),
             ctypes.addressof(self._problem), result, result + _Result.exitflag.offset],
            dtype=np.int64,
        )  # fmt: skip

    def _set_up(self, n: int, m: int) -> ctypes.Array:
        """A workspace of daqp's for the problem."""
        memory = ctypes.create_string_buffer(_WORKSPACE_BYTES)
        work = _Workspace.from_buffer(memory)
        work.settings = ctypes.addressof(self._settings)
        flag = _library().setup_daqp(byref(self._problem), memory, None)
        if flag < 0 or (work.n, work.m, work.settings) != (n, m, ctypes.addressof(self._settings)):
            raise PushRecoveryError(f"daqp could not set up a problem of {m} x {n} (exit flag {flag})")
        return memory


def _default_settings() -> _Settings:
    settings = _Settings()
    _library().daqp_default_settings(byref(settings))
    if settings.iter_limit != 10000 or settings.rho_soft != 1e-6 or settings.presolve != 1:
        raise PushRecoveryError("the installed daqp has an unexpected layout of its settings")
    settings.primal_tol = PRIMAL_TOLERANCE
    return settings


def _free(memory: ctypes.Array) -> None:
    _Workspace.from_buffer(memory).settings = None  # owned by Python
    _library().free_daqp_workspace(memory)
    _library().free_daqp_ldp(memory)


def _c_call(builder, address, restype, arguments):
    function = ir.FunctionType(restype, [a.type for a in arguments]).as_pointer()
    return builder.call(builder.inttoptr(address, function), arguments)


@intrinsic
def _call_update(typingctx, address, mask, work, problem):
    """Call int daqp_update_ldp(int mask, DAQPWorkspace*, DAQPProblem*)."""

    def codegen(context, builder, signature, args):
        return _c_call(builder, args[0], ir.IntType(32), list(args[1:]))

    return types.int32(types.int64, types.int32, types.int64, types.int64), codegen


@intrinsic
def _call_solve(typingctx, address, result, work):
    """Call void daqp_solve(DAQPResult*, DAQPWorkspace*)."""

    def codegen(context, builder, signature, args):
        _c_call(builder, args[0], ir.VoidType(), list(args[1:]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@intrinsic
def _load_int(typingctx, address):
    """The 32-bit integer at an address."""

    def codegen(context, builder, signature, args):
        return builder.load(builder.inttoptr(args[0], ir.IntType(32).as_pointer()))

    return types.int32(types.int64), codegen


@njit(cache=True)
def solve_least_distance(handle: NDArray[np.int64]) -> int:
    """Solve with the present M and bounds, from an empty active set; > 0 if solved. v lies in `x`."""
    flag = _call_update(handle[0], types.int32(_UPDATE), handle[2], handle[3])
    if flag < 0:
        return flag
    _call_solve(handle[1], handle[4], handle[2])
    return _load_int(handle[5])
