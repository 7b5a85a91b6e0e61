"""n simulations of one model, advanced by MuJoCo's C functions from a compiled loop.

`mujoco.batch` steps many simulations in one call from Python, but between two of its calls lies a way through
the interpreter, and every bound array costs something. The bindings name the addresses of their models and
data and bring the C library, so a compiled loop can call it directly, as often as it likes.

A `Field` says where the entries of one of MuJoCo's fields go in the arrays that a controller reads and
writes. A simulation may have a model of its own, which its controller does not know. What the controller then
takes for the robot's kinematics, mass matrix and bias is computed once more from the measured positions and
velocities with the common model: `compute_nominal`.
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ..controllers.array_table import Ints1, Ints2
from ..controllers.jit import njit
from ..controllers.whole_body.kinematics import Array, Ints

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false

ONE = -1  # in place of an entry of MuJoCo's: the number 1


class Run(NamedTuple):
    """Entries that lie in a row on both sides."""

    to: int  # first entry in the array of one robot
    source: int  # first entry in MuJoCo's field, or ONE
    entries: int


class Field(NamedTuple):
    """A field of MjData (float64) and the runs of it that are copied; the rest of the array stays 0."""

    name: str
    shape: tuple[int, ...]  # of the array of one robot
    runs: tuple[Run, ...]


def whole(data: mujoco.MjData, name: str) -> Field:
    """The field as it is."""
    shape = getattr(data, name).shape
    return Field(name, shape, (Run(0, 0, int(np.prod(shape))),))


def picked(name: str, shape: tuple[int, ...], pairs: Iterable[tuple[int, int]]) -> Field:
    """Some entries of a field, as (entry in the array, entry in the field); what lies in a row is one run."""
    runs: list[Run] = []
    for to, source in pairs:
        last = runs[-1] if runs else Run(0, 0, 0)
        follows = (to, source) == (last.to + last.entries, last.source + last.entries)
        if runs and follows and ONE not in {source, last.source}:
            runs[-1] = last._replace(entries=last.entries + 1)
        else:
            runs.append(Run(to, source, 1))
    return Field(name, shape, tuple(runs))


def rows(name: str, count: int, width: int, pairs: Iterable[tuple[int, int]]) -> Field:
    """Some rows of a field (m, width), as (row in the array, row in the field); an array (count, width)."""
    entries = ((to * width + i, source * width + i) for to, source in pairs for i in range(width))
    return picked(name, (count, width), entries)


ENTRY = 8  # bytes of a float64
MODEL, DATA, FIRST_RUN = 0, 1, 2  # columns of `Handles.addresses`
INPUT_RUNS, STATE_RUNS, MEASURED_RUNS = 7, 8, 9  # places in `Handles.calls`
WHOLE_STEP = 10  # place of mj_step in `Handles.calls`
STATE = ("qpos", "qvel")
MEASURED = (*STATE, "sensordata", "qfrc_constraint")  # what is true of a robot, whatever is believed
LEFT = MEASURED[len(STATE) :]  # what mj_step2 leaves and mj_step1 does not compute again
SIZES = ("ngeom", "npair", "nbvh", "nbvhdynamic", "narena")  # of a model that its data depend on
STEP = ("mj_step2", "mj_step1")
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION.value
AS_SIMULATED = mujoco.mjtDisableBit.mjDSBL_AUTORESET.value | mujoco.mjtDisableBit.mjDSBL_ISLAND.value
BELIEF = ("mj_kinematics", "mj_comPos", "mj_makeM", "mj_comVel")  # and last of all mj_rne


class Handles(NamedTuple):
    """Addresses and counts of n simulations by which `advance` works."""

    addresses: Ints2  # (n, 2 + runs) of the model, of its data, of every run in the data
    rows: Ints2  # (runs, 3) address in the first simulation's array, bytes to the next one's, bytes to copy
    calls: Ints1  # (11,) addresses of STEP, BELIEF, mj_rne; number of runs that go in, of STATE, of MEASURED;
    # address of mj_step
    belief: Ints1  # (3 + runs,) as a row of `addresses`: common model, a worker's own data; its qfrc_bias


class Simulations:
    """n simulations; `arrays[name]` is (n, ...), a copy of that field of all of them.

    After every physics step all stages that depend on positions and velocities are current (mj_step1).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        n: int,
        inputs: Sequence[str | Field],
        outputs: Sequence[str | Field],
        workers: int = 1,
    ):
        """Make the data.

        Args:
            model: common to all; it is copied, see `simulated`.
            n: number of simulations.
            inputs: fields of MjData, copied from the arrays before each physics step; a name stands for the
                whole field.
            outputs: fields copied into the arrays after it.
            workers: threads that call `compute_nominal`, worker w with `handles_of(w)`.
        """
        self.model = simulated(model)
        self.models = [self.model] * n
        self.data = [mujoco.MjData(self.model) for _ in range(n)]
        self._belief = [mujoco.MjData(self.model) for _ in range(workers)]
        self._one = np.ones(1)
        given, found = (
            [whole(self._belief[0], field) if isinstance(field, str) else field for field in fields]
            for fields in (inputs, outputs)
        )
        measured = [field for name in MEASURED for field in found if field.name == name]
        self._given = len(given)
        self._fields = [*given, *measured, *(field for field in found if field.name not in MEASURED)]
        self.arrays: dict[str, Array] = {field.name: np.zeros((n, *field.shape)) for field in self._fields}
        state = [field for field in measured if field.name in STATE]
        counts = [sum(len(field.runs) for field in fields) for fields in (given, state, measured)]
        own = [[self.model._address, data._address, *self._runs(data)] for data in self.data]
        self._common = (
            np.array(own, dtype=np.int64),
            np.array(self._rows(self.arrays), dtype=np.int64),
            np.array([*_functions(*STEP, *BELIEF, "mj_rne"), *counts, *_functions("mj_step")], np.int64),
        )
        self.handles = self.handles_of(0)

    def handles_of(self, worker: int) -> Handles:
        """Handles for one of the threads; they differ in where it computes what is believed."""
        data = self._belief[worker]
        row = [self.model._address, data._address, *self._runs(data), data.qfrc_bias.ctypes.data]
        return Handles(*self._common, np.array(row, dtype=np.int64))

    def outputs_beside(self) -> tuple[dict[str, Array], Handles]:
        """Other arrays of the outputs, the same ones of the inputs, and handles that write there."""
        given = self.handles.calls[INPUT_RUNS]
        arrays = {name: np.zeros_like(array) for name, array in self.arrays.items()}
        runs = 0
        for field in self._fields:
            if runs < given:
                arrays[field.name] = self.arrays[field.name]
            runs += len(field.runs)
        return arrays, self.handles._replace(rows=np.array(self._rows(arrays), dtype=np.int64))

    def _runs(self, data: mujoco.MjData) -> list[int]:
        """Addresses of all runs in a simulation's data."""
        return [
            self._one.ctypes.data if run.source == ONE
            else getattr(data, field.name).ctypes.data + ENTRY * run.source
            for field in self._fields for run in field.runs
        ]  # fmt: skip

    def _rows(self, arrays: dict[str, Array]) -> list[list[int]]:
        rows = []
        for field in self._fields:
            array = arrays[field.name]
            stride = array.strides[0]
            rows += [[array.ctypes.data + ENTRY * run.to, stride, ENTRY * run.entries] for run in field.runs]
        return rows

    def use_model(self, k: int, model: mujoco.MjModel | None) -> None:
        """Give simulation k a model of its own, or the common one again (None).

        It may have more geoms and contacts than the common one. It has to be put into a state next.
        """
        before, self.models[k] = self.models[k], self.model if model is None else model
        if any(getattr(self.models[k], size) != getattr(before, size) for size in SIZES):
            self.data[k] = mujoco.MjData(self.models[k])
            self.handles.addresses[k, DATA:] = [self.data[k]._address, *self._runs(self.data[k])]
        self.handles.addresses[k, MODEL] = self.models[k]._address

    def put(self, k: int, qpos: Array, qvel: Array) -> None:
        """Reset simulation k and put it into a state; its inputs become zero."""
        model, data = self.models[k], self.data[k]
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_step1(model, data)
        self._show(k, self._fields)

    def jump(self, k: int, dofs: Sequence[int], change: Array) -> None:
        """Add to velocities of simulation k; what depends on them is current, the arrays stay as they are."""
        data = self.data[k]
        data.qvel[list(dofs)] += change
        mujoco.mj_step1(self.models[k], data)

    def show(self, k: int) -> None:
        """Copy the outputs as simulation k itself has them."""
        self._show(k, self._fields[self._given :])

    def _show(self, k: int, fields: Sequence[Field]) -> None:
        data = self.data[k]
        for field in fields:
            to, source = self.arrays[field.name][k].reshape(-1), getattr(data, field.name).reshape(-1)
            for run in field.runs:
                end = run.to + run.entries
                to[run.to : end] = 1.0 if run.source == ONE else source[run.source :][: run.entries]

    def state(self, k: int) -> Array:
        """All that the future of simulation k follows from: MuJoCo's integration state, and LEFT."""
        model, data = self.models[k], self.data[k]
        whole = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
        mujoco.mj_getState(model, data, whole, INTEGRATION)
        return np.concatenate([whole, *(getattr(data, name) for name in LEFT)])

    def restore(self, k: int, state: Array) -> None:
        """Put simulation k into a `state` of one with the same model; the arrays stay as they are."""
        model, data = self.models[k], self.data[k]
        mujoco.mj_resetData(model, data)
        first = mujoco.mj_stateSize(model, INTEGRATION)
        mujoco.mj_setState(model, data, state[:first], INTEGRATION)
        mujoco.mj_step1(model, data)
        for name in LEFT:
            field = getattr(data, name)
            field[:] = state[first : first + len(field)]
            first += len(field)


