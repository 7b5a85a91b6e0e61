"""Terrain: the shape of the floor under a robot.

Planner and whole-body control are told nothing of it, unless the scenario says `floor_known`: then they know
how high the floor is where the swing foot is to land.

A new terrain is one class, registered by its name in JSON; a scenario has it as `ModelErrors.terrain`:

    @register_terrain
    @dataclass(frozen=True)
    class Stair(Terrain):
        json_name = "stair"
        start: float  # [m]
        rise: float  # [m]

        def shape(self, spec, soles): ...
        def height(self, x, y, pattern): ...

Where a floor is made of several terrains, it is as high as the highest of them, and their slopes add up.
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

from ...controllers.model.robot import Similarity
from ...controllers.validation import require_integer
from .record import JsonRecord, Kinds, Quantities, Quantity, checked, resized

if TYPE_CHECKING:
    import mujoco

TILE = 0.4  # side of a tile [m]
TILES_PER_FOOT = 4
DEPTH = 0.5  # half the height of a box [m]: a sole never comes out of its other side
FAR = 50.0  # half the size of boxes that nobody walks off [m]


class Pattern(NamedTuple):
    """What a floor that is drawn at random depends on, besides the terrain itself."""

    seed: int = 0  # `counter_seed` of the scenario's noise seed
    side: float = 1.0  # 1; -1 where y is mirrored, as it is with the stance side of the first step


class Terrain(JsonRecord, ABC):
    """The shape of a floor; a kind is a frozen dataclass, of which each object is one floor.

    Axes are those of the world: x forward and y left of where the robot begins, z normal to the floor. The
    robot stands at the origin, on its stance sole, when the episode begins.
    """

    shapes: ClassVar[bool] = True  # whether `shape` changes the model
    collides: ClassVar[bool] = False  # whether it is there only for robots with `ModelErrors.collisions`

    @property
    def label(self) -> str:
        """What a table calls it."""
        return self.json_name

    @property
    def tilt(self) -> tuple[float, float]:
        """Angles by which the whole floor rises forward and to the left [rad].

        Gravity is tilted by them, and recovery is judged by the nominal gait on that slope.
        """
        return 0.0, 0.0

    def modelled(self) -> Terrain:
        """The terrain that has the same model: where many share one, it is built once."""
        return self

    def shape(self, spec: mujoco.MjSpec, soles: Sequence[str]) -> None:
        """Add the floor's geoms to a robot's model, as with `add_box`, whose plane is z = 0.

        Args:
            spec: of the robot over its plane, written.
            soles: names of the geoms that touch the floor, left and right.
        """

    def height(self, x: float, y: float, pattern: Pattern) -> float:
        """Height of the floor at a point [m]; the soles begin on the highest point under them."""
        return 0.0

    def mirrored(self) -> Self:
        """Reflection in the x-z plane; a `pattern` is mirrored with the stance side."""
        return self

    def scaled(self, scale: Similarity) -> Self:
        """The same floor for a robot of another size."""
        return self

    def to_dict(self) -> dict[str, Any]:
        """Its fields and its kind."""
        return {"kind": self.json_name} | super().to_dict()


TERRAINS: Kinds[Terrain] = Kinds("terrain", Terrain)
register_terrain = TERRAINS.register


def add_box(
    spec: mujoco.MjSpec,
    soles: Sequence[str],
    name: str,
    half_size: Sequence[float],
    position: Sequence[float],
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
) -> None:
    """Put a box on the floor of a model, which the soles touch as they touch its plane.

    Args:
        spec: of the robot over its plane, written.
        soles: names of the geoms that touch the box.
        name: of the box.
        half_size: half its length, width and height [m].
        position: of its centre [m].
        quaternion: that turns it, w first.
    """
    from mujoco import mjtGeom  # heavy, and scenarios are read without it

    box = spec.worldbody.add_geom()
    box.name, box.type = name, mjtGeom.mjGEOM_BOX
    box.size, box.pos, box.quat = list(half_size), list(position), list(quaternion)
    box.contype = box.conaffinity = 0
    plane = next(pair for pair in spec.pairs if pair.geomname1 == "floor")
    for sole in soles:
        contact = spec.add_pair()
        contact.geomname1, contact.geomname2 = name, sole
        contact.condim, contact.friction, contact.solref = plane.condim, plane.friction, plane.solref


@dataclass(frozen=True)
class Slope(Terrain):
    """A floor that rises evenly. It tilts gravity, and stays level in the world's axes."""

    json_name, shapes = "slope", False

    forward: float = 0.0  # [rad]
    left: float = 0.0  # [rad]

    @property
    def tilt(self) -> tuple[float, float]:
        """The two angles."""
        return self.forward, self.left

    def mirrored(self) -> Slope:
        """It rises to the other side."""
        return Slope(self.forward, -self.left)


