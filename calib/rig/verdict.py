"""Verdict on a rig, in the terms of the verdict on a single camera."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from calibrary.calib.rig.causes import CAMERA_MOVED
from calibrary.calib.verdict_rules import at_least, at_most, graver_first
from calibrary.errors import first_of
from calibrary.records import Record
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


class RigEvidence(Struct, frozen=True, kw_only=True):
    """Measurements that the verdict on a rig is based on; values that were not solved are None.

    Attributes:
        verdicts: what each camera is good for.
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
        shots: number of shots of two or more cameras.
    """

    verdicts: Mapping[str, Use]
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
    shots: int = 0


def is_loose(evidence: RigEvidence, limits: RigLimits = RIG_LIMITS) -> bool:
    """Return whether one pose for all cameras fits so badly that no lens should be fitted to it."""
    return any(finding.severity is Severity.ERROR for finding in _rigidity(evidence, limits))


def judge_rig(evidence: RigEvidence, limits: RigLimits = RIG_LIMITS) -> tuple[Finding, ...]:
    """Check all measurements against their limits; return the findings, most severe first."""
    return graver_first(
        (
            *_cameras(evidence),
            *_ties(evidence, limits),
            *evidence.mispaired,
            *_rigidity(evidence, limits),
            *_shots(evidence, limits),
            *_precision(evidence, limits),
        )
    )


def _cameras(e: RigEvidence) -> Iterator[Finding]:
    for use, severity in (
        (Use.NONE, Severity.ERROR),
        (Use.START, Severity.UNPROVEN),
    ):
        names = [name for name, found in e.verdicts.items() if found is use]
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


def _ties(e: RigEvidence, limits: RigLimits) -> Iterator[Finding]:
    if e.untied:
        yield Finding(
            rule="not-tied",
            severity=Severity.ERROR,
            measured=0,
            limit=limits.shared_needed,
            message=f"{first_of(e.untied, 4)} saw the board in no shot together with the other cameras",
            remedy="hold the board where the frames overlap, or correct the pairing of the frames",
        )
    for name, count in e.shared.items():
        yield from at_least(
            "few-shared-shots",
            count,
            (limits.shared_needed, limits.shared_wanted),
            f"{name} shares {count} shots with another camera, need {limits.shared_wanted}",
            "take more with the board in both frames",
        )


def _rigidity(e: RigEvidence, limits: RigLimits) -> Iterator[Finding]:
    yield from e.troubles
    moved = any(one.rule == CAMERA_MOVED for one in e.troubles)
    if e.excess_px is None or e.noise_px is None or e.rigid_p is None or moved:
        return
    over = e.excess_px / max(e.noise_px, 1e-9)
    if e.rigid_p < LEVEL:
        yield from at_most(
            "not-simultaneous",
            over,
            (limits.excess_wanted, limits.excess_needed),
            f"one pose of the board for all cameras adds {e.excess_px:.2f} px to the residuals, {over:.0f} "
            "times the noise, and differently in every shot: the cameras did not fire together while board or rig "
            "moved, or one of them is loose",
            "put rig and board on stands and let the shutter wait; check the trigger and the mounts",
        )


def _shots(e: RigEvidence, limits: RigLimits) -> Iterator[Finding]:
    if not e.apart:
        return
    shots = list(dict.fromkeys(shot for shot, _ in e.apart))
    share = len(shots) / max(e.shots + len(shots), 1)
    where = f"shot{'s' * (len(shots) > 1)} {first_of(shots, 4)}"
    yield Finding(
        rule="shots-apart",
        severity=Severity.UNPROVEN if share > limits.apart_wanted else Severity.NOTE,
        measured=share,
        limit=limits.apart_wanted,
        message=f"in {where} the cameras contradict the rig; these views serve the lenses only",
        remedy="something moved between the exposures: look at these frames",
    )


def _precision(e: RigEvidence, limits: RigLimits) -> Iterator[Finding]:
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
                (limits.cross_wanted_px, limits.cross_needed_px),
                f"a pixel that the reference camera predicts for {name} has a σ of {worst:.2f} px, need "
                f"{limits.cross_wanted_px:g} px",
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
            (limits.kappa2_wanted, limits.kappa2_needed),
            f"the variance factor of the relative poses is {e.kappa2:.1f}; to be kept fixed "
            f"at most {limits.kappa2_wanted:g} is needed. The standard deviations that are stated are wider by "
            f"{math.sqrt(e.kappa2):.1f} for it",
            "fasten the cameras, mount the board on glass or aluminium, use a tripod",
        )
