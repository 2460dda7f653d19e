"""The run as a page to show a colleague: every camera, its K, what the evidence says, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version

from calibrary.calibration import Calibration, Grade
from calibrary.evidence.estimate import SourceEstimate
from calibrary.jobs.extract.circumstances import circumstances
from calibrary.jobs.extract.extraction import CameraReport, Extraction
from calibrary.jobs.extract.fallback import Fallback
from calibrary.jobs.extract.hand_off import seed_command
from calibrary.jobs.extract.outputs import Outputs
from calibrary.jobs.extract.states import StateDocument
from calibrary.pages import (
    Badge,
    Block,
    Bullets,
    Cell,
    Code,
    Column,
    Details,
    Figure,
    KeyValues,
    Link,
    Note,
    Page,
    Section,
    SideBySide,
    Table,
    Tone,
)
from calibrary.pages.plots import Axis, Band, Interval, Role, distortion_map, intervals, radial_curve
from calibrary.policy import Policy
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.validation import UNPROVEN_LEGEND, Report, Severity, Verdict

__all__ = ["outcome_page"]

VERDICTS = {Verdict.VALID: Tone.GOOD, Verdict.UNPROVEN: Tone.CAUTION, Verdict.REJECTED: Tone.BAD}
SEVERITIES = {
    Severity.PASS: Tone.GOOD,
    Severity.NOTE: Tone.NEUTRAL,
    Severity.WARNING: Tone.NEUTRAL,
    Severity.UNPROVEN: Tone.CAUTION,
    Severity.ERROR: Tone.BAD,
}
PX = Axis("fx", "px")

MOST_DRAWN = 40
"""Cameras with plots; a fleet has fewer, and a page of more would be slow to make and to open."""

MOST_CAMERAS = 500
MOST_NAMES = 200
"""Images named of one state, and of those set aside; the report lists all."""

MOST_STATES = 20


def outcome_page(outcome: Extraction, outputs: Outputs) -> Page:
    """The whole run: what was found, and what is written of it."""
    # Cameras that need attention come first: a page is read from the top.
    cameras = sorted(outcome.cameras, key=lambda c: -list(Verdict).index(c.verdict))
    shown = cameras[:MOST_CAMERAS]
    sections = [_overview(outcome, shown, outputs)]
    sections += [_camera(c, outcome.policy, drawn=i < MOST_DRAWN) for i, c in enumerate(shown)]
    if outcome.rejected or outcome.skipped:
        sections.append(_set_aside(outcome))
    counts = {verdict: sum(c.verdict is verdict for c in cameras) for verdict in Verdict}
    told = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count) or "none"
    good = outcome.exit_code == 0
    return Page(
        title=f"Camera check: {_count(len(cameras), 'camera')}",
        badge=Badge("every K is valid", Tone.GOOD) if good else Badge("needs attention", Tone.BAD),
        lead=f"{told[0].upper()}{told[1:]}, judged by the {outcome.policy.name} policy. "
        "Only a valid K is handed to a solver.",
        sections=tuple(sections),
        # The overview leads to every camera.
        contents=False,
        made_by=f"Made by calibrary {version('calibrary')} from {_count(outcome.images, 'image')}.",
    )


def _overview(outcome: Extraction, cameras: list[CameraReport], outputs: Outputs) -> Section:
    columns = (
        Column("camera"),
        Column("verdict"),
        Column("images", numeric=True),
        Column("fx (px)", numeric=True),
        Column("fx/W", numeric=True),
        Column("grade"),
        Column("K in"),
    )
    blocks: list[Block] = [Note(text=text, tone=Tone.CAUTION) for text in outputs.warnings]
    blocks.append(
        Table(
            caption="Every camera that was found in the images, those that need attention first",
            columns=columns,
            rows=tuple(_row(camera, outputs.matrices.get(camera.slug)) for camera in cameras),
        )
    )
    if len(outcome.cameras) > len(cameras):
        blocks.append(f"{len(outcome.cameras) - len(cameras)} more cameras are in the report only.")
    unmeasured = sum(c.uncalibrated for c in outcome.cameras if c.calibration is not None)
    if unmeasured:
        blocks.append(
            Note(
                text=f"For {_count(unmeasured, 'camera')} the principal point and the distortion were not measured: "
                "good enough for a reconstruction to converge, not for survey accuracy."
            )
        )
    if any(c.verdict is Verdict.UNPROVEN for c in outcome.cameras):
        blocks.append(f"{UNPROVEN_LEGEND[0].upper()}{UNPROVEN_LEGEND[1:]}.")
    meanings = tuple(f"{grade.value}: {grade.meaning}" for grade in Grade)
    blocks.append(Details(summary="What the grades mean", blocks=(Bullets(meanings),)))
    return Section(title="Overview", blocks=tuple(blocks))


def _row(camera: CameraReport, output: str | None) -> tuple[Cell, ...]:
    fx, over_width, grade = "–", "–", "–"
    if camera.calibration is not None:
        K = camera.calibration.intrinsics
        fx, over_width = f"{K.fx:.2f}", f"{K.fx / K.image_size[0]:.3f}"
        grade = camera.calibration.grade.value
    return (
        Link(camera.name, f"#{camera.slug}"),
        _verdict(camera),
        str(camera.camera.count),
        fx,
        over_width,
        grade,
        output or "–",
    )


def _camera(camera: CameraReport, policy: Policy, *, drawn: bool) -> Section:
    blocks = [*_judgement(camera), *_numbers(camera)]
    if drawn:
        plots = [plot for plot in (_evidence(camera, policy),) if plot is not None]
        if camera.calibration is not None and camera.calibration.distortion is not None:
            arrows, _ = distortion_map(camera.calibration)
            plots += [arrows, radial_curve(camera.calibration)]
        blocks += [SideBySide(tuple(plots))] if plots else []
    if camera.pixels is not None:
        blocks += _pixels(camera.pixels)
    blocks += _findings(camera.report)
    blocks += _doubts(camera)
    if camera.fallback is not None:
        blocks += _fallbacks(camera.fallback)
    blocks += _images_by_state(camera)
    return Section(title=camera.name, badge=_verdict(camera), anchor=camera.slug, blocks=tuple(blocks))


def _judgement(camera: CameraReport) -> Iterator[Block]:
    if camera.reason is not None:
        yield Note(text=camera.reason, action=camera.advice, tone=VERDICTS[camera.verdict])
    known = camera.camera.states[0].known.title
    if known is not None:
        yield f"In the catalogue: {known}."


def _numbers(camera: CameraReport) -> Iterator[Block]:
    """K and what stands beside it; of a rejected K its numbers too, said to be no K."""
    calibration, failed = camera.calibration, camera.camera.calibration
    if calibration is not None:
        yield KeyValues(tuple(_intrinsics(calibration)))
        yield _origin(calibration)
        yield from _distortion(calibration)
        yield from calibration.notes
    elif failed is not None:
        yield Details(
            summary="The rejected intrinsics",
            blocks=(KeyValues(tuple(_intrinsics(failed))), _origin(failed)),
        )


def _intrinsics(calibration: Calibration) -> Iterator[tuple[str, str]]:
    K = calibration.intrinsics
    std = calibration.quality.std if calibration.quality is not None else {}
    for name in ("fx", "fy", "cx", "cy"):
        sigma = f" ± {std[name]:.2f}" if name in std else ""
        yield name, f"{getattr(K, name):.2f}{sigma} px"
    if K.skew:
        yield "skew", f"{K.skew:.4g} px"
    yield "image", "{} × {} px".format(*K.image_size)


def _origin(calibration: Calibration) -> str:
    """Where the K is from, in a sentence."""
    source = calibration.provenance
    told = f"Grade: {calibration.grade.value}, from {source.tag or source.kind}"
    if source.source is not None:
        told += f" of {source.source}"
    if source.adaptation is not None:
        told += f", {source.adaptation}"
    if source.assumptions:
        told += f". Assumed: {'; '.join(source.assumptions)}"
    return f"{told}."


def _distortion(calibration: Calibration) -> Iterator[Block]:
    if calibration.distortion is None:
        yield "The distortion is unknown (which is not the same as no distortion)."
        return
    coefficients = calibration.distortion.coefficients
    if not coefficients:
        yield "The image is free of distortion."
        return
    yield Table(
        caption=f"Distortion, {calibration.distortion.model} model",
        columns=tuple(Column(name, numeric=True) for name in coefficients),
        rows=(tuple(f"{value:.6g}".replace("-", "−") for value in coefficients.values()),),
    )


def _evidence(camera: CameraReport, policy: Policy) -> Figure | None:
    """Every estimate's fx side by side, before the band that it is held against."""
    evidence = camera.camera.evidence
    if not evidence.estimates:
        return None
    doubted = {conflict.other for conflict in evidence.conflicts}

    def role(estimate: SourceEstimate) -> Role:
        if estimate is evidence.chosen:
            return Role.CHOSEN
        if evidence.chosen is None or not estimate.pinhole:
            return Role.NO_K
        return Role.DISAGREES if estimate in doubted else Role.AGREES

    rows = [
        Interval(
            name=estimate.tag,
            value=estimate.intrinsics.fx,
            half_width=estimate.intrinsics.fx * estimate.tolerance,
            role=role(estimate),
        )
        for estimate in evidence.estimates
    ]
    if camera.pixels is not None:
        rows += _of_pixels(camera.pixels)
    caption = "fx as stated by each source in the images"
    caption += "; bars show the rounding of the source" if any(row.half_width for row in rows) else ""
    caption += ", of the pixels ±2 σ." if camera.pixels is not None else "."
    band = _band(camera, policy)
    if band is not None:
        caption += f" Shaded: the range that {band.text} accepts."
    return intervals(rows, axis=PX, caption=caption, band=band)


