"""Verdict on a rig, in the terms of the verdict on a single camera."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from calibrary.calib.result import CalibrationResult
from calibrary.calib.rig.causes import CAMERA_MOVED
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.verdict_rules import at_least, at_most, graver_first
from calibrary.errors import first_of
from calibrary.records import Record
from calibrary.rig import RigPose
from calibrary.validation import Finding, Severity, Use


class RigLimits(Record):
    """Limits of what is kept fixed (``wanted``) and of what is a start (``needed``).

    Attributes:
        shared_needed, shared_wanted: number of shots that link a camera to another one.
        cross_wanted_px, cross_needed_px: σ of the pixel predicted from one camera for another, with the variance
            factor, px.
        kappa2_wanted, kappa2_needed: largest variance factor of the poses.
        excess_wanted, excess_needed: residuals added by one pose for all cameras, relative to the noise of a corner.
        apart_wanted: fraction of the shots that contradict the rig.
    """

    shared_needed: int = 3
    shared_wanted: int = 8
    cross_wanted_px: float = 0.5
    cross_needed_px: float = 5.0
    kappa2_wanted: float = 2.0
    kappa2_needed: float = 100.0
    excess_wanted: float = 3.0
    excess_needed: float = 20.0
    apart_wanted: float = 0.15


RIG_LIMITS: Final = RigLimits()
LEVEL: Final = 1e-4


class ShotResult(Record):
    """One shot with views of two or more cameras.

    Attributes:
        name: name of the shot.
        rms_px: reprojection error (RMS) by camera, with one pose of the board for all cameras.
        alone_px: the same with the best pose for each camera.
        apart: cameras with a separate pose, because the shot contradicts the rig.
    """

    name: str
    rms_px: Mapping[str, float]
    alone_px: Mapping[str, float]
    apart: tuple[str, ...]


class RigResult(Struct, frozen=True, kw_only=True, eq=False):
    """A rig calibration with the measurements that its verdict is based on; values that were not solved are None.

    Attributes:
        cameras: calibration of each camera, the reference first; if the rig was not solved, from each camera alone.
        poses: poses relative to the reference camera, with covariance; empty if the rig was not solved.
        observations: input of the calibration.
        shared: number of shots that link each camera except the reference to another one.
        untied: cameras without common shots with the others.
        mispaired: of cameras for which the shots agree on no pose.
        cross_px: σ of the predicted pixel by camera, px: at the distance of the boards, and far away.
        kappa2: variance factor of the poses.
        excess_px: residuals added by one pose for all cameras, RMS, px.
        noise_px: noise of a corner of the noisiest camera, px.
        rigid_p: probability that noise alone makes one pose for all cameras fit this much worse.
        troubles: causes that were identified.
        apart: (shot, camera) with a separate pose.
        joint: number of shots with one pose for two or more cameras.
        shots: shots of two or more cameras.
    """

    cameras: Mapping[str, CalibrationResult] = {}
    poses: Mapping[str, RigPose] = {}
    observations: RigObservations
    shared: Mapping[str, int]
    untied: Sequence[str] = ()
    mispaired: Sequence[Finding] = ()
    cross_px: Mapping[str, tuple[float | None, float | None]] | None = None
    kappa2: float | None = None
    excess_px: float | None = None
    noise_px: float | None = None
    rigid_p: float | None = None
    troubles: Sequence[Finding] = ()
    apart: Sequence[tuple[str, str]] = ()
    joint: int = 0
    shots: tuple[ShotResult, ...] = ()

    @property
    def is_loose(self) -> bool:
        """Whether one pose for all cameras fits so badly that no lens should be fitted to it."""
        return any(finding.severity is Severity.ERROR for finding in _rigidity(self))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Problems of the rig, most severe first; those of a camera are in its calibration. All rules are evaluated."""
        return graver_first(
            (
                *_cameras(self),
                *_ties(self),
                *self.mispaired,
                *_rigidity(self),
                *_shots(self),
                *_precision(self),
            )
        )

    @property
    def verdict(self) -> Use:
        """Verdict on the rig, decided by the worst finding."""
        return Use.of(self.findings)

    @property
    def reference(self) -> str:
        """Name of the reference camera, which the poses refer to."""
        return next(iter(self.cameras))


