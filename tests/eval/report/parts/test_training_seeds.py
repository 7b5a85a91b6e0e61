import re

import numpy as np
import pytest
from push_recovery.eval.report.headline import profile_figure, recipes_of, seed_part, strata_of
from scipy import stats

LETTERS = "rrfsrrrfrrsf" * 8  # 96 pushes
LABELS = {name: name for name in ("residual", "residual-seed1", "two-stage", "residual-hardware")}


def shifted(by: int) -> str:
    return LETTERS[by:] + LETTERS[:by]


def test_a_recipe_is_what_differs_by_its_seed_alone():
    labels = {**LABELS, "file": "residual-Biped-v0-seed12/policy", "other": "residual-Biped-v0-seed3/policy"}
    assert recipes_of(labels) == {
        "residual": ["residual", "residual-seed1"],
        "two-stage": ["two-stage"],
        "residual-hardware": ["residual-hardware"],
        "residual-Biped-v0/policy": ["file", "other"],
    }


def test_strata_are_directions_and_quarters_of_the_impulses():
    rows = [{"impulse": float(k), "psi_deg": 45.0 * (k // 4)} for k in range(32)]
    quarters = [k * 4 // 32 for k in range(32)]
    pairs = [(k // 4, quarters[k]) for k in range(32)]
    strata = strata_of(rows)
    assert sorted(set(strata.tolist())) == list(range(len(set(pairs))))
    assert all((strata[i] == strata[j]) == (pairs[i] == pairs[j]) for i in range(32) for j in range(32))
    assert len(set(strata_of([{"impulse": 1.0, "psi_deg": None}] * 8).tolist())) == 4  # of kicks: quarters


def test_nothing_is_shown_without_several_seeds(evaluation):
    found = evaluation({"residual": LETTERS, "two-stage": LETTERS})
    assert seed_part(found, {name: name for name in found.rows}) is None


def test_the_tables_hold_the_numbers_of_their_definitions(evaluation):
    words = {"residual": LETTERS, "residual-seed1": shifted(5), "two-stage": shifted(1).replace("r", "s", 20)}
    found = evaluation(words)
    part = seed_part(found, {name: name for name in found.rows})
    assert part is not None
    strata = strata_of(found.rows["two-stage"])
    assert part.strata == len(set(strata.tolist()))
    rates = {
        name: np.array([
            np.mean([word[i] == "r" for i in np.flatnonzero(strata == k)]) for k in range(part.strata)
        ]) for name, word in words.items()
    }  # fmt: skip
    (row,) = part.rows
    counts = [word.count("r") for name, word in words.items() if name != "two-stage"]
    assert row[:3] == ("residual", "2", f"{np.mean(counts):.1f} ({min(counts)} to {max(counts)})")
    middle, low, high = numbers(row[3])
    both = np.array([rates["residual"], rates["residual-seed1"]])
    assert middle == pytest.approx(100.0 * stats.trim_mean(both.ravel(), 0.25), abs=0.05)
    assert low <= middle <= high
    ((name, other, said),) = part.against
    assert (name, other) == ("residual", "two-stage")
    u = [stats.mannwhitneyu(both[:, k], [rates["two-stage"][k]]).statistic / 2 for k in range(part.strata)]
    assert numbers(said)[0] == pytest.approx(100.0 * np.mean(u), abs=0.5)


def test_the_profile_falls_where_fewer_strata_are_recovered():
    """Every stratum of one policy is at a half, of the other at nothing or all."""
    strata = np.repeat([0, 1], 4)
    svg = profile_figure(
        {"even": np.tile([1.0, 0.0], 4)[None], "uneven": np.repeat([1.0, 0.0], 4)[None]}, strata
    )
    assert "even" in svg
    assert "uneven" in svg


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"[\d.]+", text)]