def _of_pixels(check: PixelCheck) -> Iterator[Interval]:
    """The pixels' focal length among the sources, and that of pairs of images."""
    agrees = Role.AGREES if check.verdict is PixelVerdict.AGREES else Role.NO_K
    role = Role.DISAGREES if check.verdict is PixelVerdict.CONTRADICTS else agrees
    if check.measured_fx is not None and check.std is not None:
        half = 2 * check.std * check.measured_fx
        yield Interval(
            name=f"pixels of {check.images} images", value=check.measured_fx, half_width=half, role=role
        )
    if check.pair_fx is not None and check.pair_std is not None:
        half = 2 * check.pair_std * check.pair_fx
        yield Interval(
            name=f"{check.pairs} pairs of images", value=check.pair_fx, half_width=half, role=Role.NO_K
        )


def _pixels(check: PixelCheck) -> Iterator[Block]:
    """What the pixels say of K, in figures."""
    rows = [("because", check.reason)]
    rows += [("by the pixels", check.figures)] if check.figures else []
    rows.append(("images", f"{check.images} of {check.chosen} fit one another"))
    if check.pair_fx is not None and check.pair_std is not None:
        rows.append(
            ("by pairs", f"fx = {check.pair_fx:.1f} px ± {check.pair_std:.1%} of {check.pairs} pairs")
        )
    lens = check.distortion
    if lens is not None:
        seen = f"{lens.measured_px:+.1f} ± {lens.std_px:.1f} px, K states {lens.stated_px:+.1f} px"
        rows.append(("distortion at 0.8 of the half diagonal", seen))
    yield f"K held against the pixels of some images (uncertainties are one σ): {check.verdict.value}."
    yield Bullets(tuple(f"{name}: {told}" for name, told in rows))


