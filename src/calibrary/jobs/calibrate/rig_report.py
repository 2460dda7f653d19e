"""Result of a rig's calibration, as ``--json`` prints it (schemas/rig-calibration-result-2.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calibrary.calib.rig.verdict import RIG_LIMITS, RigLimits, RigResult, ShotResult
from calibrary.calib.verdict import AskedUse
from calibrary.calibration import Calibration
from calibrary.errors import CalibrationError, InputError
from calibrary.jobs.calibrate.outputs import Encode
from calibrary.jobs.calibrate.report import Asked, CalibrateReport
from calibrary.jobs.calibrate.rig import RigDetections
from calibrary.parsers.rigs import encode_rig, format_of_name
from calibrary.records import Record, replace
from calibrary.registry.entry import Entry
from calibrary.rig import Rig, RigCamera, RigMember, RigPose
from calibrary.rotations import rotation_vector
from calibrary.validation import Finding, Use


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


class RigReport(Record, tag_field="schema", tag="rig-calibration-result-2"):
    """A rig calibrated from frames of a board, with its verdict and the evidence for it.

    Attributes:
        verdict: determined by the most severe finding.
        findings: on the rig, most severe first; those on a camera are in its result.
        notes: remarks on the frames.
        unwritten: why the rig was not written into another program's file; None if it was, or was not asked for.
        name: of the rig, for its entries; None if not stated.
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

    verdict: Use
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    unwritten: str | None
    name: str | None
    reference: str
    poses: Mapping[str, RigPose]
    cross_std_px: Mapping[str, tuple[float | None, float | None]]
    kappa2: float | None
    excess_px: float | None
    shots: tuple[ShotResult, ...]
    pairing: str
    stated: tuple[PoseDifference, ...]
    compared: tuple[PoseDifference, ...]
    limits: RigLimits
    cameras: tuple[CameraReport, ...]

    @property
    def is_good(self) -> bool:
        """Whether the rig, and K of every camera, holds for the use that was asked for."""
        is_start = self.cameras[0].result.asked.use is AskedUse.START
        holds = self.verdict is not Use.NONE if is_start else self.verdict is Use.FIXED
        return holds and all(one.result.is_good for one in self.cameras)

    @property
    def calibrations(self) -> dict[str, Calibration]:
        """K and distortion by camera name, the reference first."""
        return {one.name: one.result.calibration for one in self.cameras}

    @property
    def rig(self) -> Rig:
        """The cameras with their poses, for :func:`calibrary.parsers.rigs.write_rig`.

        Raises:
            CalibrationError: the rig was not solved.
        """
        if len(self.poses) + 1 != len(self.cameras):
            raise CalibrationError("the rig was not solved; its findings say why")
        return Rig(
            cameras=tuple(
                RigCamera(name=name, pose=self.poses.get(name), calibration=calibration)
                for name, calibration in self.calibrations.items()
            )
        )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The registry entries of the rig, for :meth:`calibrary.Fleet.propose_entries`.

        Raises:
            InputError: the rig is refused or has no name, or make and model of a camera are unknown.
        """
        if self.verdict is Use.NONE:
            raise InputError("a rig that was refused becomes no entries; its report says what to do")
        if self.name is None:
            raise InputError("entries of a rig name it; state rig_name", place="--rig-name")
        entries = [
            replace(
                one.result.entry,
                rig=RigMember(
                    rig=self.name, camera=one.name, reference=self.reference, pose=self.poses.get(one.name)
                ),
            )
            for one in self.cameras
        ]
        ids = [entry.id for entry in entries]
        if len(set(ids)) < len(ids):
            raise InputError(
                f"two cameras of the rig would have one entry, {ids[0]}; expected names that distinguish them"
            )
        return tuple(entries)


def rig_report(
    result: RigResult, detections: RigDetections, asked: Asked, *, compared: Rig | None, name: str | None
) -> RigReport:
    """Make the report of a solved rig."""
    return RigReport(
        verdict=result.verdict,
        findings=result.findings,
        notes=detections.notes,
        unwritten=None,
        name=name,
        reference=result.reference,
        poses=result.poses,
        cross_std_px=result.cross_px or {},
        kappa2=result.kappa2,
        excess_px=result.excess_px,
        shots=result.shots,
        pairing=detections.how,
        stated=_difference(result, detections.stated),
        compared=_difference(result, compared),
        limits=RIG_LIMITS,
        cameras=tuple(
            CameraReport(name=camera, result=CalibrateReport.of(one, detections.cameras[camera], asked))
            for camera, one in result.cameras.items()
        ),
    )


def encoder(to: str | None, file: Path) -> Encode[RigReport]:
    """Return what writes a rig in a format, or in that of the file's name.

    Raises:
        InputError: no format fits the name.
    """
    form = to or format_of_name(file.name)
    return lambda report, name: (encode_rig(report.rig, form, name), report)


def _difference(result: RigResult, other: Rig | None) -> tuple[PoseDifference, ...]:
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
