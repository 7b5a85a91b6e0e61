"""n simulations of one model, advanced by MuJoCo's C functions from a compiled loop.

`mujoco.batch` steps many simulations in one call from Python, but between two of its calls lies a way through
the interpreter, and every bound array costs something. The bindings name the addresses of their models and
data and bring the C library, so a compiled loop can call it directly, as often as it likes.
"""

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import copy
import ctypes
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from .biped_kinematics import Array, Ints

MODEL, DATA, FIRST_FIELD = 0, 1, 2  # columns of `Handles.addresses`


class Handles(NamedTuple):
    """What `advance` needs of n simulations."""

    addresses: Ints  # (n, 2 + fields) of the model, of its data, of every field in the data
    rows: Ints  # (fields, 2) address of the field's array over all simulations, bytes for each
    calls: Ints  # (3,) addresses of mj_step2 and mj_step1, number of fields that go in


class Simulations:
    """n simulations; `arrays[name]` is (n, ...), a copy of that field of all of them.

    After every physics step all stages that depend on positions and velocities are current (mj_step1).
    """

    def __init__(self, model: mujoco.MjModel, n: int, inputs: Sequence[str], outputs: Sequence[str]):
        """Make the data.

        Args:
            model: it is copied; not-a-number stays in the state, where MuJoCo would begin anew in silence.
            n: number of simulations.
            inputs: fields of MjData (float64) copied from the arrays before each physics step.
            outputs: fields copied into the arrays after it.
        """
        self.model = copy.copy(model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET.value
        self.data = [mujoco.MjData(self.model) for _ in range(n)]
        self._inputs, self._outputs = tuple(inputs), tuple(outputs)
        names = (*self._inputs, *self._outputs)
        self.arrays: dict[str, Array] = {
            name: np.zeros((n, *getattr(self.data[0], name).shape)) for name in names
        }
        arrays = list(self.arrays.values())
        self.handles = Handles(
            np.array([[self.model._address, data._address, *_field_addresses(data, names)]
                      for data in self.data], dtype=np.int64),
            np.array([[array.ctypes.data, array[0].nbytes] for array in arrays], dtype=np.int64),
            np.array([*_functions("mj_step2", "mj_step1"), len(self._inputs)], dtype=np.int64),
        )  # fmt: skip

    def put(self, k: int, qpos: Array, qvel: Array) -> None:
        """Reset simulation k and put it into a state; its inputs become zero."""
        data = self.data[k]
        mujoco.mj_resetData(self.model, data)
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_step1(self.model, data)
        for name, array in self.arrays.items():
            array[k] = getattr(data, name)


def _field_addresses(data: mujoco.MjData, names: Sequence[str]) -> list[int]:
    return [getattr(data, name).ctypes.data for name in names]


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
def advance(handles: Handles, k: int) -> None:
    """One physics step of simulation k: inputs into its data, mj_step2, mj_step1, outputs into the arrays."""
    own, rows, calls = handles.addresses[k], handles.rows, handles.calls
    inputs = calls[2]
    for f in range(inputs):
        _copy(own[FIRST_FIELD + f], rows[f, 0] + k * rows[f, 1], rows[f, 1])
    _call_step(calls[0], own[MODEL], own[DATA])
    _call_step(calls[1], own[MODEL], own[DATA])
    for f in range(inputs, rows.shape[0]):
        _copy(rows[f, 0] + k * rows[f, 1], own[FIRST_FIELD + f], rows[f, 1])
