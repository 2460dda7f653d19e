"""Page of a calibration: the verdict with its reasons, all numbers with their standard deviations, and plots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from calibrary.calib.detection import Detections
from calibrary.calib.result import Flown
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.jobs.calibrate.page_plots import (
    board_plots,
    fit_plots,
    flight_plots,
    frame_plots,
    lens_plots,
    trust_plots,
)
from calibrary.jobs.calibrate.report import CalibrateReport
from calibrary.pages.plots import correlations
from calibrary.pages.wording import SEVERITIES, rounded
from calibrary.probability import whole_percent
from calibrary.provenance import facts, label
from calibrary.validation import Finding, Severity
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Column,
    Details,
    KeyValues,
    Note,
    Section,
    SideBySide,
    Table,
    Tone,
    View,
)

OUTCOMES = {
    BoardVerdict.PASS: Badge("keep it fixed", Tone.GOOD),
    BoardVerdict.PROVISIONAL: Badge("start from it", Tone.CAUTION),
    BoardVerdict.REFUSE: Badge("not usable", Tone.BAD),
}
FLIGHT_REFUSED = "No K was written; what to fly instead is below."
LEADS = {
    BoardVerdict.PASS: "A solver may keep it fixed, or start from it.",
    BoardVerdict.PROVISIONAL: "A solver may start from it, and must not keep it fixed.",
    BoardVerdict.REFUSE: "No K was written; the corners can be solved again.",
}
MOST_ROWS = 300


def calibration_page(report: CalibrateReport, detections: Detections) -> View:
    """Make the page of a calibration, refused or not."""
    quality, used = report.calibration.quality, [view for view in report.views if view.without is None]
    rms = f"{quality.rms_px:.2f} px" if quality is not None and quality.rms_px is not None else "unknown"
    shown = len(report.views) + len(report.skipped)
    refused_flight = report.flown is not None and report.verdict is BoardVerdict.REFUSE
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    return View(
        title=f"Calibration of {report.calibration.camera}",
        badge=OUTCOMES[report.verdict],
        lead=f"From {len(used)} of {shown} {report.shots} of {report.target}, reprojection error (RMS) "
        f"{rms}. {FLIGHT_REFUSED if refused_flight else LEADS[report.verdict]}",
        facts=facts(report.calibration.provenance, traced=False),
        sections=tuple(_sections(report, detections)),
        made_by=f"Made by {versions}.",
    )


def _sections(report: CalibrateReport, detections: Detections) -> Iterator[Section]:
    observations = detections.observations
    verdict = (_uses(report), *findings_blocks(report.findings, report.notes))
    yield Section(title="Verdict", anchor="verdict", blocks=verdict)
    yield Section(title="Parameters", anchor="parameters", blocks=tuple(_parameters(report)))
    yield Section(
        title=f"How the {report.shots} fit",
        anchor="fit",
        blocks=(*fit_plots(report.views, observations, report.points), _views(report, detections)),
        printed=False,
    )
    if report.flown is not None:
        flown = (*_flown(report.flown), *flight_plots(report.views, observations))
        yield Section(title="How the flight was flown", anchor="flown", blocks=flown, printed=False)
    else:
        yield Section(
            title="How the board was held",
            anchor="held",
            blocks=(_geometry_facts(report), *board_plots(report, observations)),
            printed=False,
        )
    yield Section(
        title="How far to trust it", anchor="trust", blocks=tuple(trust_plots(report, observations))
    )
    yield Section(
        title="The lens",
        anchor="lens",
        blocks=(_models(report), *lens_plots(report.calibration)),
        printed=False,
    )
    if frames := tuple(frame_plots(report, detections)):
        yield Section(title="Corners on frames", anchor="frames", blocks=(SideBySide(frames),), printed=False)
    yield Section(
        title="Made from", anchor="made-from", blocks=tuple(_origin(report, detections)), printed=False
    )


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


def _uses(report: CalibrateReport) -> Block:
    return Table(
        caption="What it is good for",
        columns=(Column("use"), Column("answer"), Column("because")),
        rows=tuple(
            (one.words, Badge("yes", Tone.GOOD) if one.holds else Badge("no", Tone.CAUTION), one.why)
            for one in report.uses.shown(report.asked.use)
        ),
    )


def _parameters(report: CalibrateReport) -> Iterator[Block]:
    if report.verdict is BoardVerdict.REFUSE:
        yield Details(summary="The numbers that were refused", blocks=tuple(_numbers(report)))
    else:
        yield from _numbers(report)


def _numbers(report: CalibrateReport) -> Iterator[Block]:
    calibration, quality = report.calibration, report.calibration.quality
    std = quality.std if quality is not None else {}
    inflated = math.sqrt(quality.inflation) if quality is not None else 1.0
    rows = []
    for name, value in _values(calibration):
        shown, sigma = rounded(value, std.get(name))
        # Digits according to the larger standard deviation, which is the one to use.
        wide = rounded(value, std[name] * inflated)[1] if name in std else "–"
        rows.append((name, shown, sigma, wide))
    table = Table(
        caption=f"The {report.model.value} model; fx, fy, cx and cy in px",
        columns=(
            Column("parameter"),
            Column("value", numeric=True),
            Column("σ", numeric=True),
            Column("σ × κ", numeric=True),
        ),
        rows=tuple(rows),
    )
    if quality is not None and quality.covariance is not None:
        caption = (
            "Correlations: parameters near ± 1 can change together with hardly any change of the projection."
        )
        yield SideBySide((table, correlations(quality.covariance, caption=caption)))
    else:
        yield table
    K = calibration.intrinsics
    yield (
        f"cx and cy count from the outer corner of the top-left pixel, so the middle of the frame is "
        f"({K.image_size[0] / 2:g}, {K.image_size[1] / 2:g}); OpenCV counts from that pixel's centre and has "
        f"({K.cx - 0.5:.2f}, {K.cy - 0.5:.2f})."
    )
    if quality is not None and quality.kappa2 is not None:
        yield (
            f"The variance factor κ² is {quality.kappa2:.2f}: halves of the {report.shots} differ by that many times "
            "the variance they state. "
            + (
                f"So σ, which only knows the residuals, is too small by a factor of {inflated:.2f}: use σ × κ."
                if inflated > 1
                else "It is not above 1, so σ stands as it is."
            )
        )


def _values(calibration: Calibration) -> list[tuple[str, float]]:
    K = calibration.intrinsics
    lens = calibration.distortion.shown if calibration.distortion is not None else {}
    known = set(calibration.quality.std) if calibration.quality is not None else set()
    return [
        *((name, getattr(K, name)) for name in ("fx", "fy", "cx", "cy")),
        *((name, value) for name, value in lens.items() if value or name in known),
    ]


def _views(report: CalibrateReport, detections: Detections) -> Details:
    remarks = {remark.name: remark.message for remark in report.remarks}
    seen = {view.name: view for view in detections.observations.views}
    of_flight = report.flown is not None
    rows: list[tuple[str | Badge, ...]] = []
    for view in report.views:
        given = seen.get(view.name)
        why = view.without.message if view.without is not None else remarks.get(view.name, "")
        if view.corners_out and not why:
            why = f"{len(view.corners_out)} {'points' if of_flight else 'corners'} rejected"
        rows.append(
            (
                view.name,
                Badge("counts", Tone.GOOD)
                if view.without is None
                else Badge(view.without.reason.value, Tone.CAUTION),
                _short(view.rms_px),
                str(len(given.ids)) if given is not None else "–",
                _short(given.sharpness_px) if given is not None else "–",
                why,
            )
        )
    rows += [
        (one.name, Badge(one.reason.value, Tone.BAD), "–", "–", "–", one.message) for one in report.skipped
    ]
    table = Table(
        caption="Every image that was chosen" if of_flight else "Every frame that was given",
        columns=(
            Column("image" if of_flight else "frame"),
            Column("state"),
            Column("RMS (px)", numeric=True),
            Column("points" if of_flight else "corners", numeric=True),
            Column("edge width (px)", numeric=True),
            Column("remark"),
        ),
        rows=tuple(rows[:MOST_ROWS]),
    )
    more = (f"{len(rows) - MOST_ROWS} more are in the JSON.",) if len(rows) > MOST_ROWS else ()
    without = sum(view.without is not None for view in report.views) + len(report.skipped)
    images = "images" if of_flight else "frames"
    return Details(summary=f"{len(rows)} {images}, {without} not used", blocks=(table, *more))


def _geometry_facts(report: CalibrateReport) -> KeyValues:
    seen, limits = report.geometry, report.limits
    return KeyValues(
        (
            ("normals spread", f"{seen.tilt_spread_deg:.1f}°, expected {limits.tilt_wanted_deg:g}°"),
            ("roll spread", f"{seen.roll_spread_deg:.0f}°"),
            ("farthest ÷ nearest corner", f"{seen.depth_ratio:.2f}"),
            ("median distance", _distance(report)),
            ("cells with a corner", f"{seen.coverage.fraction:.0%}"),
            ("reach towards the frame's corners", f"{seen.coverage.reach:.0%}"),
            (
                "proven",
                f"{whole_percent(report.uses.share)}, within {report.uses.radius_px:.0f} px of the middle",
            ),
        )
    )


def _flown(flown: Flown) -> Iterator[Block]:
    seen = flown.geometry
    held = f"{flown.fx_held:.2f} px" if flown.fx_held is not None else "not tried"
    chosen = (("images", flown.chosen),) if flown.chosen is not None else ()
    yield KeyValues(
        (
            *chosen,
            ("highest ÷ lowest image", f"{seen.height_ratio:.2f}; half as high again is best"),
            ("nine of ten look down within", f"{seen.tilt_deg:.0f}°; some at 30° are best"),
            ("headings", f"{seen.headings_deg:.0f}° apart; 90° is best"),
            ("relief", f"{seen.relief:.1%} of the flying height"),
            (
                "0.1 px of systematic error",
                f"may move fx by {seen.focal_by_px / 10:.1%} (in images reduced to 1600 px)",
            ),
            ("fx with the principal point in the middle", held),
        )
    )
    if flown.nuisances:
        yield (
            "What shifted the images besides the lens: "
            + "; ".join(one.words for one in flown.nuisances)
            + "."
        )
    if flown.control is not None:
        yield f"Ground control: {flown.control.words}."


def _distance(report: CalibrateReport) -> str:
    distance, unit = report.geometry.distance, report.length_unit
    return f"{distance / 1000:.3g} m" if unit == "mm" else f"{distance:.3g} {unit} (scale unknown)"


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


def _origin(report: CalibrateReport, detections: Detections) -> Iterator[Block]:
    made, key = report.calibration.provenance, report.calibration.camera
    noise, views = report.noise_px, detections.observations.views
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


def _short(value: float | None) -> str:
    """Format with two significant digits, and at least two decimals."""
    return "–" if value is None else f"{value:#.2g}" if abs(value) < 1 else f"{value:.2f}"
