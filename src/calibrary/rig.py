"""Camera rigs: relative poses of rigidly mounted cameras, their uncertainty, and the entries that belong to a rig."""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

from calibrary.arrays import FloatArray, np
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.records import Meta, Record, require_declared
from calibrary.rotations import left_jacobian, rotation_matrix, rotation_vector

Vector: TypeAlias = tuple[float, float, float]
Name: TypeAlias = Annotated[str, Meta(min_length=1, max_length=100)]
SIZE = 6


class RigPose(Record):
    """Pose of a camera in its rig: x_camera = R x_reference + t.

    Attributes:
        rotation_deg: R as a rotation vector (axis times angle), in degrees.
        translation_mm: t in mm.
        covariance: covariance of a small rotation about the camera's x, y and z axes in degrees and of t in mm; the
            upper triangle row by row (21 numbers), with the variance factor applied; None when unknown.

    Raises:
        InputError: a number is not finite, a variance is negative, or the triangle does not have 21 elements.
    """

    rotation_deg: Vector
    translation_mm: Vector
    covariance: Annotated[tuple[float, ...], Meta(min_length=21, max_length=21)] | None = None

    def __post_init__(self) -> None:
        numbers = (*self.rotation_deg, *self.translation_mm, *(self.covariance or ()))
        if not all(map(math.isfinite, numbers)):
            raise InputError("a pose in a rig contains NaN or infinity, expected finite numbers")
        if self.covariance is not None:
            if len(self.covariance) != SIZE * (SIZE + 1) // 2:
                raise InputError(
                    f"the covariance of a pose has 21 numbers in its upper triangle, found {len(self.covariance)}"
                )
            if (np.diag(self.matrix_of_covariance) < 0).any():
                raise InputError("the covariance of a pose contains a negative variance")

    @classmethod
    def of(
        cls, rotation: FloatArray, translation_mm: FloatArray, covariance: FloatArray | None = None
    ) -> RigPose:
        """Make a pose from a (3, 3) rotation, (3,) mm and a (6, 6) covariance in degrees and mm."""
        rx, ry, rz = np.degrees(rotation_vector(rotation)).tolist()
        tx, ty, tz = np.asarray(translation_mm, dtype=np.float64).ravel().tolist()
        upper = covariance[np.triu_indices(SIZE)].tolist() if covariance is not None else None
        return cls(
            rotation_deg=(rx, ry, rz),
            translation_mm=(tx, ty, tz),
            covariance=tuple(upper) if upper is not None else None,
        )

    @property
    def rotation(self) -> FloatArray:
        """R, (3, 3)."""
        return rotation_matrix(np.radians(self.rotation_deg))

    @property
    def translation(self) -> FloatArray:
        """t, (3,) mm."""
        return np.array(self.translation_mm)

    @property
    def matrix_of_covariance(self) -> FloatArray:
        """Covariance, (6, 6), degrees and mm; zeros when unknown."""
        matrix = np.zeros((SIZE, SIZE))
        if self.covariance is not None:
            matrix[np.triu_indices(SIZE)] = self.covariance
            matrix = matrix + matrix.T - np.diag(np.diag(matrix))
        return matrix

    @property
    def rotation_std_deg(self) -> Vector | None:
        """Standard deviations of the rotation about the camera's axes, in degrees; None when unknown."""
        return self._std(0)

    @property
    def translation_std_mm(self) -> Vector | None:
        """Standard deviations of t, in mm; None when unknown."""
        return self._std(3)

    def _std(self, first: int) -> Vector | None:
        if self.covariance is None:
            return None
        variances: FloatArray = np.diag(self.matrix_of_covariance)
        x, y, z = np.sqrt(variances[first : first + 3]).tolist()
        return x, y, z

    @property
    def angle_deg(self) -> float:
        """Rotation angle of the camera relative to the reference, in degrees."""
        return float(np.linalg.norm(self.rotation_deg))

    @property
    def baseline_mm(self) -> float:
        """Distance between the two projection centres, in mm."""
        return float(np.linalg.norm(self.translation_mm))

    @property
    def baseline_std_mm(self) -> float | None:
        """Standard deviation of the baseline, in mm; None when unknown."""
        if self.covariance is None:
            return None
        along = self.translation / max(self.baseline_mm, 1e-12)
        return math.sqrt(max(float(along @ self.matrix_of_covariance[3:, 3:] @ along), 0.0))

    @property
    def centre_mm(self) -> FloatArray:
        """Projection centre of the camera in the frame of the reference camera, (3,) mm."""
        return np.asarray(-self.rotation.T @ self.translation)


def turn_jacobian(rotation: FloatArray) -> FloatArray:
    """Return the (6, 6) Jacobian from (rotation vector in rad, t) to (small rotation in degrees, t)."""
    matrix = np.eye(SIZE)
    matrix[:3, :3] = math.degrees(1.0) * left_jacobian(rotation_vector(rotation))
    return matrix


class RigCamera(Record):
    """One camera of a rig.

    Attributes:
        name: name in the rig.
        pose: pose relative to the reference camera; None for the reference itself.
        calibration: K and distortion; None if the source states none.
    """

    name: Name
    pose: RigPose | None = None
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        require_declared(self)


class Rig(Record):
    """A set of rigidly mounted cameras.

    Attributes:
        cameras: the cameras; exactly one of them, the reference, has no pose.

    Raises:
        InputError: two cameras have the same name, or the number of references is not one.
    """

    cameras: tuple[RigCamera, ...]

    def __post_init__(self) -> None:
        names = [camera.name for camera in self.cameras]
        if len(set(names)) != len(names):
            raise InputError(f"a rig names a camera twice: {', '.join(names)}")
        without = [camera.name for camera in self.cameras if camera.pose is None]
        if len(without) != 1:
            raise InputError(
                f"a rig has one reference camera, which has no pose; found {', '.join(without) or 'none'}"
            )

    @property
    def reference(self) -> str:
        """Name of the reference camera, which the poses refer to."""
        return next(camera.name for camera in self.cameras if camera.pose is None)

    def pose(self, name: str, before: str | None = None) -> tuple[FloatArray, FloatArray]:
        """Return R, (3, 3), and t, (3,) mm, of x_camera = R x_before + t; ``before`` defaults to the reference."""
        R, t = self._from_reference(name)
        if before is None:
            return R, t
        R0, t0 = self._from_reference(before)
        turn = R @ R0.T
        return turn, t - turn @ t0

    def _from_reference(self, name: str) -> tuple[FloatArray, FloatArray]:
        camera = next((one for one in self.cameras if one.name == name), None)
        if camera is None:
            raise InputError(
                f"no camera {name!r:.60} in the rig; it has {', '.join(one.name for one in self.cameras)}"
            )
        if camera.pose is None:
            return np.eye(3), np.zeros(3)
        return camera.pose.rotation, camera.pose.translation


class RigMember(Record):
    """Membership of a registry entry in a rig.

    Attributes:
        rig: identifier of the rig, the same for all its entries.
        camera: name of this camera in the rig.
        reference: name of the reference camera, which the pose refers to.
        pose: pose relative to the reference camera; None for the reference itself.
    """

    rig: Name
    camera: Name
    reference: Name
    pose: RigPose | None = None

    def __post_init__(self) -> None:
        require_declared(self)
        if (self.pose is None) is not (self.camera == self.reference):
            raise InputError(
                f"the camera {self.camera} of the rig {self.rig} has "
                + ("no pose" if self.pose is None else "a pose, and is the reference")
                + "; expected a pose for every camera but the reference"
            )
