"""Is a contract that is wrong told apart from a policy that is weak? Planted cases of a policy that works.

    python benchmarks/contract_faults.py holosoma-g1-ppo

Faults: two joints exchanged, a scale or gains off by a factor, a clock that stands. Weak: noise on the
weights of the network, as much as brings it down. Each case is checked as `push-recovery policy check` does.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper
from push_recovery.eval.robot_tools.policy_check import Controls, diagnose, robot_of
from push_recovery.eval.rollout.contract import DAMPING, GROUP, NAMES, SCALE, STIFFNESS, PolicyContract
from push_recovery.eval.rollout.contract_files import read_contract

SWAPS = ((0, 1), (3, 4), (9, 10), (0, 6), (12, 13), (3, 9))  # places in the network's output
SCALES = (
    ("base_ang_vel", 4.0), ("joint_vel_rel", 20.0), ("joint_pos_rel", 5.0), ("projected_gravity", -1.0),
)  # fmt: skip
OF_JOINTS = ((SCALE, 4.0), (STIFFNESS, 0.25), (STIFFNESS, 4.0), (DAMPING, 6.0))
NOISES = (0.3, 0.5, 0.7, 1.0, 0.6, 0.8, 0.4)  # of a weight, in its layer's standard deviation


def with_joints(given: PolicyContract, first: int, second: int) -> PolicyContract:
    """Two joints exchanged."""
    contract, names = given.contract.copy(), list(given.joints)
    names[first], names[second] = names[second], names[first]
    contract.set(NAMES, names)
    return replace(given, contract=contract)


def with_scale(given: PolicyContract, term: str, factor: float) -> PolicyContract:
    """The scale of a term off by a factor."""
    contract = given.contract.copy()
    for one in contract.get(f"{GROUP}.terms"):
        if one["id"] == term:
            one["scale"] = [factor * value for value in one["scale"]]
    return replace(given, contract=contract)


def with_factor(given: PolicyContract, field: str, factor: float) -> PolicyContract:
    """The numbers of all joints in a field off by a factor: scale of the action, stiffness or damping."""
    contract = given.contract.copy()
    contract.set(field, {name: factor * value for name, value in contract.get(field).items()})
    return replace(given, contract=contract)


def with_clock(given: PolicyContract, period: float) -> PolicyContract:
    """A clock of another period; one of a million seconds stands."""
    contract = given.contract.copy()
    for one in contract.get(f"{GROUP}.terms"):
        if "phase" in one["id"]:
            one["params"]["period"] = period
    return replace(given, contract=contract)


def weakened(given: PolicyContract, noise: float, seed: int, folder: Path) -> PolicyContract:
    """The same contract with a network whose weights are off."""
    model, rng = onnx.load(str(given.network)), np.random.default_rng(seed)
    for weight in model.graph.initializer:
        values = numpy_helper.to_array(weight)
        if values.ndim == 2:
            values = values + noise * values.std() * rng.standard_normal(values.shape)
            weight.CopyFrom(numpy_helper.from_array(values.astype(np.float32), weight.name))
    path = folder / f"weak-{seed}.onnx"
    onnx.save(model, str(path))
    return replace(given, network=path)


def main() -> None:
    """Check all cases, print what was said of each."""
    given = read_contract(sys.argv[1] if len(sys.argv) > 1 else "holosoma-g1-ppo")
    controls, right, total = Controls(robot_of(given)), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        cases = [(f"joints {swap}", "contract", with_joints(given, *swap)) for swap in SWAPS]
        cases += [(f"scale of {term} x {factor:g}", "contract", with_scale(given, term, factor))
                  for term, factor in SCALES]  # fmt: skip
        cases += [(f"clock of {period:g} s", "contract", with_clock(given, period)) for period in (1e6, 0.3)]
        cases += [(f"{field} x {factor:g}", "contract", with_factor(given, field, factor))
                  for field, factor in OF_JOINTS]  # fmt: skip
        cases += [(f"weights off by {noise:g}", "weak", weakened(given, noise, seed, Path(folder)))
                  for seed, noise in enumerate(NOISES)]  # fmt: skip
        for name, kind, case in cases:
            began = time.perf_counter()
            found = diagnose(case, controls)
            said, repair = found.verdict.split()[0], found.repair
            right, total = right + (said == kind), total + 1
            what = "" if repair is None else f"{repair.field}, {repair.what}"
            seconds = time.perf_counter() - began
            print(f"{name:32}{kind:10}{said:10}{seconds:6.0f} s  {what}", flush=True)
    print(f"{right} of {total}")


if __name__ == "__main__":
    main()
