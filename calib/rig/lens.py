"""A rig as a single projection model, so that :mod:`calibrary.calib.adjustment` also works for it.

Every shot has one pose, of the board relative to the reference camera. A row of the network has a block of corners for
each camera, which is transformed by that camera's pose in the rig and projected by its lens model. Pixels are divided
by the noise of their camera, since the corners of a thermal camera may be ten times as noisy as those of others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.lens_models import Projected, Solvable
from calibrary.rotations import left_jacobian, rotation_matrix, rotation_vector

PLACE = ("rx", "ry", "rz", "tx", "ty", "tz")
"""Pose of a camera in the rig: rotation vector in rad and translation in mm; x_camera = R x_reference + t."""


class Place(Struct, frozen=True, kw_only=True, eq=False):
    """Pose of a camera: x_camera = R x_reference + t.

    Attributes:
        rotation: (3, 3) R.
        translation: (3,) t in mm.
    """

    rotation: FloatArray
    translation: FloatArray

    @classmethod
    def between(cls, pose: tuple[FloatArray, FloatArray], reference: tuple[FloatArray, FloatArray]) -> Place:
        """Return the relative pose of two cameras from their poses of the same board."""
        rotation = pose[0] @ reference[0].T
        return cls(rotation=rotation, translation=pose[1] - rotation @ reference[1])

    def after(self, first: Place) -> Place:
        """Return the composition of ``first`` followed by this pose."""
        return Place(
            rotation=self.rotation @ first.rotation,
            translation=self.rotation @ first.translation + self.translation,
        )

    @property
    def inverse(self) -> Place:
        """Return the inverse pose, from the camera to the reference."""
        return Place(rotation=self.rotation.T, translation=-self.rotation.T @ self.translation)

    @property
    def parameters(self) -> FloatArray:
        """Parameters, (6,), of the adjustment."""
        return np.concatenate([rotation_vector(self.rotation), self.translation])


class RigLens(Struct, frozen=True, kw_only=True):
    """Lens models of a rig, the reference camera first.

    Attributes:
        names: camera names.
        models: lens models.
        noise_px: standard deviation of a coordinate of each camera, px.
        corners: number of corners of each camera in a row of the network.
    """

    names: tuple[str, ...]
    models: tuple[Solvable, ...]
    noise_px: tuple[float, ...]
    corners: int

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameter names: ``left.fx`` … for each camera, then ``right.rx`` … for each except the reference."""
        lenses = [
            f"{name}.{one}"
            for name, model in zip(self.names, self.models, strict=True)
            for one in model.parameters
        ]
        return (*lenses, *(f"{name}.{one}" for name in self.names[1:] for one in PLACE))

    def lens_of(self, camera: int) -> slice:
        """Return the slice of a camera's lens parameters."""
        first = sum(len(model.parameters) for model in self.models[:camera])
        return slice(first, first + len(self.models[camera].parameters))

    def place_of(self, camera: int) -> slice:
        """Return the slice of a camera's pose parameters; empty for the reference."""
        first = self.lens_of(len(self.models) - 1).stop + len(PLACE) * (camera - 1)
        return slice(first, first + len(PLACE)) if camera else slice(0, 0)

    def place(self, parameters: FloatArray, camera: int) -> Place:
        """Return the pose of a camera."""
        if camera == 0:
            return Place(rotation=np.eye(3), translation=np.zeros(3))
        values = parameters[self.place_of(camera)]
        return Place(rotation=rotation_matrix(values[:3]), translation=values[3:])

    def of(self, lenses: Sequence[FloatArray], places: Sequence[Place]) -> FloatArray:
        """Return the parameter vector.

        Args:
            lenses: lens parameters of each camera.
            places: poses of all cameras except the reference.
        """
        return np.concatenate([*lenses, *(place.parameters for place in places)])

    def block(self, camera: int) -> slice:
        """Return the slice of a camera's corners in a row."""
        return slice(camera * self.corners, (camera + 1) * self.corners)

    def project(self, parameters: FloatArray, points: FloatArray) -> Projected:
        """Project (V, C·M, 3) points in the frame of the reference camera to pixels divided by their noise."""
        shape = points.shape[:-1]
        pixels, by_point = np.empty((*shape, 2)), np.empty((*shape, 2, 3))
        by_parameter = np.zeros((*shape, 2, len(parameters)))
        for camera, (model, noise) in enumerate(zip(self.models, self.noise_px, strict=True)):
            block, lens, place = self.block(camera), self.lens_of(camera), self.place(parameters, camera)
            arms = points[:, block] @ place.rotation.T
            seen, by_lens, by_inside = model.project(parameters[lens], arms + place.translation)
            pixels[:, block], by_parameter[:, block, :, lens] = seen / noise, by_lens / noise
            by_inside = by_inside / noise
            by_point[:, block] = by_inside @ place.rotation
            if camera:
                at = self.place_of(camera)
                turn = np.stack(
                    [
                        by_inside[..., b] * arms[..., None, a] - by_inside[..., a] * arms[..., None, b]
                        for a, b in ((1, 2), (2, 0), (0, 1))
                    ],
                    axis=-1,
                )
                by_parameter[:, block, :, at.start : at.start + 3] = turn @ left_jacobian(parameters[at][:3])
                by_parameter[:, block, :, at.start + 3 : at.stop] = by_inside
        return pixels, by_parameter, by_point

    def faces(self, parameters: FloatArray, points: FloatArray) -> BoolArray:
        """Return which points, (V, C·M), their camera can project."""
        found = np.empty(points.shape[:-1], dtype=np.bool_)
        for camera, model in enumerate(self.models):
            block, place = self.block(camera), self.place(parameters, camera)
            inside = points[:, block] @ place.rotation.T + place.translation
            found[:, block] = model.faces(parameters[self.lens_of(camera)], inside)
        return found

    def is_possible(self, parameters: FloatArray) -> bool:
        """Return whether all focal lengths are positive."""
        return all(model.is_possible(parameters[self.lens_of(at)]) for at, model in enumerate(self.models))