def _cameras(e: RigResult) -> Iterator[Finding]:
    for use, severity in (
        (Use.NONE, Severity.ERROR),
        (Use.START, Severity.UNPROVEN),
    ):
        names = [name for name, one in e.cameras.items() if one.verdict is use]
        if names:
            yield Finding(
                rule=f"camera-{use.value}",
                severity=severity,
                measured=len(names),
                limit=0,
                message=f"{first_of(names, 4)}: the calibration is {_SAID[use]}, and the rig cannot be better",
                remedy="see the findings of these cameras",
            )


_SAID: Final = {Use.NONE: "refused", Use.START: "a start only"}


def _ties(e: RigResult) -> Iterator[Finding]:
    if e.untied:
        yield Finding(
            rule="not-tied",
            severity=Severity.ERROR,
            measured=0,
            limit=RIG_LIMITS.shared_needed,
            message=f"{first_of(e.untied, 4)} saw the board in no shot together with the other cameras",
            remedy="hold the board where the frames overlap, or correct the pairing of the frames",
        )
    for name, count in e.shared.items():
        yield from at_least(
            "few-shared-shots",
            count,
            (RIG_LIMITS.shared_needed, RIG_LIMITS.shared_wanted),
            f"{name} shares {count} shots with another camera, need {RIG_LIMITS.shared_wanted}",
            "take more with the board in both frames",
        )


def _rigidity(e: RigResult) -> Iterator[Finding]:
    yield from e.troubles
    moved = any(one.rule == CAMERA_MOVED for one in e.troubles)
    if e.excess_px is None or e.noise_px is None or e.rigid_p is None or moved:
        return
    over = e.excess_px / max(e.noise_px, 1e-9)
    if e.rigid_p < LEVEL:
        yield from at_most(
            "not-simultaneous",
            over,
            (RIG_LIMITS.excess_wanted, RIG_LIMITS.excess_needed),
            f"one pose of the board for all cameras adds {e.excess_px:.2f} px to the residuals, {over:.0f} "
            "times the noise, and differently in every shot: the cameras did not fire together while board or rig "
            "moved, or one of them is loose",
            "put rig and board on stands and let the shutter wait; check the trigger and the mounts",
        )


def _shots(e: RigResult) -> Iterator[Finding]:
    if not e.apart:
        return
    shots = list(dict.fromkeys(shot for shot, _ in e.apart))
    share = len(shots) / max(e.joint + len(shots), 1)
    where = f"shot{'s' * (len(shots) > 1)} {first_of(shots, 4)}"
    yield Finding(
        rule="shots-apart",
        severity=Severity.UNPROVEN if share > RIG_LIMITS.apart_wanted else Severity.NOTE,
        measured=share,
        limit=RIG_LIMITS.apart_wanted,
        message=f"in {where} the cameras contradict the rig; these views serve the lenses only",
        remedy="something moved between the exposures: look at these frames",
    )


def _precision(e: RigResult) -> Iterator[Finding]:
    for name, pair in (e.cross_px or {}).items():
        worst = max((value for value in pair if value is not None), default=None)
        if worst is None:
            yield Finding(
                rule="no-common-view",
                severity=Severity.UNPROVEN,
                message=f"{name} and the reference camera see nothing in common at the distance of the boards",
                remedy="hold the board where the frames overlap",
            )
        else:
            yield from at_most(
                "uncertain-pose",
                worst,
                (RIG_LIMITS.cross_wanted_px, RIG_LIMITS.cross_needed_px),
                f"a pixel that the reference camera predicts for {name} has a σ of {worst:.2f} px, need "
                f"{RIG_LIMITS.cross_wanted_px:g} px",
                "take more shots that both see, at several distances and all over the frames",
            )
    if e.cross_px is None:
        return
    if e.kappa2 is None:
        yield Finding(
            rule="no-variance-factor",
            severity=Severity.UNPROVEN,
            message="too few shots to compare one half with the other",
            remedy="take more",
        )
    else:
        yield from at_most(
            "unstable-places",
            e.kappa2,
            (RIG_LIMITS.kappa2_wanted, RIG_LIMITS.kappa2_needed),
            f"the variance factor of the relative poses is {e.kappa2:.1f}; to be kept fixed "
            f"at most {RIG_LIMITS.kappa2_wanted:g} is needed. The standard deviations that are stated are wider by "
            f"{math.sqrt(e.kappa2):.1f} for it",
            "fasten the cameras, mount the board on glass or aluminium, use a tripod",
        )