def simulated(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy in whose state not-a-number stays, where MuJoCo would begin anew in silence.

    A robot is one island of constraints, so that nothing is looked for besides; the steps have the same bits.
    """
    model = copy.copy(model)
    model.opt.disableflags |= AS_SIMULATED
    return model


def _functions(*names: str) -> list[int]:
    """Addresses of C functions in the library that the bindings are linked to."""
    library = ctypes.CDLL(mujoco._functions.__file__)
    return [ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0 for name in names]


@intrinsic
def _call_step(typingctx, function, model, data):
    """Call void f(const mjModel*, mjData*)."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [args[1].type, args[2].type]).as_pointer()
        builder.call(builder.inttoptr(args[0], kind), list(args[1:]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@intrinsic
def _call_rne(typingctx, function, model, data, result):
    """Call void mj_rne(const mjModel*, mjData*, int with_acceleration = 0, double* result)."""

    def codegen(context, builder, signature, args):
        number, zero = args[1].type, ir.Constant(ir.IntType(32), 0)
        kind = ir.FunctionType(ir.VoidType(), [number, number, zero.type, number]).as_pointer()
        builder.call(builder.inttoptr(args[0], kind), [args[1], args[2], zero, args[3]])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, types.int64), codegen


@intrinsic
def _copy(typingctx, to, source, count):
    """Copy `count` bytes from one address to another."""

    def codegen(context, builder, signature, args):
        byte = ir.IntType(8).as_pointer()
        cgutils.raw_memcpy(
            builder, builder.inttoptr(args[0], byte), builder.inttoptr(args[1], byte), args[2], 1
        )
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@njit(cache=True)
def _copy_out(handles: Handles, k: int, own: Ints, first: int, end: int) -> None:
    """Copy runs first..end-1 of the data whose addresses are `own` into the arrays of simulation k."""
    rows = handles.rows
    for r in range(first, end):
        _copy(rows[r, 0] + k * rows[r, 1], own[FIRST_RUN + r], rows[r, 2])


@njit(cache=True)
def _copy_in(handles: Handles, k: int, own: Ints, first: int, end: int) -> None:
    """Copy runs first..end-1 of the arrays of simulation k into the data whose addresses are `own`."""
    rows = handles.rows
    for r in range(first, end):
        _copy(own[FIRST_RUN + r], rows[r, 0] + k * rows[r, 1], rows[r, 2])


@njit(cache=True)
def show_measured(handles: Handles, k: int) -> None:
    """Copy the MEASURED outputs as simulation k itself has them."""
    calls = handles.calls
    inputs = calls[INPUT_RUNS]
    _copy_out(handles, k, handles.addresses[k], inputs, inputs + calls[MEASURED_RUNS])


@njit(cache=True)
def advance_measured(handles: Handles, k: int, whole: bool) -> None:
    """One physics step of simulation k of which only what is MEASURED gets into the arrays.

    `whole`: by mj_step, which RK4 needs, instead of mj_step2; either is followed by mj_step1.
    """
    own, calls = handles.addresses[k], handles.calls
    _copy_in(handles, k, own, 0, calls[INPUT_RUNS])
    _call_step(calls[WHOLE_STEP] if whole else calls[0], own[MODEL], own[DATA])
    _call_step(calls[1], own[MODEL], own[DATA])
    show_measured(handles, k)


@njit(cache=True)
def show_unmeasured(handles: Handles, k: int) -> None:
    """Copy the outputs that are not MEASURED as simulation k itself has them."""
    done = handles.calls[INPUT_RUNS] + handles.calls[MEASURED_RUNS]
    _copy_out(handles, k, handles.addresses[k], done, handles.rows.shape[0])


@njit(cache=True)
def advance(handles: Handles, k: int) -> None:
    """One physics step of simulation k: inputs into its data, mj_step2, mj_step1, outputs into the arrays."""
    advance_measured(handles, k, False)
    show_unmeasured(handles, k)


@njit(cache=True)
def compute_nominal(handles: Handles, k: int) -> None:
    """Write all outputs but the measured ones of simulation k as the common model has them.

    They follow from the arrays of qpos and qvel, which must be among the outputs: kinematics, M and bias of
    the stages of mj_step1 that need no contacts.
    """
    own, rows, calls = handles.belief, handles.rows, handles.calls
    first = calls[INPUT_RUNS]
    _copy_in(handles, k, own, first, first + calls[STATE_RUNS])
    for c in range(2, 6):
        _call_step(calls[c], own[MODEL], own[DATA])
    _call_rne(calls[6], own[MODEL], own[DATA], own[FIRST_RUN + rows.shape[0]])
    _copy_out(handles, k, own, first + calls[MEASURED_RUNS], rows.shape[0])
