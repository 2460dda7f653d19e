"""What a calibration shows: what K is good for and why, its numbers with their uncertainty, and the views.

Of a rig it shows K of every camera, and every pose. The plots need what was detected in the images, which the record
does not hold; without it there are none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final, TypeAlias

from calibrary.calib.detection import Detections, NamedRemark
from calibrary.calib.result import ViewResult
from calibrary.calibration import Calibration, Quality
from calibrary.jobs.calibrate.page_plots import (
    board_plots,
    fit_plots,
    flight_plots,
    frame_plots,
    lens_plots,
    rig_picture,
    shot_errors,
    trust_plots,
)
from calibrary.jobs.calibrate.report import CalibrateReport
from calibrary.jobs.calibrate.rig_report import CameraReport, PoseDifference, RigReport
from calibrary.pages.plots import correlations as correlation_plot
from calibrary.pages.wording import SEVERITIES, count, rounded
from calibrary.parsers.rigs.micasense import relatives_of
from calibrary.probability import two_digits, whole_percent
from calibrary.provenance import facts, label
from calibrary.validation import Finding, Severity, Use
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Details,
    Figure,
    KeyValues,
    Note,
    Plots,
    Section,
    SideBySide,
    Table,
    Tone,
    View,
)

OUTCOMES: Final = {
    Use.FIXED: Badge("keep it fixed", Tone.GOOD),
    Use.START: Badge("start from it", Tone.CAUTION),
    Use.NONE: Badge("not usable", Tone.BAD),
}
LEADS: Final = {
    Use.FIXED: "a solver may keep it fixed, or start from it",
    Use.START: "a solver may start from it, and must not keep it fixed",
    Use.NONE: "no K was written; the corners can be solved again",
}
FLIGHT_REFUSED: Final = "no K was written; what to fly instead is above"
MOST_ROWS: Final = 300
Shot: TypeAlias = ViewResult | NamedRemark
"""A view, or an image that shows none."""
MOST_WORST: Final = 3
MOST_VIEWS: Final = 12
"""Most views that are named beside the answer."""

USES: Final = (
    Column("use", lambda one: one.words),
    Column("answer", lambda one: Badge("yes", Tone.GOOD) if one.holds else Badge("no", Tone.CAUTION)),
    Column("because", lambda one: one.why),
)
PARAMETERS: Final = (
    Column("parameter", lambda row: row[0]),
    Column("value", lambda row: row[1], numeric=True),
    Column("σ", lambda row: row[2], numeric=True),
    Column("σ × κ", lambda row: row[3], numeric=True),
)


def told(
    report: CalibrateReport | RigReport,
    detections: Detections | None = None,
    *,
    correlations: bool = False,
    files: tuple[str, ...] = (),
) -> View:
    """Describe a calibration of a camera or of a rig, refused or not.

    Args:
        report: the result.
        detections: what was found in the images of one camera, for the plots.
        correlations: whether to list the correlations of the parameters.
        files: what was written, in sentences.
    """
    lead, own = LEADS[report.verdict], tuple[tuple[str, str], ...]()
    if isinstance(report, RigReport):
        first, title = report.cameras[0].result, f"Rig of {len(report.cameras)} cameras"
        counted = f"{len(report.cameras)} cameras, {len(report.shots)} shots of {first.target} that two or more share, "
        counted += f"paired {report.pairing}"
        sections = _of_rig(report)
    else:
        first, title, counted = report, f"Calibration of {report.calibration.camera}", _counted(report)
        if report.flown is not None and report.verdict is Use.NONE:
            lead = FLIGHT_REFUSED
        own = facts(report.calibration.provenance, traced=False)
        sections = _of_camera(report, detections, correlations=correlations)
    return View(
        title=title,
        badge=OUTCOMES[report.verdict],
        lead=f"{report.verdict.value.upper()}: {counted}; {lead}",
        facts=own,
        sections=(*sections, *((Section(title="Written", blocks=files),) if files else ())),
        made_by=f"Made by {', '.join(f'{name} {version}' for name, version in first.versions.items())}.",
    )


def _counted(report: CalibrateReport) -> str:
    quality = report.calibration.quality or Quality()
    rms = f"{quality.rms_px:.3f} px" if quality.rms_px is not None else "unknown"
    used, every = sum(view.without is None for view in report.views), len(report.views) + len(report.skipped)
    return f"{used} of {every} {report.shots} of {report.target}, reprojection error (RMS) {rms}"


def _of_camera(
    report: CalibrateReport, detections: Detections | None, *, correlations: bool
) -> Iterator[Section]:
    uses = Table.of("What it is good for", report.uses.shown(report.asked.use), USES)
    verdict = (uses, *findings_blocks(report.findings, report.notes))
    yield Section(title="Verdict", anchor="verdict", blocks=verdict)
    yield Section(
        title="Parameters", anchor="parameters", blocks=tuple(_parameters(report, correlations=correlations))
    )
    held = "How the flight was flown" if report.flown is not None else "How the board was held"
    yield Section(
        title=held, anchor="held", blocks=(KeyValues(tuple(_measured(report))), *_held(report, detections))
    )
    yield Section(title=f"How the {report.shots} fit", anchor="fit", blocks=tuple(_fit(report, detections)))
    if detections is not None:
        trust = tuple(trust_plots(report, detections.observations))
        yield Section(title="How far to trust it", anchor="trust", blocks=trust)
    lens = (_models(report), Plots(partial(lens_plots, report.calibration)))
    yield Section(title="The lens", anchor="lens", blocks=lens, printed=False)
    if detections is not None and (frames := tuple(frame_plots(report, detections))):
        yield Section(title="Corners on frames", anchor="frames", blocks=(SideBySide(frames),), printed=False)
    origin = tuple(_origin(report, detections))
    yield Section(title="Made from", anchor="made-from", blocks=origin, printed=False)


def findings_blocks(findings: Sequence[Finding], notes: Sequence[str]) -> Iterator[Block]:
    """Yield what harms, then what is only noted."""
    if not findings:
        yield "No finding: every limit of the policy is kept."
    for finding in findings:
        if finding.severity is not Severity.NOTE:
            yield Note(
                text=f"{finding.rule}: {finding.message}.",
                action=finding.remedy,
                tone=SEVERITIES[finding.severity],
            )
    notes = [*(str(finding) for finding in findings if finding.severity is Severity.NOTE), *notes]
    if notes:
        yield Bullets(tuple(notes))


def _parameters(report: CalibrateReport, *, correlations: bool) -> Iterator[Block]:
    if report.verdict is Use.NONE:
        yield Details(summary="The numbers that were refused", blocks=tuple(_numbers(report)))
        return
    yield from _numbers(report)
    if correlations and report.calibration.quality is not None:
        yield from _correlations(report.calibration.quality)


def parameters(calibration: Calibration) -> Iterator[tuple[str, str, str, str]]:
    """Each parameter with its value, σ from the residuals, and σ times √(variance factor)."""
    quality = calibration.quality or Quality()
    inflated = math.sqrt(quality.inflation)
    for name, value in _values(calibration):
        std = quality.std.get(name)
        shown, sigma = rounded(value, std)
        # Digits according to the larger standard deviation, which is the one to use.
        yield name, shown, sigma, rounded(value, std * inflated)[1] if std is not None else "–"


def _numbers(report: CalibrateReport) -> Iterator[Block]:
    calibration, quality = report.calibration, report.calibration.quality
    table = Table.of(
        f"The {report.model.value} model; fx, fy, cx and cy in px", parameters(calibration), PARAMETERS
    )
    if quality is not None and quality.covariance is not None:
        yield SideBySide((table, Plots(partial(_correlation_plot, quality))))
    else:
        yield table
    yield (
        f"cx and cy count from the outer corner of the top-left pixel; OpenCV counts from that pixel's centre and has "
        f"({calibration.intrinsics.cx - 0.5:.2f}, {calibration.intrinsics.cy - 0.5:.2f})."
    )


def _correlation_plot(quality: Quality) -> Iterator[Figure]:
    if quality.covariance is not None:
        caption = (
            "Correlations: parameters near ± 1 can change together with hardly any change of the projection."
        )
        yield correlation_plot(quality.covariance, caption=caption)


def _correlations(quality: Quality) -> Iterator[Table]:
    """Lower triangle of the correlation matrix."""
    if quality.covariance is None:
        return
    names, R = quality.covariance.names, quality.covariance.correlation
    yield Table(
        caption="Correlations",
        columns=(Column("correlations"), *(Column(name, numeric=True, rank=1) for name in names[:-1])),
        rows=tuple(
            (name, *(f"{R[row, at]:+.2f}" if at < row else "" for at in range(len(names) - 1)))
            for row, name in enumerate(names)
        ),
    )


def _values(calibration: Calibration) -> list[tuple[str, float]]:
    K = calibration.intrinsics
    lens = calibration.distortion.shown if calibration.distortion is not None else {}
    known = set(calibration.quality.std) if calibration.quality is not None else set()
    return [
        *((name, getattr(K, name)) for name in ("fx", "fy", "cx", "cy")),
        *((name, value) for name, value in lens.items() if value or name in known),
    ]


def _measured(report: CalibrateReport) -> Iterator[tuple[str, Cell]]:
    """What the verdict is based on."""
    seen, quality, limits = report.geometry, report.calibration.quality or Quality(), report.limits
    if report.length_unit != "mm" and report.flown is None:
        yield (
            "scale",
            "unknown: the side of a square was not stated, so lengths are in squares (K does not need it)",
        )
    if report.date_origin is not None:
        yield "date", f"{report.calibration.provenance.date or 'unknown'}, {report.date_origin}"
    if report.candidates:
        yield "model", f"{report.model.value}; criterion against the best: {_tried(report)}"
    if quality.kappa2 is not None:
        yield (
            "variance factor κ²",
            f"{quality.kappa2:.2f} between halves of the {report.shots}"
            f"{': use σ × κ' if quality.inflation > 1 else ''}; to keep K fixed, up to {limits.kappa2_fixed:g}",
        )
    if worst := [*_worst(report)]:
        yield "largest errors", ", ".join(worst)
    yield from _warped(report)
    yield from _flown(report) if report.flown is not None else _posed(report)
    yield (
        "coverage",
        f"{seen.coverage.fraction:.0%} of the cells, {seen.coverage.reach:.0%} of the way to the corners",
    )
    if (proven := quality.proven) is not None:
        sigma = (
            f"{two_digits(proven.sigma_px)} px where it is proven, " if proven.sigma_px is not None else ""
        )
        place = "frame" if proven.circle_px is None else "image circle"
        yield "uncertainty", f"{sigma}at most {two_digits(proven.edge_px)} px anywhere in the {place}"
    yield "proven", f"{whole_percent(report.uses.share)}, within {report.uses.radius_px:.0f} px of the middle"


def _worst(report: CalibrateReport) -> Iterator[str]:
    """The used views that fit worst."""
    used = [view for view in report.views if view.without is None and view.rms_px is not None]
    for view in sorted(used, key=lambda one: -(one.rms_px or 0.0))[:MOST_WORST]:
        yield f"{view.name} {view.rms_px:.3f} px"


def _tried(report: CalibrateReport) -> str:
    least = min(one.criterion for one in report.candidates)
    return ", ".join(
        f"{one.model.value} {one.criterion - least:+.1f}" + (f" ({one.refused})" if one.refused else "")
        for one in report.candidates
    )


def _warped(report: CalibrateReport) -> Iterator[tuple[str, Cell]]:
    if report.warp is None:
        return
    digits = 2 if report.length_unit == "mm" else 4
    across, down = (f"{lift:+.{digits}f} {report.length_unit}" for lift in report.warp.lift)
    found = "solved for" if report.warp.kept else "not taken"
    F = report.warp.f if report.warp.f is not None else math.inf
    yield "board warp", f"{across} across, {down} down (F = {F:.1f}), {found}"


def _posed(report: CalibrateReport) -> Iterator[tuple[str, Cell]]:
    """How the board was held."""
    seen, unit = report.geometry, report.length_unit
    distance = (
        f"{seen.distance / 1000:.3g} m" if unit == "mm" else f"{seen.distance:.3g} {unit} (scale unknown)"
    )
    yield (
        "tilt",
        f"normals spread {seen.tilt_spread_deg:.0f}°, expected {report.limits.tilt_wanted_deg:g}°; roll spread "
        f"{seen.roll_spread_deg:.0f}°",
    )
    yield "distance", f"median {distance}, farthest ÷ nearest corner {seen.depth_ratio:.2f}"


def _flown(report: CalibrateReport) -> Iterator[tuple[str, Cell]]:
    """The geometry of a flight."""
    if (flown := report.flown) is None:
        return
    seen = flown.geometry
    if flown.chosen is not None:
        yield "images", flown.chosen
    yield (
        "flight",
        f"highest ÷ lowest image {seen.height_ratio:.2f}, half as high again is best; nine of ten look down within "
        f"{seen.tilt_deg:.0f}°, some at 30° are best; headings {seen.headings_deg:.0f}° apart, 90° is best; relief "
        f"{seen.relief:.1%} of the flying height",
    )
    yield (
        "systematic",
        "a tenth of a pixel of systematic error, in images reduced to 1600 px, may move fx by "
        f"{seen.focal_by_px / 10:.1%}",
    )
    if flown.fx_held is not None:
        yield "principal point", f"held in the middle of the image: fx {flown.fx_held:.2f} px"
    for one in flown.nuisances:
        yield "nuisance", one.words
    if flown.control is not None:
        yield "ground control", flown.control.words


def _held(report: CalibrateReport, detections: Detections | None) -> Iterator[Block]:
    if detections is None:
        return
    if report.flown is not None:
        yield from flight_plots(report.views, detections.observations)
    else:
        yield from board_plots(report, detections.observations)


class _Views:
    """The views of a report as rows; what was detected in them, if it is known, gives more columns."""

    def __init__(self, report: CalibrateReport, detections: Detections | None) -> None:
        self._report, views = report, detections.observations.views if detections is not None else ()
        self._seen = {view.name: view for view in views}
        self._remarks = {remark.name: remark.message for remark in report.remarks}
        shot = "image" if report.flown is not None else "frame"
        self.columns: Final = (
            Column(shot, lambda one: one.name),
            Column("state", self._state),
            Column("RMS (px)", self._rms, numeric=True, rank=1),
            Column(report.points, self._corners, numeric=True, rank=2),
            Column("edge width (px)", self._sharpness, numeric=True, rank=3),
            Column("remark", self.remark, below=""),
        )

    def _state(self, one: Shot) -> Badge:
        if isinstance(one, NamedRemark):
            return Badge(one.reason.value, Tone.BAD)
        without = one.without
        return Badge("counts", Tone.GOOD) if without is None else Badge(without.reason.value, Tone.CAUTION)

    def _rms(self, one: Shot) -> str:
        if isinstance(one, NamedRemark) or one.rms_px is None:
            return ""
        return f"{one.rms_px:.3f}"

    def _corners(self, one: Shot) -> str:
        given = self._seen.get(one.name)
        return str(len(given.ids)) if given is not None else ""

    def _sharpness(self, one: Shot) -> str:
        given = self._seen.get(one.name)
        if given is None or (width := given.sharpness_px) is None:
            return ""
        return f"{width:#.2g}" if abs(width) < 1 else f"{width:.2f}"

    def remark(self, one: Shot) -> str:
        """What is to be known of a view; nothing of most."""
        if isinstance(one, NamedRemark):
            return one.message
        if one.without is not None:
            return one.without.message
        out = f"{len(one.corners_out)} {self._report.points} rejected" if one.corners_out else ""
        return "; ".join(filter(None, (out, self._remarks.get(one.name))))


def _fit(report: CalibrateReport, detections: Detections | None) -> Iterator[Block]:
    """The views that are not used or have a remark, and behind a summary all of them."""
    views = _Views(report, detections)
    every: list[Shot] = [*report.views, *report.skipped]
    if noted := [one for one in every if views.remark(one)]:
        more = len(noted) - MOST_VIEWS
        named = f" of {len(noted)}" if more > 0 else ""
        yield Table.of(f"To be known of{named}", noted[:MOST_VIEWS], views.columns)
        if more > 0:
            yield f"{more} more have a remark."
    if detections is not None:
        by_view, *over_frame = fit_plots(report.views, detections.observations, report.points)
        yield by_view
        yield SideBySide(tuple(over_frame))
    table = Table.of("Each of them", every[:MOST_ROWS], views.columns)
    cut = (f"{len(every) - MOST_ROWS} more are in the JSON.",) if len(every) > MOST_ROWS else ()
    without = sum(not isinstance(one, ViewResult) or one.without is not None for one in every)
    shots = count(len(every), "image" if report.flown is not None else "frame")
    yield Details(summary=f"{shots}, {without} not used", blocks=(table, *cut))


def _models(report: CalibrateReport) -> Block:
    if not report.candidates:
        return f"The {report.model.value} model was asked for."
    least = min(candidate.criterion for candidate in report.candidates)
    return Table(
        caption="Lens models that were compared; each parameter more must lower n·ln(rss/n) by 5.4",
        columns=(
            Column("model"),
            Column("parameters", numeric=True),
            Column("RMS (px)", numeric=True),
            Column("criterion − best", numeric=True),
            Column("remark"),
        ),
        rows=tuple(
            (
                one.model.value,
                str(len(one.model.parameters)),
                f"{one.rms_px:.3f}",
                f"{one.criterion - least:.1f}",
                Badge("chosen", Tone.GOOD) if one.model is report.model else (one.refused or ""),
            )
            for one in report.candidates
        ),
    )


def _origin(report: CalibrateReport, detections: Detections | None) -> Iterator[Block]:
    made, key = report.calibration.provenance, report.calibration.camera
    noise = report.noise_px
    views = detections.observations.views if detections is not None else ()
    of_flight = report.flown is not None
    image, points = ("image", "points") if of_flight else ("frame", "corners")
    items = {
        "camera": str(key),
        "unit": f"serial number hashed to {key.serial}" if key.serial is not None else None,
        **dict(facts(made, traced=False)),
        label("date"): f"{made.date}, {report.date_origin}" if made.date is not None else report.date_origin,
        label("focus"): made.focus or f"not stated by the {image}s",
        "points" if of_flight else "board": report.board.described
        if report.board is not None
        else report.target,
        "corner noise": f"{noise:.3f} px by coordinate, from neighbours alone" if noise is not None else None,
        f"{points}' SHA-256": made.sha256,
    }
    yield KeyValues(tuple((name, value) for name, value in items.items() if value is not None))
    files = [view for view in views if view.sha256 is not None][:MOST_ROWS]
    if files:
        table = Table(
            caption="The images" if of_flight else "Frames with a view of the board",
            columns=(Column(image), Column("SHA-256")),
            rows=tuple((view.name, view.sha256 or "") for view in files),
        )
        yield Details(summary=f"Hashes of the {image}s", blocks=(table,))


def _of_rig(report: RigReport) -> Iterator[Section]:
    verdict = (_rig_lenses(report), *findings_blocks(report.findings, report.notes))
    yield Section(title="Verdict", anchor="verdict", blocks=verdict)
    if report.poses:
        poses: list[Block] = [Plots(lambda: [rig_picture(report)]), _poses(report), _predicted(report)]
        poses += [KeyValues(tuple(_rig_measured(report))), _relatives(report)]
        poses += [*_compared("what the frames' metadata state", report.stated)]
        poses += [*_compared("the file that was given", report.compared)]
        yield Section(title="Relative poses", anchor="poses", blocks=tuple(poses))
    if report.shots:
        shots = (Plots(lambda: [shot_errors(report)]), _shots(report))
        yield Section(title="How the shots fit", anchor="shots", blocks=shots, printed=False)
    yield Section(title="Made from", anchor="made-from", blocks=tuple(_rig_origin(report)), printed=False)


def _rig_measured(report: RigReport) -> Iterator[tuple[str, Cell]]:
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


def _rig_lenses(report: RigReport) -> Table:
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


def _rig_origin(report: RigReport) -> Iterator[Block]:
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
    return "–" if value is None or not math.isfinite(value) else two_digits(value)
