"""Observations of one board by the cameras of a rig, grouped into shots."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, IntArray
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations
from calibrary.errors import InputError
from calibrary.records import replace


class RigObservations(Struct, frozen=True, kw_only=True, eq=False):
    """All views of one board by the cameras of a rig.

    Attributes:
        cameras: observations by camera name; the first camera is the reference.
        shots: names of the shots, in the order of exposure.
        rows: (S, C) index of each camera's view in a shot; −1 if it has none.

    Raises:
        InputError: there are fewer than two cameras, they saw different boards, or a view is not in exactly one shot.
    """

    cameras: Mapping[str, Observations]
    shots: tuple[str, ...]
    rows: IntArray

    def __post_init__(self) -> None:
        seen = list(self.cameras.values())
        if len(seen) < 2:
            raise InputError(f"a rig of {len(seen)} camera; expected two or more")
        if any(one.board != seen[0].board for one in seen):
            raise InputError("the cameras saw different boards; expected one board for the whole rig")
        for at, (name, one) in enumerate(self.cameras.items()):
            views = np.sort(self.rows[:, at][self.rows[:, at] >= 0])
            if not np.array_equal(views, np.arange(len(one.views))):
                raise InputError(f"{name}: expected each of its {len(one.views)} views in one shot")

    @property
    def names(self) -> tuple[str, ...]:
        """Camera names, the reference first."""
        return tuple(self.cameras)

    @classmethod
    def of(
        cls, cameras: Mapping[str, Observations], shots: Mapping[str, Mapping[str, str]]
    ) -> RigObservations:
        """Group views into shots.

        Args:
            cameras: observations by camera name.
            shots: for each shot, the image name of each camera; images without a view are allowed.
        """
        at = [{view.name: index for index, view in enumerate(one.views)} for one in cameras.values()]
        rows = [
            [views.get(frames.get(name, ""), -1) for name, views in zip(cameras, at, strict=True)]
            for frames in shots.values()
        ]
        kept = [row for row, views in enumerate(rows) if max(views) >= 0]
        return cls(
            cameras=cameras,
            shots=tuple(name for row, name in enumerate(shots) if row in set(kept)),
            rows=np.array([rows[row] for row in kept], dtype=np.intp).reshape(-1, len(cameras)),
        )

    def turned(self, camera: int, views: list[int]) -> RigObservations:
        """Return the same with the corners of some views counted from the other end of the board."""
        name = self.names[camera]
        seen, points = self.cameras[name], len(self.cameras[name].board.points)
        changed = tuple(
            replace(view, ids=points - 1 - view.ids) if at in views else view
            for at, view in enumerate(seen.views)
        )
        return replace(self, cameras={**self.cameras, name: replace(seen, views=changed)})


def rig_network(
    seen: RigObservations, kept: list[list[BoolArray]], noise_px: tuple[float, ...], rows: IntArray
) -> Network:
    """Arrange the corners of all cameras as a network, with a block for each camera in every row.

    Args:
        seen: the views.
        kept: which corners of each view are used, by camera and view.
        noise_px: standard deviation of a coordinate by camera; pixels are divided by it.
        rows: (V, C) index of each camera's view in a row; a shot may be split into several rows.
    """
    alone = [Network.of(one) for one in seen.cameras.values()]
    corners = max(one.seen.shape[1] for one in alone)
    shape = (len(rows), corners * len(alone))
    # An unused corner must still lie on one of the board's lines of points.
    harmless = next(one.points[one.seen][0] for one in alone if one.seen.any())
    points, pixels = np.tile(harmless, (*shape, 1)), np.zeros((*shape, 2))
    warp_shape, counts = np.zeros((*shape, 2)), np.zeros(shape, dtype=np.bool_)
    for camera, (one, noise) in enumerate(zip(alone, noise_px, strict=True)):
        for row in np.flatnonzero(rows[:, camera] >= 0):
            view, mask = rows[row, camera], kept[camera][rows[row, camera]]
            at = slice(camera * corners, camera * corners + len(mask))
            points[row, at] = one.points[view, : len(mask)]
            pixels[row, at] = one.pixels[view, : len(mask)] / noise
            warp_shape[row, at] = one.warp_shape[view, : len(mask)]
            counts[row, at] = mask
    return Network(
        points=points,
        pixels=pixels,
        seen=counts,
        warp_shape=warp_shape,
        is_planar=all(one.is_planar for one in alone),
    )
