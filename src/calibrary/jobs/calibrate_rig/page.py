"""Page of a calibrated rig: verdict, picture of the rig, K of every camera, and every pose with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.jobs.calibrate_board.page import LEADS, OUTCOMES
from calibrary.jobs.calibrate_rig.figures import rig_picture, shot_errors
from calibrary.jobs.calibrate_rig.report import PoseDifference, RigReport
from calibrary.jobs.calibrate_rig.run import RigCollected
from calibrary.pages import (
    Badge,
    Block,
    Bullets,
    Column,
    Details,
    KeyValues,
    Note,
    Page,
    Section,
    Table,
    Tone,
)
from calibrary.pages.wording import SEVERITIES
from calibrary.parsers.rigs.micasense import relatives_of
from calibrary.validation import Severity

__all__ = ["rig_page"]

MOST_ROWS = 300


def rig_page(result: RigResult, collected: RigCollected, report: RigReport) -> Page:
    """Make the page of a rig, refused or not."""
    names = ", ".join(result.cameras)
    first = next(iter(result.cameras.values()))
    versions = ", ".join(f"{name} {version}" for name, version in first.versions.items())
    lead = LEADS[result.verdict] if result.verdict is not BoardVerdict.REFUSE else (
        "Nothing but this page and the corners was written."
    )  # fmt: skip
    return Page(
        title=f"Rig of {len(result.cameras)} cameras",
        badge=OUTCOMES[result.verdict],
        lead=f"{names}: {len(result.shots)} shots that two cameras or more share, of {first.observations.board}. "
        f"{lead}",
        sections=tuple(_sections(result, collected, report)),
        made_by=f"Made by {versions}.",
    )


def _sections(result: RigResult, collected: RigCollected, report: RigReport) -> Iterator[Section]:
    yield Section(title="Verdict", anchor="verdict", blocks=tuple(_verdict(result, collected)))
    if result.poses:
        poses: list[Block] = [rig_picture(result), _poses(result), _predicted(result), _relatives(result)]
        poses += [*_compared("what the frames' metadata state", report.stated)]
        poses += [*_compared("the file that was given", report.compared)]
        yield Section(title="Relative poses", anchor="poses", blocks=tuple(poses))
    yield Section(title="Cameras", anchor="cameras", blocks=(_lenses(result),))
    if result.shots:
        yield Section(
            title="How the shots fit",
            anchor="shots",
            blocks=(shot_errors(result), _shots(result)),
            printed=False,
        )
    yield Section(
        title="Made from", anchor="made-from", blocks=tuple(_origin(result, collected)), printed=False
    )


def _verdict(result: RigResult, collected: RigCollected) -> Iterator[Block]:
    if not result.findings:
        yield "No finding: every limit of the policy is kept."
    for finding in result.findings:
        if finding.severity is not Severity.NOTE:
            yield Note(
                text=f"{finding.rule}: {finding.message}.",
                action=finding.remedy,
                tone=SEVERITIES[finding.severity],
            )
    notes = [str(finding) for finding in result.findings if finding.severity is Severity.NOTE]
    if notes or collected.notes:
        yield Bullets((*notes, *collected.notes))


def _poses(result: RigResult) -> Table:
    rows = [_pose_row(result, name) for name in result.poses]
    return Table(
        caption=f"x_camera = R x_{result.reference} + t. Rotation is axis × angle; σ of it is of a turn about the "
        "camera's axes. All σ include the variance factor.",
        columns=(
            Column("camera"),
            Column("rotation (°)", numeric=True),
            Column("σ (°)", numeric=True),
            Column("translation (mm)", numeric=True),
            Column("σ (mm)", numeric=True),
            Column("baseline (mm)", numeric=True),
        ),
        rows=tuple(rows),
    )


def _predicted(result: RigResult) -> Table:
    return Table(
        caption=f"σ of the pixel in which a camera sees what {result.reference} sees in a pixel of its own",
        columns=(
            Column("camera"),
            Column("at the boards' distance (px)", numeric=True),
            Column("far away (px)", numeric=True),
        ),
        rows=tuple(
            (name, _number(near), _number(far))
            for name, (near, far) in (result.evidence.cross_px or {}).items()
        ),
    )


def _pose_row(result: RigResult, name: str) -> tuple[str, ...]:
    pose = result.poses[name]
    spread = f" ± {pose.baseline_std_mm:.2g}" if pose.baseline_std_mm is not None else ""
    return (
        name,
        _triple(pose.rotation_deg, 4),
        _triple(pose.rotation_std_deg, 4),
        _triple(pose.translation_mm, 3),
        _triple(pose.translation_std_mm, 3),
        f"{pose.baseline_mm:.3f}{spread}",
    )


def _relatives(result: RigResult) -> Details:
    """The poses in the conventions of other programs."""
    rows = [
        (name, _triple(relatives_of(pose.rotation.T), 4), _triple(tuple(pose.centre_mm.tolist()), 3))
        for name, pose in result.poses.items()
    ]
    table = Table(
        caption="RigRelatives: Rx·Ry·Rz turns the camera's frame into the reference's, as MicaSense writes it",
        columns=(
            Column("camera"),
            Column("RigRelatives (°)", numeric=True),
            Column("projection centre before the reference (mm)", numeric=True),
        ),
        rows=tuple(rows),
    )
    return Details(summary="As MicaSense counts", blocks=(table,))


def _compared(source: str, found: tuple[PoseDifference, ...]) -> Iterator[Block]:
    if found:
        yield Table(
            caption=f"Beside {source}",
            columns=(
                Column("camera"),
                Column("turned by (°)", numeric=True),
                Column("translation differs by (mm)", numeric=True),
            ),
            rows=tuple(
                (
                    one.camera,
                    f"{one.rotation_deg:.4f}",
                    "not stated" if one.translation_mm is None else f"{one.translation_mm:.2f}",
                )
                for one in found
            ),
        )


def _lenses(result: RigResult) -> Table:
    rows: list[tuple[str | Badge, ...]] = []
    for name, one in result.cameras.items():
        K, quality = one.calibration.intrinsics, one.calibration.quality
        wider = math.sqrt(quality.inflation) if quality is not None else 1.0
        std = quality.std if quality is not None else {}
        values = [
            f"{getattr(K, key):.2f} ± {std[key] * wider:.2g}" if key in std else f"{getattr(K, key):.2f}"
            for key in ("fx", "fy", "cx", "cy")
        ]
        rms = quality.rms_px if quality is not None else None
        views = str(quality.views) if quality is not None else ""
        state = OUTCOMES[one.verdict]
        said = "; ".join(finding.rule for finding in one.findings if finding.severity is not Severity.NOTE)
        rows.append((name, state, *values, one.model.value, _number(rms), views, said))
    return Table(
        caption="K of each camera in px from the outer corner of its top-left pixel, with σ × κ",
        columns=(
            Column("camera"),
            Column("verdict"),
            *(Column(key, numeric=True) for key in ("fx", "fy", "cx", "cy")),
            Column("lens model"),
            Column("RMS (px)", numeric=True),
            Column("views", numeric=True),
            Column("findings"),
        ),
        rows=tuple(rows),
    )


def _shots(result: RigResult) -> Details:
    rows: list[tuple[str | Badge, ...]] = []
    for shot in result.shots[:MOST_ROWS]:
        told = ", ".join(f"{name} {rms:.3f} ({shot.alone_px[name]:.3f})" for name, rms in shot.rms_px.items())
        state = (
            Badge(f"{', '.join(shot.apart)} apart", Tone.CAUTION)
            if shot.apart
            else Badge("counts", Tone.GOOD)
        )
        rows.append((shot.name, state, told))
    table = Table(
        caption="Reprojection error (RMS, px) with one pose for all cameras, and in brackets with a pose of its own",
        columns=(Column("shot"), Column("state"), Column("cameras")),
        rows=tuple(rows),
    )
    return Details(summary=f"{len(result.shots)} shots", blocks=(table,))


def _origin(result: RigResult, collected: RigCollected) -> Iterator[Block]:
    evidence = result.evidence
    items = [("frames were paired", collected.how)]
    items += [
        (
            f"{name} ({one.calibration.camera})",
            f"{len(one.observations.views)} views of the board, {one.calibration.provenance.date}",
        )
        for name, one in result.cameras.items()
    ]
    if evidence.kappa2 is not None:
        items.append(("variance factor of the poses", f"{evidence.kappa2:.2f}"))
    if evidence.excess_px is not None:
        items.append(("one pose for all cameras adds", f"{evidence.excess_px:.3f} px"))
    yield KeyValues(tuple(items))
    rejected = [
        (name, remark.name, remark.remark.text)
        for name, one in collected.cameras.items()
        for remark in one.rejected
    ]
    if rejected:
        table = Table(
            caption="Frames without a usable view of the board",
            columns=(Column("camera"), Column("frame"), Column("reason")),
            rows=tuple(rejected[:MOST_ROWS]),
        )
        yield Details(summary=f"{len(rejected)} frames not used", blocks=(table,))


def _triple(values: tuple[float, ...] | None, decimals: int) -> str:
    if values is None:
        return "–"
    return "  ".join(f"{value:.{decimals}f}".replace("-", "−") for value in values)


def _number(value: float | None) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:.2f}"
