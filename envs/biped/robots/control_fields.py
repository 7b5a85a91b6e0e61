"""Which entries of MuJoCo's fields control reads and writes, in the places where it expects them.

Control knows a base, a waist of two axes and two legs of six joints (`controllers.whole_body.kinematics`).
Each entry of a robot's own fields is copied to the place that its part has there. What a robot does not have,
a waist axis, stays zero; its entry on the diagonal of the mass matrix is 1, so that it couples with nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco

from ....controllers.whole_body.kinematics import BODIES, FOOT_BODY, PELVIS, PUSHED_BODY, TRUNK
from ....controllers.whole_body.mass_matrix import ENTRIES, ROW, columns
from ...physics.fields import ONE, Field, picked, rows
from .indices import MISSING, Indices

Pairs = list[tuple[int, int]]


def inputs(indices: Indices) -> tuple[Field, ...]:
    """Torques, and forces on the bodies that pushes act on."""
    pushed = pushed_rows(indices)
    count = 1 + max(row for row, _ in pushed)
    if indices.trunk == indices.pelvis:  # `BipedCore.reset` turns its pushes into the pelvis'
        pushed.remove((TRUNK, indices.trunk))
    return picked("ctrl", (len(indices.motors),), known(indices.motors)), rows(
        "xfrc_applied", count, 6, pushed
    )


def outputs(model: mujoco.MjModel, indices: Indices) -> tuple[Field, ...]:
    """State, kinematics, mass matrix, bias, loads and contact forces, in the order of `Physics`."""
    bodies = [(PELVIS, indices.pelvis), (TRUNK, indices.trunk), *zip(FOOT_BODY, indices.feet, strict=True)]
    turned = pushed_rows(indices)
    count = 1 + max(row for row, _ in turned)
    joints = known(indices.joints)
    return (
        _with_held("qpos", indices.qpos, indices.held_qpos),
        _with_held("qvel", indices.dof, indices.held_dof),
        rows("xpos", BODIES, 3, bodies),
        rows("xmat", count, 9, turned),
        rows("xanchor", len(indices.joints), 3, joints),
        rows("xaxis", len(indices.joints), 3, joints),
        rows("subtree_com", BODIES, 3, [(0, 0)]),
        picked("M", (ENTRIES,), mass_matrix_pairs(model, indices)),
        picked("qfrc_bias", (len(indices.dof),), known(indices.dof)),
        picked("sensordata", (len(indices.loads),), known(indices.loads)),
        picked("qfrc_constraint", (len(indices.dof),), known(indices.dof)),
    )


def pushed_rows(indices: Indices) -> Pairs:
    """(row, body) of every body that is pushed: links of held joints after the rows that any robot has."""
    places = *PUSHED_BODY, *range(BODIES, BODIES + len(indices.pushed) - len(PUSHED_BODY))
    return [*zip(places, indices.pushed, strict=True)]


def _with_held(name: str, own: tuple[int, ...], held: tuple[int, ...]) -> Field:
    """A field of the state: what control knows, then the held joints, whose place `believe` needs."""
    return picked(name, (len(own) + len(held),), known((*own, *held)))


def known(numbers: tuple[int, ...]) -> Pairs:
    """(place, number) of every part that the robot has."""
    return [(place, number) for place, number in enumerate(numbers) if number != MISSING]


def mass_matrix_pairs(model: mujoco.MjModel, indices: Indices) -> Iterator[tuple[int, int]]:
    """(entry as control has it, entry of MuJoCo's sparse M) by rows, from the model's own structure."""
    for j, own in enumerate(indices.dof):
        if own == MISSING:
            yield int(ROW[j]) + len(columns(j)) - 1, ONE
            continue
        for place, i in enumerate(columns(j)):
            if indices.dof[i] != MISSING:
                yield int(ROW[j]) + place, entry(model, own, indices.dof[i])


def entry(model: mujoco.MjModel, i: int, j: int) -> int:
    """Entry of MuJoCo's sparse M for two degrees of freedom on one chain, in the outer one's row."""
    outer, inner = max(i, j), min(i, j)
    first = int(model.M_rowadr[outer])
    return first + model.M_colind[first : first + int(model.M_rownnz[outer])].tolist().index(inner)