def _band(camera: CameraReport, policy: Policy) -> Band | None:
    evidence = camera.camera.evidence
    state = next((s for s in camera.camera.states if s.metadata == evidence.scene.metadata), None)
    expected = circumstances(evidence, state.known).expected if state is not None else None
    if policy.known_camera_tolerance is not None and expected is not None:
        share = max(policy.known_camera_tolerance, expected.spread or 0.0)
        return Band(expected.fx * (1 - share), expected.fx * (1 + share), f"the {expected.source}")
    width = evidence.scene.metadata.size[0]
    low, high = policy.focal_over_width
    return Band(low * width, high * width, f"the {policy.name} policy's band")


def _findings(report: Report | None) -> Iterator[Block]:
    if report is None:
        return
    columns = (
        Column("rule"),
        Column("result"),
        Column("measured", numeric=True),
        Column("limit", numeric=True),
        Column("what was found and expected"),
    )
    caption = f"K against the {report.policy} policy"
    table = Table(
        caption=caption,
        columns=columns,
        rows=tuple(
            (
                f.rule,
                Badge(f.severity.value, SEVERITIES[f.severity]),
                _share(f.measured),
                _share(f.limit),
                f.message,
            )
            for f in report.findings
        ),
    )
    if report.verdict is Verdict.VALID:
        yield Details(summary=f"{caption}: {_count(len(report.findings), 'finding')}", blocks=(table,))
    else:
        yield table


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}".replace("-", "−")


