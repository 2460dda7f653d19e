"""What a comparison reports, as JSON documents (schemas/diff-1.schema.json, schemas/fleet-diff-1.schema.json)."""

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
    """One of the two.

    Attributes:
        label: the file's name, or KEY@REV.
        calibration: as it was given.
    """

    label: str
    calibration: Calibration


class Projection(Record):
    """Difference of what both see at infinity, the camera free to turn.

    Attributes:
        rms_px, max_px: over the whole frame.
        centre_rms_px: over the middle of the frame.
        rotation_deg: how far the camera turned, which is taken out.
        unknown_share: of the frame, where only one of the two projects or the difference is uncertain by more than the
            limit: no agreement is shown there.
    """

    rms_px: Annotated[float, Meta(ge=0)]
    max_px: Annotated[float, Meta(ge=0)]
    centre_rms_px: Annotated[float, Meta(ge=0)]
    rotation_deg: Annotated[float, Meta(ge=0)]
    unknown_share: Annotated[float, Meta(ge=0, le=1)]


class Significance(Record):
    """The difference against its uncertainty.

    Attributes:
        basis: how the uncertainty of the difference is known.
        p: chance of a difference this large from noise alone; null where no uncertainty may be assumed.
        explains: whether noise explains all of the difference that matters; null as p.
        spread_a, spread_b: how the standard deviations of a and b are known.
    """

    basis: Basis
    p: Annotated[float, Meta(ge=0, le=1)] | None
    explains: bool | None
    spread_a: str
    spread_b: str


class Difference(Record):
    """The numbers, once both are in one frame.

    Attributes:
        image_size: width and height in px of the frame that both were brought to.
        parameters: every number of both.
        matters: whether it is beyond the policy's limits, whatever the noise.
        focal_change: of fx or fy, whichever is larger, as a share.
        scale_change: of the image scale, as a share of f: what of the focal length's change the distortion does not
            make up for.
        projection: in pixels.
        ground: on a map.
        significance: against noise.
        distortion_compared: false where one of the two distortions is unknown and K alone was compared.
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
    """What ``calibrary diff A B --json`` prints.

    Attributes:
        verdict: what the comparison comes to.
        alarm: whether it needs attention; then the exit code is 1.
        reasons: in sentences.
        warnings: what the comparison cannot say, in sentences.
        use: which of the two to use.
        advice: what to do, in one sentence.
        structural: changes of kind.
        steps: what brought both to one frame; empty where the frames were the same.
        a, b: the two, b the later one.
        numbers: null where nothing brings both to one frame.
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
    """What became of one entry.

    Attributes:
        id: of the entry.
        verdict: null where there is nothing to compare with, or the two cannot be compared.
        alarm: whether it needs attention.
        reasons: in sentences.
        advice: what to do; null where they were not compared.
        structural: changes of kind.
        focal_change: of fx or fy, whichever is larger, as a share.
        rms_px, max_px: of the difference of the projections.
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
    """What ``calibrary diff --since`` and ``--firmware`` print with ``--json``.

    Attributes:
        changes: worst first.
    """

    changes: tuple[EntryChange, ...]


def diff_report(comparison: Comparison, labels: tuple[str, str], altitude_m: float) -> DiffReport:
    """One comparison, with the two calibrations as they were given.

    Args:
        comparison: of the two.
        labels: what they are called.
        altitude_m: above ground, of the map that the difference is stated on.
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
    """Every entry that changed."""
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
