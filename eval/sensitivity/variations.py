"""Robots and physics to compare with the exact one: one thing at a time, and some together."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ...envs.episode.profile import EXACT, HARDWARE, Profile
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.physics_options import PhysicsOptions
from ...envs.scenario.scenario import ONBOARD

NUMERICS = (  # of which no result should hang
    ("step-1ms", PhysicsOptions(time_step=0.001)),
    ("step-0.5ms", PhysicsOptions(time_step=0.0005)),
    ("euler", PhysicsOptions(integrator="euler")),
    ("implicit", PhysicsOptions(integrator="implicit")),
    ("rk4", PhysicsOptions(integrator="rk4")),
    ("rk4-0.5ms", PhysicsOptions(time_step=0.0005, integrator="rk4")),
    ("cg", PhysicsOptions(solver="cg")),
    ("pgs", PhysicsOptions(solver="pgs")),
    ("elliptic", PhysicsOptions(cone="elliptic")),
    ("elliptic-impratio-10", PhysicsOptions(cone="elliptic", impratio=10.0)),
    ("contacts-4ms", PhysicsOptions(contact_time=0.004)),
    ("contacts-20ms", PhysicsOptions(contact_time=0.02)),
    ("fine", PhysicsOptions(time_step=0.0005, cone="elliptic", impratio=10.0, contact_time=0.004)),
)
BODIES = (  # of which a robot has some
    ("floor-0.6", ModelErrors(friction=0.6)),
    ("floor-0.7", ModelErrors(friction=0.7)),
    ("floor-1.2", ModelErrors(friction=1.2)),
    ("joint-friction-1", ModelErrors(joint_friction=1.0)),
    ("joint-friction-2", ModelErrors(joint_friction=2.0)),
    ("joint-damping-1", ModelErrors(joint_damping=1.0)),
    ("armature-0.03", ModelErrors(armature=0.03)),
    ("armature-0.05", ModelErrors(armature=0.05)),
    ("delay-4ms", ModelErrors(delay=0.004)),
    ("delay-10ms", ModelErrors(delay=0.01)),
    ("collisions", ModelErrors(collisions=True)),
    ("motor-2kW", ModelErrors(motor_power=2000.0)),
    ("bus-3kW", ModelErrors(bus_power=3000.0)),
    ("bus-1.5kW", ModelErrors(bus_power=1500.0)),
    ("continuous-0.4", ModelErrors(continuous_torque=0.4)),
)
SENSES = Profile("onboard", sensing=ONBOARD)  # the exact robot on its own sensors
VARIATIONS: Mapping[str, Profile] = MappingProxyType(
    {
        EXACT.name: EXACT,
        **{name: Profile(name, EXACT_MODEL, physics) for name, physics in NUMERICS},
        **{name: Profile(name, errors) for name, errors in BODIES},
        **{profile.name: profile for profile in (SENSES, HARDWARE)},
    }
)
