"""Page of a combination: the verdict, each calibration against the others, fx by date, and the combined camera."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import date
from itertools import pairwise
from typing import Final

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.jobs.combine.report import CombinationReport, CombinedSource
from calibrary.pages import Badge, Block, Bullets, Column, Figure, KeyValues, Note, Page, Section, Tone
from calibrary.pages.plots import Axis, Interval, Role, intervals
from calibrary.pages.plots.intervals import SIGMAS, Dated, Period, over_time
from calibrary.pages.wording import (
    SEVERITIES,
    count,
    cut_table,
    distortion_blocks,
    intrinsics_items,
    made_by,
    rounded,
)
from calibrary.provenance import facts
from calibrary.sfm.season import Drift
from calibrary.validation import Severity

OUTCOMES: Final = {
    BoardVerdict.PASS: Badge("pass", Tone.GOOD),
    BoardVerdict.PROVISIONAL: Badge("provisional", Tone.CAUTION),
    BoardVerdict.REFUSE: Badge("refused", Tone.BAD),
}
LEADS: Final = {
    BoardVerdict.PASS: "It may be approved.",
    BoardVerdict.PROVISIONAL: "It may be kept as a draft, and not be approved.",
    BoardVerdict.REFUSE: "They are not combined; why is said below.",
}
PX: Final = Axis("fx", "px")
MOST_ROWS: Final = 300
UNLIKELY: Final = 0.001
"""Probability below which a difference from the others is shown as a disagreement."""


def combination_page(report: CombinationReport) -> Page:
    """Make the page of a combination, refused or not."""
    camera, number = report.calibration, count(len(report.sources), "calibration")
    made = camera.provenance if camera is not None else None
    return Page(
        title=f"{number} of {camera.camera}" if camera is not None else f"{number}, not combined",
        badge=OUTCOMES[report.verdict],
        lead=LEADS[report.verdict],
        facts=facts(made, traced=False, unknown=True) if made is not None else (),
        sections=tuple(_sections(report)),
        made_by=made_by(),
    )


def _sections(report: CombinationReport) -> Iterator[Section]:
    yield Section(title="Verdict", anchor="verdict", blocks=tuple(_verdict(report)))
    figure = _plot(report)
    blocks = (*([figure] if figure is not None else []), *_sources(report))
    yield Section(title="Each against the others", anchor="sources", blocks=blocks)
    if report.calibration is not None:
        yield Section(title="The combined camera", anchor="camera", blocks=tuple(_camera(report.calibration)))


def _camera(combined: Calibration) -> Iterator[Block]:
    yield KeyValues(tuple(intrinsics_items(combined)))
    if combined.quality is not None and combined.quality.inflation > 1:
        factor = math.sqrt(combined.quality.inflation)
        yield f"Use σ × {factor:.2f}: the calibrations scatter by so much more than they state."
    yield from distortion_blocks(combined)


def _verdict(report: CombinationReport) -> Iterator[Block]:
    for finding in report.findings:
        if finding.severity is not Severity.NOTE:
            yield Note(
                text=f"{finding.rule}: {finding.message}.",
                action=finding.remedy,
                tone=SEVERITIES[finding.severity],
            )
    notes = tuple(str(finding) for finding in report.findings if finding.severity is Severity.NOTE)
    if notes:
        yield Bullets(notes)


def _sources(report: CombinationReport) -> Iterator[Block]:
    columns = (
        Column("calibration"),
        Column("date"),
        Column("fx (px)", numeric=True),
        Column("σ × κ (px)", numeric=True),
        Column("κ²", numeric=True),
        Column("farthest from the others (px, ± 1 σ)", numeric=True),
        Column("p", numeric=True),
    )
    caption = "p is the chance of such a difference from all others by the stated noise alone"
    yield from cut_table(caption, columns, [*map(_row, report.sources)], most=MOST_ROWS, rest="the JSON")


def _row(one: CombinedSource) -> tuple[str, ...]:
    fx, std = rounded(one.fx, one.fx_std, ".2f")
    apart = "–"
    if one.off_px is not None and one.off_std_px is not None:
        apart = " ± ".join(rounded(one.off_px, one.off_std_px))
    return (
        one.label,
        one.date or "–",
        fx,
        std,
        f"{one.kappa2:.2f}" if one.kappa2 is not None else "not known",
        apart,
        f"{one.p:.2g}" if one.p is not None else "–",
    )


def _plot(report: CombinationReport) -> Figure | None:
    """Plot fx over the date if all have one, otherwise by name."""
    known = [(one, one.fx_std) for one in report.sources if one.fx_std is not None]
    if not known:
        return None
    caption, whole = f"fx of each, ± {SIGMAS:g} σ × κ.", _whole(report.calibration)
    days = [_day(one) for one, _ in known]
    dated = [
        Dated(day=day, value=one.fx, std=std, role=_role(one))
        for (one, std), day in zip(known, days, strict=True)
        if day is not None
    ]
    if len(dated) == len(known):
        periods = []
        if whole is not None:
            caption += " Line and shade: the combined one."
            periods = [Period(first=None, last=None, value=whole[0], tolerance=whole[1], text="combined")]
        if whole is not None and report.drift is not None:
            caption += " It is that of the last day, and stands before it as it drifts."
            periods = [*_drifting(report.drift, whole, sorted(one.day for one in dated))]
        return over_time(dated, periods, axis=PX, caption=caption)
    rows = [
        Interval(name=one.label, value=one.fx, half_width=SIGMAS * std, role=_role(one)) for one, std in known
    ]
    if whole is not None:
        rows.insert(0, Interval(name="combined", value=whole[0], half_width=whole[1], role=Role.CHOSEN))
    return intervals(rows, axis=PX, caption=caption)


def _drifting(drift: Drift, whole: tuple[float, float], days: Sequence[date]) -> Iterator[Period]:
    """Yield the combined fx from flight to flight."""
    for first, last in pairwise(days):
        before = (days[-1] - first - (last - first) / 2).days / 365.25
        value = whole[0] * (1.0 - drift.focal * before)
        yield Period(first=first, last=last, value=value, tolerance=whole[1], text="combined")


def _whole(camera: Calibration | None) -> tuple[float, float] | None:
    """Return fx of the combined camera and its 3 σ including the scatter; None if not known."""
    if camera is None or camera.quality is None or (std := camera.quality.std.get("fx")) is None:
        return None
    return camera.intrinsics.fx, SIGMAS * std * math.sqrt(camera.quality.inflation)


def _role(one: CombinedSource) -> Role:
    return Role.DISAGREES if one.p is not None and one.p < UNLIKELY else Role.AGREES


def _day(one: CombinedSource) -> date | None:
    try:
        return date.fromisoformat(one.date[:10]) if one.date is not None else None
    except ValueError:
        return None
