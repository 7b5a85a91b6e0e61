"""What is taken for an observation, and what is refused with a word of why."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import OBSERVATION_SIZE, as_batch

COUNTS = list(range(OBSERVATION_SIZE))
TOO_LARGE = [10**400, *COUNTS[1:]]  # no float holds it


@pytest.mark.parametrize(
    "observation",
    [
        COUNTS,
        tuple(COUNTS),
        np.array(COUNTS, dtype=np.int8),
        np.array(COUNTS, dtype=np.float32),
        np.array(COUNTS, dtype=">f8"),  # of the other byte order
        np.array(COUNTS, dtype=object),
        np.arange(2.0 * OBSERVATION_SIZE)[::2] / 2.0,
    ],
)
def test_real_numbers_of_any_type_are_taken(observation):
    batch, single = as_batch(observation)
    assert single
    assert (batch.shape, batch.dtype, batch.flags.c_contiguous) == ((1, 36), np.float64, True)
    assert batch[0].tolist() == COUNTS


def test_a_batch_of_doubles_is_not_copied():
    observations = np.zeros((3, OBSERVATION_SIZE))
    batch, single = as_batch(observations)
    assert not single
    assert np.shares_memory(batch, observations)


@pytest.mark.parametrize(
    ("observation", "message"),
    [
        (np.zeros(36, dtype=complex), "array of real numbers: it holds complex128"),
        ([0.5 + 1j] + [0.0] * 35, "array of real numbers: it holds complex128"),
        (np.array([1j] * 36, dtype=object), "array of real numbers: .*complex"),
        (TOO_LARGE, "integer that is larger than any float"),
        ([COUNTS, TOO_LARGE], "integer that is larger than any float"),
        (["1.0"] * 36, "array of real numbers: it holds <U3"),
        ([[0.0] * 36, [0.0] * 35], "array of numbers"),
        (np.zeros(36, dtype="datetime64[s]"), "array of real numbers: it holds datetime64"),
        (np.zeros((2, 35)), r"must have shape \(36,\) or \(n, 36\), got \(2, 35\)"),
        (0.0, "must have shape"),
    ],
)
def test_anything_else_is_refused(observation, message):
    with pytest.raises(InvalidValueError, match=f"^observation .*{message}"):
        as_batch(observation)
