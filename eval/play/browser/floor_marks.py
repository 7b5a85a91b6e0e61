"""The overlays of one robot in the scene: points, regions and the planned sole."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...record.sampler import Array
from ..overlays import Overlays

POINTS = {  # what it is called -> colour, radius [m]
    "DCM": ((194, 23, 138), 0.030), "CoP": ((26, 90, 230), 0.022), "CMP": ((122, 81, 149), 0.018),
}  # fmt: skip
REGIONS = {  # what it is called -> colour, height over the floor [m]
    "capture region": ((194, 23, 138), 0.004), "box of steps": ((13, 153, 115), 0.005),
    "support polygon": ((26, 90, 230), 0.006),
}  # fmt: skip
FOOTHOLD, FOOTHOLD_COLOUR, FOOTHOLD_HEIGHT = "planned step", (13, 153, 115), 0.007
COLOURS = {name: about[0] for name, about in {**POINTS, **REGIONS}.items()} | {FOOTHOLD: FOOTHOLD_COLOUR}
THICKNESS = 0.008  # of a line [m]
SEGMENTS = 8  # of every region: the hull of two soles has no more corners


class FloorMarks:
    """Handles of the overlays of one robot.

    Args:
        server: of viser.
        root: name of the frame that the robot stands in.
    """

    def __init__(self, server: Any, root: str):
        scene, nothing = server.scene, np.zeros((SEGMENTS, 2, 3), np.float32)
        self._points = {
            name: scene.add_icosphere(f"{root}/{name}", radius=radius, color=colour, cast_shadow=False)
            for name, (colour, radius) in POINTS.items()
        }
        self._regions = {
            name: scene.add_line_segments(f"{root}/{name}", nothing, colour, thickness=THICKNESS)
            for name, (colour, _) in REGIONS.items()
        }
        self._foothold = scene.add_mesh_simple(
            f"{root}/{FOOTHOLD}", np.zeros((4, 3), np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
            color=FOOTHOLD_COLOUR, opacity=0.6, side="double", cast_shadow=False,
        )  # fmt: skip

    def draw(self, overlays: Overlays, visible: dict[str, bool]) -> None:
        """Put all of them where they are now."""
        stands = len(overlays.support) > 0
        places = {"DCM": overlays.dcm, "CoP": overlays.cop, "CMP": overlays.cmp}
        for name, handle in self._points.items():
            handle.position = (*places[name].tolist(), 0.02)
            handle.visible = visible[name] and (stands or name == "DCM")
        polygons = overlays.capture_region, overlays.step_box, overlays.support
        for (name, handle), polygon in zip(self._regions.items(), polygons, strict=True):
            handle.visible = visible[name] and len(polygon) > 0
            if handle.visible:
                handle.points = closed_line(polygon, REGIONS[name][1])
        self._foothold.visible = visible[FOOTHOLD]
        self._foothold.vertices = at_height(overlays.foothold, FOOTHOLD_HEIGHT)

    def remove(self) -> None:
        """Take them out of the scene."""
        for handle in (*self._points.values(), *self._regions.values(), self._foothold):
            handle.remove()


def at_height(points: Array, height: float) -> np.ndarray:
    """Points (k, 2) at a height [m], (k, 3) as the browser takes them."""
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)


def closed_line(polygon: Array, height: float) -> np.ndarray:
    """The edges of a polygon (k, 2) at a height [m], as segments (SEGMENTS, 2, 3), the last one repeated."""
    points = at_height(polygon, height)
    edges = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    return edges[np.minimum(np.arange(SEGMENTS), len(edges) - 1)]