def _doubts(camera: CameraReport) -> Iterator[Block]:
    """What was heard beside the K and is not believed, or contradicts it."""
    evidence = camera.camera.evidence
    said = [
        f"{c.other.tag} disagrees with {c.chosen.tag} by {c.difference:+.1%}: {c.cause.value}."
        for c in evidence.conflicts
    ]
    images = camera.camera.count
    for dropped, count in camera.camera.dropped:
        of = "" if count == images else f" of {count} of {images} images"
        said.append(f"{dropped.tag}{of} is not believed: {dropped.reason}.")
    if said:
        yield Bullets(tuple(said))


def _fallbacks(fallback: Fallback) -> Iterator[Block]:
    yield Table(
        caption="What was tried instead of the images' own K, in this order",
        columns=(Column("step"), Column("outcome"), Column("source"), Column("why")),
        rows=tuple((s.step.value, s.outcome.value, s.source or "–", s.why) for s in fallback.steps),
    )
    if fallback.seed is not None:
        command = seed_command(fallback.seed).replace(" && ", " &&\n")
        yield Details(
            summary="To self-calibrate from the seed",
            blocks=(Code(text=command, label=f"COLMAP commands for {fallback.seed.camera}"),),
        )


def _images_by_state(camera: CameraReport) -> Iterator[Block]:
    """The images; where they are in several states, what each state has and how it was judged."""
    states = camera.states
    if len(states) > 1:
        yield Table(
            caption="The images by what can change K or its meaning",
            columns=(
                Column("images", numeric=True),
                Column("verdict"),
                Column("grade of their own K"),
                Column("fx (px)", numeric=True),
                Column("firmware"),
                Column("sources and edits"),
            ),
            rows=tuple(_state(state) for state in states[:MOST_STATES]),
        )
        if len(states) > MOST_STATES:
            yield f"{len(states) - MOST_STATES} more states are listed in the report."
    for state in states[:MOST_STATES]:
        yield _names(state.images, state.count)


def _state(state: StateDocument) -> tuple[Cell, ...]:
    told = [*state.edits, *state.sources] or ["none"]
    if state.inherits:
        told.insert(0, "takes over the camera's K")
    return (
        str(state.count),
        Badge(state.verdict.value, VERDICTS[state.verdict]),
        state.grade.value if state.grade is not None else "–",
        f"{state.intrinsics.fx:.2f}" if state.intrinsics is not None else "–",
        state.firmware or "–",
        "; ".join(told),
    )


def _names(names: tuple[str, ...], count: int) -> Details:
    shown = names[:MOST_NAMES]
    where = ", listed in the report" if count == len(names) else ""
    more = (f"and {count - len(shown)} more{where}",) if count > len(shown) else ()
    return Details(summary=_count(count, "image"), blocks=(Bullets((*shown, *more)),))


def _set_aside(outcome: Extraction) -> Section:
    found = (*outcome.rejected, *outcome.skipped)
    rejected = found[:MOST_NAMES]
    table = Table(
        caption="Images whose camera could not be identified",
        columns=(Column("image"), Column("why")),
        rows=tuple((item.name, item.reason) for item in rejected),
    )
    more, unlisted = len(found) - len(rejected), outcome.more_rejected + outcome.more_skipped
    told = f"{more} more are listed in the report."
    if unlisted:
        told = f"{more + unlisted} more; the report lists {len(found)} of them all."
    blocks: tuple[Block, ...] = (table, told) if more or unlisted else (table,)
    return Section(title=f"{_count(len(found) + unlisted, 'image')} skipped", blocks=blocks)


def _verdict(camera: CameraReport) -> Badge:
    return Badge(camera.verdict.value, VERDICTS[camera.verdict])


def _count(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
