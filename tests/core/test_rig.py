"""Poses in a rig, and who may have one."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.errors import InputError
from calibrary.rig import RigMember, RigPose
from calibrary.rotations import rotation_matrix

TURN = rotation_matrix(np.radians([10.0, -5.0, 2.0]))


def test_a_pose_keeps_its_rotation_translation_and_covariance() -> None:
    spread = np.diag([1e-4, 2e-4, 3e-4, 0.1, 0.2, 0.3])
    spread[0, 5] = spread[5, 0] = 1e-3
    pose = RigPose.of(TURN, np.array([30.0, -1.0, 0.5]), spread)
    assert pose.rotation == pytest.approx(TURN, abs=1e-12)
    assert pose.translation == pytest.approx([30.0, -1.0, 0.5])
    assert pose.matrix_of_covariance == pytest.approx(spread)
    assert RigPose.of(TURN, np.zeros(3)).covariance is None


def test_every_camera_but_the_reference_has_a_pose() -> None:
    pose = RigPose.of(TURN, np.zeros(3))
    RigMember(rig="wing", camera="left", reference="right", pose=pose)
    RigMember(rig="wing", camera="right", reference="right")
    with pytest.raises(InputError, match="has no pose"):
        RigMember(rig="wing", camera="left", reference="right")
    with pytest.raises(InputError, match="has a pose, and is the reference"):
        RigMember(rig="wing", camera="right", reference="right", pose=pose)


@pytest.mark.parametrize("bad", [(np.nan, 0.0, 0.0), (0.0, np.inf, 0.0)])
def test_a_pose_that_is_no_number_is_refused(bad: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="NaN or infinity"):
        RigPose(rotation_deg=(0.0, 0.0, 0.0), translation_mm=bad)


def test_a_negative_variance_is_refused() -> None:
    with pytest.raises(InputError, match="negative variance"):
        RigPose.of(TURN, np.zeros(3), -np.eye(6))
