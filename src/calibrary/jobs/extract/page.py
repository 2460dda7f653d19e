"""Page of a run for a client: subject, what to do first, all cameras with their K."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from typing import Final

from msgspec import Struct

from calibrary.calibration import Grade
from calibrary.jobs.extract.extraction import CameraReport, Extraction
from calibrary.jobs.extract.outputs import Outputs
from calibrary.jobs.extract.page_camera import MOST_NAMES, camera_section, verdict_badge
from calibrary.pages import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Link,
    Note,
    Page,
    Section,
    Table,
    Tone,
)
from calibrary.pages.wording import UNPROVEN, count, cut_table, made_by, or_unknown, several
from calibrary.validation import Verdict

__all__ = ["JobFacts", "outcome_page"]

MOST_DRAWN: Final = 40
"""Most cameras with plots; more would make the page slow to create and to open."""
MOST_CAMERAS: Final = 500
MOST_DUE: Final = 100


class JobFacts(Struct, frozen=True, kw_only=True):
    """Facts for the page that the images do not state; None is printed as unknown.

    Attributes:
        job: name or number of the job.
        operator: person who flew it or is responsible for it.
        checked: date of the run.
    """

    job: str | None = None
    operator: str | None = None
    checked: date | None = None


def outcome_page(outcome: Extraction, outputs: Outputs, about: JobFacts | None = None) -> Page:
    """Make the page of a run."""
    about = about or JobFacts()
    # Cameras that need attention come first, because a page is read from the top.
    cameras = sorted(outcome.cameras, key=lambda c: -list(Verdict).index(c.verdict))
    shown = cameras[:MOST_CAMERAS]
    sections = [Section(title="What to do first", blocks=tuple(_first(outcome, cameras)))]
    sections.append(_overview(outcome, shown, outputs))
    sections += [camera_section(c, outcome.policy, drawn=i < MOST_DRAWN) for i, c in enumerate(shown)]
    if outcome.rejected or outcome.skipped:
        sections.append(_skipped(outcome))
    counts = {verdict: sum(c.verdict is verdict for c in cameras) for verdict in Verdict}
    verdicts = ", ".join(f"{number} {verdict}" for verdict, number in counts.items() if number) or "none"
    good = outcome.exit_code == 0
    return Page(
        title=f"Camera check: {count(len(cameras), 'camera')}",
        badge=Badge("every K is valid", Tone.GOOD) if good else Badge("needs attention", Tone.BAD),
        lead=f"{verdicts[0].upper()}{verdicts[1:]}, judged by the {outcome.policy.name} policy. "
        "Only a valid K is handed to a solver.",
        facts=(
            ("job", or_unknown(about.job)),
            ("folder", or_unknown(several(outcome.sources) if outcome.sources else None)),
            ("flown", or_unknown(_days(outcome.days))),
            ("checked on", or_unknown(about.checked)),
            ("operator", or_unknown(about.operator)),
        ),
        sections=tuple(sections),
        # The overview links to every camera.
        contents=False,
        made_by=made_by(f"from {count(outcome.images, 'image')}"),
    )


def _days(days: tuple[date, date] | None) -> str | None:
    if days is None:
        return None
    return str(days[0]) if days[0] == days[1] else f"{days[0]} to {days[1]}"


def _first(outcome: Extraction, cameras: Sequence[CameraReport]) -> Iterator[Block]:
    """The cameras without a valid K and the images without K, each with the next step."""
    due: list[tuple[Cell, ...]] = [
        (
            Link(camera.name, f"#{camera.slug}"),
            verdict_badge(camera),
            camera.reason or "–",
            camera.advice or "–",
        )
        for camera in cameras
        if camera.verdict is not Verdict.VALID
    ]
    if outcome.unread is not None:
        reason = outcome.rejected[0].reason
        others = (
            f"; the others: see {SKIPPED.lower()}"
            if len(outcome.rejected) + outcome.more_rejected > 1
            else ""
        )
        action = "copy these files from the camera again, or leave them out"
        due.append(
            (
                Link(outcome.unread, f"#{SKIPPED_ANCHOR}"),
                Badge("unread", Tone.BAD),
                f"{reason}{others}",
                action,
            )
        )
    if not due:
        yield Note(text="Nothing: every image has a valid K.", tone=Tone.GOOD)
        return
    columns = (Column("camera or images"), Column("verdict"), Column("reason"), Column("do this"))
    caption = "What keeps this flight from being processed as it is"
    yield from cut_table(caption, columns, due, most=MOST_DUE, rest="the report")


SKIPPED: Final = "Images skipped"
SKIPPED_ANCHOR: Final = "images-skipped"


def _overview(outcome: Extraction, cameras: Sequence[CameraReport], outputs: Outputs) -> Section:
    columns = (
        Column("camera"),
        Column("verdict"),
        Column("images", numeric=True),
        Column("fx (px)", numeric=True),
        Column("grade"),
        Column("file with K"),
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
                text=f"For {count(unmeasured, 'camera')} the principal point and the distortion were not measured: "
                "good enough for a reconstruction to converge, not for survey accuracy."
            )
        )
    if any(c.verdict is Verdict.UNPROVEN for c in outcome.cameras):
        blocks.append(UNPROVEN)
    shown = {c.calibration.grade for c in outcome.cameras if c.calibration is not None}
    blocks.append(Bullets(tuple(f"Grade {g.value}: {g.meaning}." for g in Grade if g in shown)))
    return Section(title="Cameras", blocks=tuple(blocks))


def _row(camera: CameraReport, output: str | None) -> tuple[Cell, ...]:
    calibration = camera.calibration
    return (
        Link(camera.name, f"#{camera.slug}"),
        verdict_badge(camera),
        str(camera.camera.count),
        f"{calibration.intrinsics.fx:.2f}" if calibration is not None else "–",
        calibration.grade.value if calibration is not None else "–",
        output or "–",
    )


def _skipped(outcome: Extraction) -> Section:
    found = (*outcome.rejected, *outcome.skipped)
    rejected = found[:MOST_NAMES]
    table = Table(
        caption="Images of a camera that could not be identified",
        columns=(Column("image"), Column("reason")),
        rows=tuple((item.name, item.reason) for item in rejected),
    )
    more, unlisted = len(found) - len(rejected), outcome.more_rejected + outcome.more_skipped
    told = f"{more} more are listed in the report."
    if unlisted:
        told = f"{more + unlisted} more; the report lists {len(found)} of them all."
    blocks: tuple[Block, ...] = (table, told) if more or unlisted else (table,)
    title = f"{SKIPPED}: {len(found) + unlisted}"
    return Section(title=title, anchor=SKIPPED_ANCHOR, blocks=blocks, printed=False)