@dataclass(frozen=True)
class Tiles(Terrain):
    """Square tiles of different heights without end; where they are is a function of the pattern alone.

    The model holds four boxes a foot. Before every physics step they are moved to the four tiles around the
    tile corner nearest to the sole (`envs/biped/floor.py`), which hold all of it: half a tile is more than
    half the sole's diagonal.
    """

    json_name = "tiles"

    step: float = 0.0  # they are up to this much higher than others [m]

    def modelled(self) -> Tiles:
        """One model serves tiles of all heights, since its boxes move."""
        return Tiles()

    def shape(self, spec: mujoco.MjSpec, soles: Sequence[str]) -> None:
        """Put boxes in the place of the plane, each in contact with one foot."""
        spec.geom("floor").pos = [0.0, 0.0, -2.0 * DEPTH]
        half = 0.5 * TILE, 0.5 * TILE, DEPTH
        for tile in range(2 * TILES_PER_FOOT):
            sole = soles[tile // TILES_PER_FOOT]
            add_box(spec, [sole], f"tile_{tile}", half, (0.0, 0.0, -DEPTH))

    def height(self, x: float, y: float, pattern: Pattern) -> float:
        """Height of the tile there, uniform in [0, step)."""
        from .noise import grid_origin, uniform  # compiled code, and scenarios are read without it

        x0, y0 = grid_origin(pattern.seed)
        i, j = math.floor(x / TILE - x0), math.floor(pattern.side * y / TILE - y0)
        return self.step * uniform(pattern.seed, i, j)

    def scaled(self, scale: Similarity) -> Tiles:
        """Tiles of the same size, higher for a larger robot."""
        return replace(self, step=scale.length * self.step)


STEPS_MAX = 30  # of a flight
TALLEST, SHALLOWEST, DEEPEST = 0.3, 0.2, 5.0  # of a step: height, depth [m]


@register_terrain
@dataclass(frozen=True)
class Stairs(Terrain):
    """Steps across the way forward: a flight, a landing, and as many steps back to the level of the start.

    A step is `tread` deep and `rise` high; a negative rise leads down first. Behind the last step, as before
    the first one, the floor is level.
    """

    json_name = "stairs"
    quantities: ClassVar[Quantities] = {
        "rise": Quantity("m", -TALLEST, TALLEST, "length"),
        "start": Quantity("m", SHALLOWEST, 100.0, "length"),
        "tread": Quantity("m", SHALLOWEST, DEEPEST, "length"),
        "landing": Quantity("m", SHALLOWEST, DEEPEST, "length"),
    }

    rise: float  # of each step, negative where the first flight leads down [m]
    steps: int = 3  # of each flight
    start: float = 0.6  # where the first one begins [m]
    tread: float = 0.3  # [m]
    landing: float = 0.9  # depth of the landing between the flights [m]

    def __post_init__(self) -> None:
        steps = require_integer("Stairs.steps", self.steps, 1, STEPS_MAX)
        self._set(steps=steps, **checked("Stairs", self, self.quantities))

    @property
    def label(self) -> str:
        """One step or stairs, and whether they lead up or down first."""
        return f"{'step' if self.steps == 1 else 'stairs'} {'down' if self.rise < 0.0 else 'up'}"

    @property
    def end(self) -> float:
        """Where the floor is level again [m]."""
        return self.start + 2 * (self.steps - 1) * self.tread + self.landing

    @cached_property
    def treads(self) -> tuple[tuple[float, float, float], ...]:
        """Begin and end along x and height of every tread between start and end [m]."""
        found, x = [], self.start
        for number in (*range(1, self.steps + 1), *range(self.steps - 1, 0, -1)):
            depth = self.landing if number == self.steps else self.tread
            found.append((x, x + depth, number * self.rise))
            x += depth
        return tuple(found)

    def shape(self, spec: mujoco.MjSpec, soles: Sequence[str]) -> None:
        """Put a box under every tread; where they lie below the plane, boxes take its place around them."""
        boxes = list(self.treads)
        if self.rise < 0.0:
            spec.geom("floor").pos = [0.0, 0.0, self.steps * self.rise - 2.0 * DEPTH]
            boxes += [(-FAR, self.start, 0.0), (self.end, self.end + FAR, 0.0)]
        for i, (first, last, height) in enumerate(boxes):
            half, middle = 0.5 * (last - first), 0.5 * (first + last)
            add_box(spec, soles, f"stair_{i}", (half, FAR, DEPTH), (middle, 0.0, height - DEPTH))

    def height(self, x: float, y: float, pattern: Pattern) -> float:
        """Height of the tread there."""
        return next((height for first, last, height in self.treads if first <= x < last), 0.0)

    def scaled(self, scale: Similarity) -> Stairs:
        """Steps in the same proportion to a robot of another size, as far as their bounds allow it."""
        sized = resized(self, self.quantities, scale)
        for name, value in sized.items():
            sized[name] = min(max(value, self.quantities[name].low), self.quantities[name].high)
        return replace(self, **sized)


@register_terrain
@dataclass(frozen=True)
class Wall(Terrain):
    """A plane that stands beside the robot; all shapes that collide meet it, as they meet the floor."""

    json_name, collides = "wall", True
    quantities: ClassVar[Quantities] = {
        "distance": Quantity("m", 0.05, 1000.0, "length"),
        "direction": Quantity("rad", -math.tau, math.tau),
    }

    distance: float  # from the stance sole at the beginning [m]
    direction: float = 0.5 * math.pi  # in which it stands, counter-clockwise from x [rad]

    def __post_init__(self) -> None:
        self._set(**checked("Wall", self, self.quantities))

    def shape(self, spec: mujoco.MjSpec, soles: Sequence[str]) -> None:
        """Put the plane there, its normal towards the origin."""
        from mujoco import mjtGeom  # heavy, and scenarios are read without it

        x, y = math.cos(self.direction), math.sin(self.direction)
        wall = spec.worldbody.add_geom()
        wall.name, wall.type, wall.size = "wall", mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 1.0]
        wall.pos, wall.quat = [self.distance * x, self.distance * y, 0.0], [1.0, y, -x, 0.0]  # z to (-x, -y)

    def mirrored(self) -> Wall:
        """It stands on the other side."""
        return replace(self, direction=0.0 - self.direction)

    def scaled(self, scale: Similarity) -> Wall:
        """Nearer to a smaller robot."""
        return replace(self, **resized(self, self.quantities, scale))
