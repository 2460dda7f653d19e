"""A calibrated rig as a JSON document."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.rig.verdict import RigLimits
from calibrary.calib.verdict import BoardVerdict
from calibrary.jobs.calibrate_board.report import CalibrateReport, report_of
from calibrary.records import Record
from calibrary.rig import Rig, RigPose
from calibrary.rotations import rotation_vector
from calibrary.validation import Finding

__all__ = ["CameraReport", "PoseDifference", "RigReport", "ShotReport", "difference", "rig_report"]


class ShotReport(Record):
    """One shot that two cameras or more share.

    Attributes:
        name: of the shot.
        rms_px: by camera, of its corners with one pose of the board for all cameras.
        alone_px: by camera, with a pose that fits this camera best.
        apart: the cameras whose view has a pose of its own, since the shot contradicts the rig.
    """

    name: str
    rms_px: Mapping[str, float]
    alone_px: Mapping[str, float]
    apart: tuple[str, ...]


class PoseDifference(Record):
    """A camera's pose beside the pose that another source states.

    Attributes:
        camera: its name.
        rotation_deg: the turn between the two.
        translation_mm: the distance between the two translations; None where the source states no translation.
    """

    camera: str
    rotation_deg: float
    translation_mm: float | None


class CameraReport(Record):
    """One camera of the rig.

    Attributes:
        name: in the rig.
        result: its calibration; of a rig that was solved, together with the others.
    """

    name: str
    result: CalibrateReport


class RigReport(Record, tag_field="schema", tag="rig-calibration-result-1"):
    """A rig from frames of a board, with its verdict and all that speaks for and against it.

    Attributes:
        verdict: the worst finding decides.
        findings: on the rig, the most severe first; what is said of a camera is in its report.
        reference: the camera that the poses are counted from.
        poses: x_camera = R x_reference + t, by camera; empty where the rig was not solved.
        cross_std_px: by camera: σ of a pixel that the reference camera predicts for it, at the distance of the boards
            and far away.
        kappa2: the variance factor of the poses.
        excess_px: what one pose of the board for all cameras adds to the residuals.
        shots: those that two cameras or more share.
        pairing: how frames were paired, in words.
        stated: how far the poses are from those that the frames' metadata state; empty where they state none.
        compared: how far the poses are from those of a file; empty where there is none.
        limits: what the rig was judged by.
        cameras: each camera's calibration, the reference's first.
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
    """How far a rig's poses are from another source's, by the names of the cameras, or else by their order."""
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
    """The whole result."""
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
