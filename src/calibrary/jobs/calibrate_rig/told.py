"""What a calibrated rig shows: the verdict, K of every camera, and every pose with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Quality
from calibrary.jobs.calibrate.told import LEADS, OUTCOMES, findings_blocks, made_with
from calibrary.jobs.calibrate_rig.report import CameraReport, PoseDifference, RigReport
from calibrary.pages.palette import Colour
from calibrary.pages.plots import Axis, bars
from calibrary.pages.plots.canvas import draw
from calibrary.parsers.rigs.micasense import relatives_of
from calibrary.probability import two_digits
from calibrary.provenance import facts
from calibrary.validation import Severity
from calibrary.view import (
    Badge,
    Block,
    Cell,
    Column,
    Details,
    Figure,
    KeyValues,
    Plots,
    Section,
    Table,
    Tone,
    View,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

MOST_ROWS = 300


def told(report: RigReport, *, files: tuple[str, ...] = ()) -> View:
    """Describe a rig, refused or not.

    Args:
        report: the result.
        files: what was written, in sentences.
    """
    first = report.cameras[0].result
    return View(
        title=f"Rig of {len(report.cameras)} cameras",
        badge=OUTCOMES[report.verdict],
        lead=f"{report.verdict.value.upper()}: {len(report.cameras)} cameras, {len(report.shots)} shots "
        f"of {first.target} that two or more share, paired {report.pairing}; {LEADS[report.verdict]}",
        sections=tuple(_sections(report, files)),
        made_by=made_with(first),
    )


def _sections(report: RigReport, files: tuple[str, ...]) -> Iterator[Section]:
    verdict = (_lenses(report), *findings_blocks(report.findings, report.notes))
    yield Section(title="Verdict", anchor="verdict", blocks=verdict)
    if report.poses:
        poses: list[Block] = [Plots(lambda: [_rig_picture(report)]), _poses(report), _predicted(report)]
        poses += [KeyValues(tuple(_measured(report))), _relatives(report)]
        poses += [*_compared("what the frames' metadata state", report.stated)]
        poses += [*_compared("the file that was given", report.compared)]
        yield Section(title="Relative poses", anchor="poses", blocks=tuple(poses))
    if report.shots:
        shots = (Plots(lambda: [_shot_errors(report)]), _shots(report))
        yield Section(title="How the shots fit", anchor="shots", blocks=shots, printed=False)
    yield Section(title="Made from", anchor="made-from", blocks=tuple(_origin(report)), printed=False)
    if files:
        yield Section(title="Written", blocks=files)


def _measured(report: RigReport) -> Iterator[tuple[str, Cell]]:
    if report.kappa2 is not None:
        yield "variance factor of the poses", f"{report.kappa2:.2f} between halves of the shots"
    if report.excess_px is not None:
        yield "one pose for all cameras", f"adds {report.excess_px:.3f} px to the residuals"


def _poses(report: RigReport) -> Table:
    rows = [_pose_row(report, name) for name in report.poses]
    return Table(
        caption=f"x_camera = R x_{report.reference} + t. Rotation is axis × angle; σ of it is of a turn about the "
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


def _predicted(report: RigReport) -> Table:
    return Table(
        caption=f"σ of the pixel in which a camera sees what {report.reference} sees in a pixel of its own",
        columns=(
            Column("camera"),
            Column("at the boards' distance (px)", numeric=True),
            Column("far away (px)", numeric=True),
        ),
        rows=tuple((name, _two(near), _two(far)) for name, (near, far) in report.cross_std_px.items()),
    )


def _pose_row(report: RigReport, name: str) -> tuple[str, ...]:
    pose = report.poses[name]
    spread = f" ± {two_digits(pose.baseline_std_mm)}" if pose.baseline_std_mm is not None else ""
    return (
        name,
        _triple(pose.rotation_deg, 4),
        _triple(pose.rotation_std_deg, 4),
        _triple(pose.translation_mm, 3),
        _triple(pose.translation_std_mm, 3),
        f"{pose.baseline_mm:.3f}{spread}",
    )


def _relatives(report: RigReport) -> Details:
    """The poses in the conventions of other programs."""
    rows = [
        (name, _triple(relatives_of(pose.rotation.T), 4), _triple(tuple(pose.centre_mm.tolist()), 3))
        for name, pose in report.poses.items()
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


def _lenses(report: RigReport) -> Table:
    return Table.of(
        "K of each camera in px from the outer corner of its top-left pixel, with σ × κ",
        report.cameras,
        LENSES,
    )


def _number_of(key: str, camera: CameraReport) -> str:
    K, quality = camera.result.calibration.intrinsics, camera.result.calibration.quality or Quality()
    sigma = f" ± {two_digits(quality.std[key] * math.sqrt(quality.inflation))}" if key in quality.std else ""
    return f"{getattr(K, key):.2f}{sigma}"


def _reasons(camera: CameraReport) -> str:
    return "; ".join(one.rule for one in camera.result.findings if one.severity is not Severity.NOTE)


LENSES: Final = (
    Column("camera", lambda one: one.name),
    Column("verdict", lambda one: OUTCOMES[one.result.verdict]),
    *(Column(key, partial(_number_of, key), numeric=True) for key in ("fx", "fy", "cx", "cy")),
    Column("lens model", lambda one: one.result.model.value, rank=3),
    Column(
        "RMS (px)",
        lambda one: f"{(one.result.calibration.quality or Quality()).rms_px or math.nan:.3f}",
        numeric=True,
        rank=1,
    ),
    Column(
        "views", lambda one: str((one.result.calibration.quality or Quality()).views), numeric=True, rank=2
    ),
    Column("findings", _reasons, below=""),
)


def _shots(report: RigReport) -> Details:
    rows: list[tuple[str | Badge, ...]] = []
    for shot in report.shots[:MOST_ROWS]:
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
    return Details(summary=f"{len(report.shots)} shots", blocks=(table,))


def _origin(report: RigReport) -> Iterator[Block]:
    items = [("frames were paired", report.pairing)]
    items += [
        (
            f"{one.name} ({one.result.calibration.camera})",
            f"{len(one.result.views)} views of the board"
            + "".join(
                f", {said} {text}" for said, text in facts(one.result.calibration.provenance, traced=False)
            ),
        )
        for one in report.cameras
    ]
    yield KeyValues(tuple(items))
    rejected = [
        (one.name, remark.name, remark.message) for one in report.cameras for remark in one.result.skipped
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


def _two(value: float | None) -> str:
    return "–" if value is None or not np.isfinite(value) else two_digits(value)


REACH: Final = 0.6
"""Distance at which the outline of a camera's view is drawn, relative to the distance between cameras."""
MOST_BARS: Final = 120


