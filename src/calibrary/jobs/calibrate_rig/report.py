"""JSON document of a calibrated rig."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.rig.verdict import RigLimits
from calibrary.calib.verdict import BoardVerdict
from calibrary.jobs.calibrate.report import CalibrateReport, report_of
from calibrary.records import Record
from calibrary.rig import Rig, RigPose
from calibrary.rotations import rotation_vector
from calibrary.validation import Finding

__all__ = ["CameraReport", "PoseDifference", "RigReport", "ShotReport", "difference", "rig_report"]


class ShotReport(Record):
    """One shot with views of two or more cameras.

    Attributes:
        name: of the shot.
        rms_px: reprojection error (RMS) by camera, with a single pose of the board for all cameras.
        alone_px: the same with the best pose for each camera.
        apart: cameras with a separate pose, because the shot contradicts the rig.
    """

    name: str
    rms_px: Mapping[str, float]
    alone_px: Mapping[str, float]
    apart: tuple[str, ...]


class PoseDifference(Record):
    """Difference of a camera's pose from that of another source.

    Attributes:
        camera: name of the camera.
        rotation_deg: angle of the rotation between the two.
        translation_mm: distance between the two translations; None if the source states none.
    """

    camera: str
    rotation_deg: float
    translation_mm: float | None


class CameraReport(Record):
    """One camera of the rig.

    Attributes:
        name: in the rig.
        result: its calibration; if the rig was solved, jointly with the other cameras.
    """

    name: str
    result: CalibrateReport


class RigReport(Record, tag_field="schema", tag="rig-calibration-result-1"):
    """A rig calibrated from frames of a board, with its verdict and the evidence for it.

    Attributes:
        verdict: determined by the most severe finding.
        findings: on the rig, most severe first; those on a camera are in its report.
        reference: the camera that defines the frame of the poses.
        poses: x_camera = R x_reference + t, by camera; empty if the rig was not solved.
        cross_std_px: by camera, standard deviation of a pixel predicted from the reference camera, at the
            distance of the boards and at infinity.
        kappa2: the variance factor of the poses.
        excess_px: increase of the residuals due to a single pose of the board for all cameras.
        shots: shots with views of two or more cameras.
        pairing: how the frames were paired, in words.
        stated: differences from the poses in the frames' metadata; empty if these state none.
        compared: differences from the poses of a file; empty if none was given.
        limits: the limits used for the verdict.
        cameras: calibration of each camera, reference first.
    """

    verdict: BoardVerdict
    findings: tuple[Finding, ...]
    reference: str
    poses: Mapping[str, RigPose]
    cross_std_px: Mapping[str, tuple[float | None, float | None]]
    kappa2: float | None
    excess_px: float | None
    shots: tuple[ShotReport, ...]
    pairing: str
    stated: tuple[PoseDifference, ...]
    compared: tuple[PoseDifference, ...]
    limits: RigLimits
    cameras: tuple[CameraReport, ...]


def difference(result: RigResult, other: Rig | None) -> tuple[PoseDifference, ...]:
    """Differences of a rig's poses from those of another source, matched by camera name, or else by order."""
    if other is None or not result.poses:
        return ()
    names, theirs = list(result.cameras), [camera.name for camera in other.cameras]
    pairs = dict(zip(names, names if set(names) <= set(theirs) else theirs, strict=False))
    has_place = any(camera.pose is not None and camera.pose.baseline_mm for camera in other.cameras)
    found = []
    for name, pose in result.poses.items():
        if name not in pairs or result.reference not in pairs:
            continue
        R, t = other.pose(pairs[name], before=pairs[result.reference])
        turn = float(np.degrees(np.linalg.norm(rotation_vector(pose.rotation @ R.T))))
        shift = float(np.linalg.norm(pose.translation - t)) if has_place else None
        found.append(PoseDifference(camera=name, rotation_deg=turn, translation_mm=shift))
    return tuple(found)


def rig_report(result: RigResult, pairing: str, stated: Rig | None, compared: Rig | None) -> RigReport:
    """Make the report of a rig."""
    evidence = result.evidence
    return RigReport(
        verdict=result.verdict,
        findings=result.findings,
        reference=result.reference,
        poses=result.poses,
        cross_std_px=evidence.cross_px or {},
        kappa2=evidence.kappa2,
        excess_px=evidence.excess_px,
        shots=tuple(
            ShotReport(name=one.name, rms_px=one.rms_px, alone_px=one.alone_px, apart=one.apart)
            for one in result.shots
        ),
        pairing=pairing,
        stated=difference(result, stated),
        compared=difference(result, compared),
        limits=result.limits,
        cameras=tuple(CameraReport(name=name, result=report_of(one)) for name, one in result.cameras.items()),
    )
