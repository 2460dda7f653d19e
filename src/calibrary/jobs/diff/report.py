"""JSON documents of comparisons (schemas/diff-1.schema.json, schemas/fleet-diff-1.schema.json)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from calibrary.calibration import Calibration, ImageSize
from calibrary.jobs.diff.advice import Use
from calibrary.jobs.diff.comparison import ChangeVerdict, Comparison, Ground, Numbers, Parameter
from calibrary.jobs.diff.fleet import Change
from calibrary.jobs.diff.kinds import Kind, Structural
from calibrary.jobs.diff.noise import Basis
from calibrary.policy import Policy
from calibrary.records import Meta, Record

__all__ = ["DiffReport", "FleetDiffReport", "diff_report", "fleet_diff_report"]


class Side(Record):
    """One of the two calibrations.

    Attributes:
        label: file name, or KEY@REV.
        calibration: as given.
    """

    label: str
    calibration: Calibration


class Projection(Record):
    """Difference of the projections of points at infinity, after the best rotation of the camera.

    Attributes:
        rms_px, max_px: over the whole image.
        centre_rms_px: over the central part of the image.
        rotation_deg: angle of the rotation that was removed.
        unknown_share: fraction of the image without a result, because only one of the two has a projection or
            the uncertainty of the difference exceeds the limit.
    """

    rms_px: Annotated[float, Meta(ge=0)]
    max_px: Annotated[float, Meta(ge=0)]
    centre_rms_px: Annotated[float, Meta(ge=0)]
    rotation_deg: Annotated[float, Meta(ge=0)]
    unknown_share: Annotated[float, Meta(ge=0, le=1)]


class Significance(Record):
    """Significance of the difference.

    Attributes:
        basis: basis of the uncertainty of the difference.
        p: probability of a difference this large from noise alone; null if no uncertainty may be assumed.
        explains: whether noise explains every part of the difference that matters; null if p is null.
        spread_a, spread_b: source of the standard deviations of a and b.
    """

    basis: Basis
    p: Annotated[float, Meta(ge=0, le=1)] | None
    explains: bool | None
    spread_a: str
    spread_b: str


class Difference(Record):
    """Numerical difference at a common image size.

    Attributes:
        image_size: common width and height in px.
        parameters: all parameters of both.
        matters: whether the difference exceeds the policy's limits, regardless of noise.
        focal_change: relative change of fx or fy, whichever is larger.
        scale_change: relative change of the image scale: the part of the focal length's change that the
            distortion does not compensate.
        projection: difference in pixels.
        ground: effect on a map.
        significance: comparison with noise.
        distortion_compared: false if one of the distortions is unknown and only K was compared.
    """

    image_size: ImageSize
    parameters: tuple[Parameter, ...]
    matters: bool
    focal_change: float
    scale_change: float
    projection: Projection
    ground: Ground
    significance: Significance
    distortion_compared: bool


class DiffReport(Record, tag_field="schema", tag="calibrary/diff-1"):
    """Output of ``calibrary diff A B --json``.

    Attributes:
        verdict: of the comparison.
        alarm: whether the difference needs attention; the exit code is then 1.
        reasons: for the verdict, in sentences.
        warnings: limits of the comparison, in sentences.
        use: which of the two to use.
        advice: what to do, in one sentence.
        structural: structural changes.
        steps: operations that converted both to a common image size; empty if the sizes were equal.
        a, b: the two calibrations; b is the later one.
        numbers: null if no conversion to a common image size exists.
    """

    verdict: ChangeVerdict
    alarm: bool
    reasons: Annotated[tuple[str, ...], Meta(min_length=1)]
    warnings: tuple[str, ...]
    use: Use
    advice: str
    structural: tuple[Structural, ...]
    steps: tuple[str, ...]
    a: Side
    b: Side
    numbers: Difference | None


class EntryChange(Record):
    """Change of one entry.

    Attributes:
        id: of the entry.
        verdict: null if there is nothing to compare with, or the two cannot be compared.
        alarm: whether the change needs attention.
        reasons: for the verdict, in sentences.
        advice: what to do; null if they were not compared.
        structural: structural changes.
        focal_change: relative change of fx or fy, whichever is larger.
        rms_px, max_px: RMS and maximum of the difference of the projections.
    """

    id: str
    verdict: ChangeVerdict | None
    alarm: bool
    reasons: Annotated[tuple[str, ...], Meta(min_length=1)]
    advice: str | None
    structural: tuple[Kind, ...]
    focal_change: float | None
    rms_px: Annotated[float, Meta(ge=0)] | None
    max_px: Annotated[float, Meta(ge=0)] | None


class FleetDiffReport(Record, tag_field="schema", tag="calibrary/fleet-diff-1"):
    """Output of ``calibrary diff --since`` and ``--firmware`` with ``--json``.

    Attributes:
        changes: worst first.
    """

    changes: tuple[EntryChange, ...]


def diff_report(comparison: Comparison, labels: tuple[str, str], altitude_m: float) -> DiffReport:
    """Make the report of one comparison.

    Args:
        comparison: of two calibrations.
        labels: their names.
        altitude_m: altitude above ground, for the effect on a map.
    """
    numbers = comparison.numbers
    return DiffReport(
        verdict=comparison.verdict,
        alarm=comparison.alarm,
        reasons=comparison.reasons,
        warnings=comparison.warnings,
        use=comparison.use,
        advice=comparison.advice,
        structural=comparison.structural,
        steps=comparison.steps,
        a=Side(label=labels[0], calibration=comparison.a),
        b=Side(label=labels[1], calibration=comparison.b),
        numbers=_difference(numbers, altitude_m, comparison.policy) if numbers is not None else None,
    )


def fleet_diff_report(changes: Sequence[Change]) -> FleetDiffReport:
    """Make the report of all changed entries."""
    return FleetDiffReport(changes=tuple(map(_entry_change, changes)))


def _difference(numbers: Numbers, altitude_m: float, policy: Policy) -> Difference:
    seen, found = numbers.difference, numbers.significance
    return Difference(
        image_size=numbers.a.intrinsics.image_size,
        parameters=numbers.parameters,
        matters=numbers.matters(policy),
        focal_change=numbers.focal_change,
        scale_change=numbers.scale.change,
        projection=Projection(
            rms_px=seen.rms_px,
            max_px=seen.max_px,
            centre_rms_px=seen.centre_rms_px,
            rotation_deg=seen.rotation_deg,
            unknown_share=float(numbers.unknown(policy).mean()),
        ),
        ground=numbers.ground(altitude_m),
        significance=Significance(
            basis=numbers.basis,
            p=found.p if found is not None else None,
            explains=found.explains if found is not None else None,
            spread_a=numbers.spread_a.source,
            spread_b=numbers.spread_b.source,
        ),
        distortion_compared=numbers.lens_compared,
    )


def _entry_change(change: Change) -> EntryChange:
    found = change.comparison
    numbers = found.numbers if found is not None else None
    return EntryChange(
        id=change.id,
        verdict=found.verdict if found is not None else None,
        alarm=change.alarm,
        reasons=found.reasons if found is not None else (change.reason or "",),
        advice=found.advice if found is not None else None,
        structural=tuple(one.kind for one in found.structural) if found is not None else (),
        focal_change=numbers.focal_change if numbers is not None else None,
        rms_px=numbers.difference.rms_px if numbers is not None else None,
        max_px=numbers.difference.max_px if numbers is not None else None,
    )