def _rig_picture(report: RigReport) -> Figure:
    """The cameras from above and from the front, with their fields of view."""
    centres = {report.reference: np.zeros(3)} | {name: pose.centre_mm for name, pose in report.poses.items()}
    turns = {report.reference: np.eye(3)} | {name: pose.rotation for name, pose in report.poses.items()}
    spread = max(float(np.ptp(np.array(list(centres.values())), axis=0).max()), 1.0)
    outlines = {
        name: _outline(calibration, centres[name], turns[name], REACH * spread)
        for name, calibration in report.calibrations.items()
    }

    def paint(canvas: Canvas) -> None:
        above, front = canvas.subplots(1, 2)
        for axes, (a, b), labels in (
            (above, (0, 2), ("x, to the right (mm)", "z, ahead (mm)")),
            (front, (0, 1), ("x, to the right (mm)", "y, down (mm)")),
        ):
            for name, corners in outlines.items():
                own = Colour.SECOND if name == report.reference else Colour.ACCENT
                centre = centres[name]
                for corner in corners:
                    axes.plot(
                        [centre[a], corner[a]],
                        [centre[b], corner[b]],
                        color=Colour.MUTED.light,
                        linewidth=0.7,
                    )
                closed = np.concatenate([corners, corners[:1]])
                axes.plot(closed[:, a], closed[:, b], color=own.light, linewidth=1.2)
                axes.plot(centre[a], centre[b], "o", color=own.light, markersize=6)
                axes.annotate(
                    name, (centre[a], centre[b]), xytext=(5, -11), textcoords="offset points", color=own.light
                )
            axes.set_xlabel(labels[0])
            axes.set_ylabel(labels[1])
            axes.set_aspect("equal", adjustable="datalim")
            axes.margins(0.12)
            axes.grid()
        front.invert_yaxis()

    distances = ", ".join(
        f"{name} {np.linalg.norm(at):.1f} mm" for name, at in centres.items() if name != report.reference
    )
    return Figure(
        svg=draw(paint, width=900, height=380),
        alt=f"Plan and front view of the rig; distance from {report.reference}: {distances}.",
        caption=f"The rig from above and from behind, in the frame of {report.reference}: projection centres, and what "
        "each camera sees at a short distance.",
    )


def _outline(
    calibration: Calibration, centre: FloatArray, rotation: FloatArray, reach_mm: float
) -> FloatArray:
    """Corners (4, 3) of a camera's view in mm, in the frame of the reference camera."""
    width, height = calibration.intrinsics.image_size
    rays = calibration.unproject([[0, 0], [width, 0], [width, height], [0, height]])
    middle = calibration.unproject([[width / 2, height / 2]])
    # An image corner without a ray, as outside a fisheye's circle, is moved towards the centre.
    rays = np.where(np.isfinite(rays), rays, np.where(np.isfinite(middle), middle, (0.0, 0.0, 1.0)))
    along = rays / np.maximum(rays[:, 2:], 0.3) * reach_mm
    return np.asarray(along @ rotation + centre)


def _shot_errors(report: RigReport) -> Figure:
    """Reprojection error of each shot over all its cameras, with a single pose of the board."""
    shots = sorted(report.shots, key=lambda shot: -max(shot.rms_px.values()))[:MOST_BARS]
    kept = {shot.name for shot in shots}
    ordered = [shot for shot in report.shots if shot.name in kept]
    return bars(
        [float(np.sqrt(np.mean(np.square(list(shot.rms_px.values()))))) for shot in ordered],
        labels=[f"{shot.name} (apart)" if shot.apart else shot.name for shot in ordered],
        axis=Axis("reprojection error (RMS)", "px"),
        caption="How far corners are from where the rig puts them, by shot, over all cameras. A shot that stands out "
        "was taken while something moved, or its frames do not belong together.",
    )
