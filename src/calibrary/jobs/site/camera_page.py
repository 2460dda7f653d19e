"""Page of one camera: K, lens, uncertainties, provenance, history and the files to download.

These are its own, one in every format that can represent it. Each change of the history has a
page too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from datetime import date
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary import parsers
from calibrary.calib.projection_difference import pixel_grid, projection_uncertainty
from calibrary.calibration import Calibration, Covariance
from calibrary.errors import CalibraryError, InputError, first_of
from calibrary.jobs.diff.comparison import DiffReport, compare
from calibrary.jobs.diff.told import badge_of, comparison_sections
from calibrary.jobs.diff.uncertainty import PRIORS, spread_of
from calibrary.jobs.site.folder import INDEX, Place, way
from calibrary.pages.plots import Axis, displacement
from calibrary.pages.plots.canvas import number
from calibrary.pages.plots.history import Series, history
from calibrary.pages.plots.svg_plots import amount_map, arrow_map
from calibrary.pages.wording import distortion_blocks, intrinsics_items, made_by, minus, stds_of
from calibrary.parsers.fit import reason_for_fit
from calibrary.policy import Policy
from calibrary.provenance import facts
from calibrary.records import replace
from calibrary.registry.entry import UNSTATED, Entry, Status, digest
from calibrary.registry.fields import differences, entry_rows
from calibrary.registry.git.history import Revision
from calibrary.registry.history import EntryRevision
from calibrary.registry.paths import slug
from calibrary.registry.standing import Evidence
from calibrary.view import (
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
    Section,
    SideBySide,
    Table,
    Tone,
    View,
)

MOST_COMPARED: Final = 100
"""Most changes of one entry that get a page, newest first; few cameras are calibrated as often."""
MOST_REVISIONS: Final = 200
"""Most rows of the history; the log shows all."""

ALTITUDE_M: Final = 100.0
BEYOND: Final = "Their numbers are too far from any camera's to be computed with."
STATUSES: Final = {
    Status.APPROVED: Tone.GOOD,
    Status.DRAFT: Tone.CAUTION,
    Status.RETIRED: Tone.NEUTRAL,
}


class Step(Struct, frozen=True, kw_only=True):
    """One change of an entry's calibration.

    Attributes:
        before, after: the two revisions.
        comparison: None if the two cannot be compared.
        reason: why there is no comparison.
    """

    before: EntryRevision
    after: EntryRevision
    comparison: DiffReport | None = None
    reason: str | None = None

    @property
    def name(self) -> str:
        """Name made of its two abbreviated commits."""
        return f"{self.before.revision.commit[:10]}-{self.after.revision.commit[:10]}"


def steps(id_: str, revisions: tuple[EntryRevision, ...], policy: Policy) -> tuple[Step, ...]:
    """Compare each pair of consecutive revisions between which the calibration changed, newest first."""
    readable = [(one, one.entry.calibration) for one in revisions if one.entry is not None]
    changed = [
        (before, after) for after, before in pairwise(readable) if _numbers(before[1]) != _numbers(after[1])
    ]
    return tuple(_step(id_, before, after, policy) for before, after in changed[:MOST_COMPARED])


def _step(
    id_: str,
    older: tuple[EntryRevision, Calibration],
    newer: tuple[EntryRevision, Calibration],
    policy: Policy,
) -> Step:
    (before, one), (after, other) = older, newer
    try:
        labels = _label(id_, before), _label(id_, after)
        comparison = compare(one, other, policy, labels=labels)
    except CalibraryError as error:
        return Step(before=before, after=after, reason=str(error))
    except np.linalg.LinAlgError:
        return Step(before=before, after=after, reason=BEYOND)
    return Step(before=before, after=after, comparison=comparison)


def _numbers(calibration: Calibration) -> tuple[object, ...]:
    """The parts of a calibration that affect a comparison."""
    return calibration.intrinsics, calibration.distortion, calibration.quality, calibration.grade


def _label(id_: str, revision: EntryRevision) -> str:
    return f"{id_}@{revision.revision.commit[:10]}"


def made_at(commit: Revision | None) -> str:
    """Footer with the commit that last changed the page's content, so that the page stays the same until the next."""
    return made_by(
        f"from commit {commit.commit[:12]} of {commit.committed:%Y-%m-%d}" if commit is not None else None
    )


def step_page(step: Step, *, id_: str, place: Place) -> View:
    """Make the page that compares one change of an entry's calibration.

    Args:
        step: the change.
        id_: the entry's longest KEY.
        place: location of the entry's page.
    """
    before, after = step.before, step.after
    back = Link(f"All of {id_}", way(place.step(step.name), place.page))
    reason = after.reason or after.revision.subject
    done = Section(
        title="What was done",
        blocks=(
            KeyValues(
                (
                    ("on", f"{after.revision.authored:%Y-%m-%d}"),
                    ("by", after.revision.author.name),
                    ("reason", reason),
                    ("firmware", f"{before.firmware or 'not stated'} → {after.firmware or 'not stated'}"),
                )
            ),
            Details(summary="Every field that changed", blocks=(_fields(after, before),)),
            back,
        ),
    )
    if step.comparison is None:
        found: tuple[Section, ...] = (
            Section(title="Verdict", blocks=(Note(text=step.reason or "", tone=Tone.CAUTION),)),
        )
        badge = Badge("not compared", Tone.CAUTION)
    else:
        found = comparison_sections(step.comparison, ALTITUDE_M)
        badge = badge_of(step.comparison)
    camera = after.entry.calibration.camera if after.entry is not None else id_
    return View(
        title=f"Change of {camera}",
        badge=badge,
        lead=f"A is the entry of {before.revision.authored:%Y-%m-%d}, B on "
        f"{after.revision.authored:%Y-%m-%d}.",
        sections=(*found, done),
        made_by=made_at(after.revision),
    )


def story(
    id_: str, place: Place, revisions: Sequence[EntryRevision], changes: Sequence[Step]
) -> Iterator[Block]:
    """History of a camera: chart of its numbers and table of its revisions.

    Args:
        id_: the entry's longest KEY.
        place: location of the entry's page.
        revisions: of the entry, newest first.
        changes: of its calibration, newest first.
    """
    told = [revision for revision in reversed(revisions) if revision.entry is not None]
    if not told:
        yield "No history."
        return
    if len(told) > 1:
        yield _chart(_measured(told))
    by_commit = {step.after.revision.commit: step for step in changes}
    titles = (
        "date",
        "by",
        "what was done",
        "grade",
        "firmware",
        "fx (px)",
        "Δ fx (px)",
        "Δ cx (px)",
        "Δ cy (px)",
        "what changed",
        "reason",
    )
    numeric = {"fx (px)", "Δ fx (px)", "Δ cx (px)", "Δ cy (px)"}
    table = Table(
        caption="Every revision, newest first",
        columns=tuple(Column(title, numeric=title in numeric) for title in titles),
        rows=tuple(_row(revision, by_commit, place) for revision in revisions[:MOST_REVISIONS]),
    )
    yield Section(title="Revisions", blocks=(table,), printed=False)
    if len(revisions) > MOST_REVISIONS:
        yield Code(
            text=f"calibrary registry log {id_}",
            label=f"The command that lists all {len(revisions)} revisions",
        )
    if len(changes) == MOST_COMPARED:
        yield f"The newest {MOST_COMPARED} changes are compared here; calibrary diff compares any two."


def _measured(told: Sequence[EntryRevision]) -> list[EntryRevision]:
    """The revisions that changed the numbers, each in its last form, sorted by the date of the calibration."""
    newest: dict[str, EntryRevision] = {}
    for one in told:
        if one.entry is not None:
            newest[digest(one.entry.calibration, one.entry.sensor)] = one
    return sorted(newest.values(), key=_day)


def _day(one: EntryRevision) -> date:
    """Date of the calibration as stated by its source, else of the commit."""
    stated = one.entry.calibration.provenance.date if one.entry is not None else None
    with suppress(ValueError):
        return date.fromisoformat((stated or "")[:10])
    return one.revision.authored.date()


def _chart(told: Sequence[EntryRevision]) -> Figure:
    """Chart of fx, cx and cy over time; values at another image size than today's are gaps."""
    entries = [revision.entry for revision in told if revision.entry is not None]
    size = entries[-1].calibration.intrinsics.image_size
    same = [entry.calibration.intrinsics.image_size == size for entry in entries]

    def value(entry: Entry, name: str) -> float:
        return float(getattr(entry.calibration.intrinsics, name))

    series = [
        Series(
            axis=Axis(name, "px"),
            values=[value(entry, name) if ok else math.nan for entry, ok in zip(entries, same, strict=True)],
            std=[stds_of(entry.calibration).get(name, math.nan) for entry in entries],
        )
        for name in ("fx", "cx", "cy")
    ]
    marks = [
        (at, f"firmware {revision.firmware}")
        for at, revision in enumerate(told)
        if at > 0 and revision.firmware is not None and revision.firmware != told[at - 1].firmware
    ]
    gap = "" if all(same) else " Revisions of another image size are not drawn."
    return history(
        series,
        labels=[_day(revision).isoformat() for revision in told],
        marks=marks,
        days=[_day(revision) for revision in told],
        spans=[_valid(entry) for entry in entries],
        caption="fx, cx and cy by the day of the calibration, with ± 1 σ where it is stated; shaded: the days that it "
        f"is valid on, where the entry limits them; dashed: a new firmware.{gap}",
    )


def _valid(entry: Entry) -> tuple[date | None, date | None] | None:
    validity = entry.validity
    return (validity.first, validity.last) if validity is not None else None


def _row(one: EntryRevision, by_commit: dict[str, Step], place: Place) -> tuple[Cell, ...]:
    entry, delta, revision = one.entry, one.delta, one.revision
    file = "written" if entry is not None else "removed" if revision.oid is None else "unreadable"
    change = partial(_delta, delta)
    step = by_commit.get(revision.commit)
    return (
        f"{revision.authored:%Y-%m-%d}",
        revision.author.name,
        Badge(", ".join(one.actions) or file, Tone.NEUTRAL),
        entry.calibration.grade.value if entry is not None else "–",
        one.firmware or "–",
        f"{entry.calibration.intrinsics.fx:.2f}" if entry is not None else "–",
        change("fx"),
        change("cx"),
        change("cy"),
        _what(one, step, place),
        one.reason or revision.subject,
    )


def _what(revision: EntryRevision, step: Step | None, place: Place) -> Cell:
    """Link to the comparison, or description of what else changed."""
    if step is not None:
        found: DiffReport | None = step.comparison
        verdict = found.verdict.value if found is not None else "not compared"
        return Link(f"{verdict} at {revision.revision.commit[:10]}", way(place.page, place.step(step.name)))
    if revision.entry is None:
        return "–"
    if revision.before is None:
        return "first entry"
    names = [change.name for change in differences(revision.before, revision.entry)]
    return first_of(names, 4) or "nothing"


def _fields(after: EntryRevision, before: EntryRevision) -> Table:
    changes = differences(before.entry, after.entry) if after.entry is not None else ()
    return Table(
        caption="Every field of the entry that differs",
        columns=(Column("field"), Column("before"), Column("after")),
        rows=tuple((change.name, _text(change.before), _text(change.after)) for change in changes),
    )


def _delta(delta: dict[str, float] | None, name: str) -> str:
    return minus(f"{delta[name]:+.2f}") if delta is not None and delta[name] else "–"


def _text(value: object) -> str:
    return "–" if value is None else str(value)


class Download(Struct, frozen=True, kw_only=True):
    """One format.

    Attributes:
        format: name of the format.
        title: common name of the format.
        name: of the file; None if there is none.
        data: content of the file.
        remark: how exactly it represents K and the lens, or why there is no file.
        left_out: known data that the file does not contain.
    """

    format: str
    title: str
    name: str | None = None
    data: bytes = b""
    remark: str = ""
    left_out: str = ""


def downloads(entry: Entry, data: bytes) -> tuple[Download, ...]:
    """Files in all formats that can be written, in alphabetical order, and the entry's own file with its bytes.

    A lens model that a format cannot represent could be refitted to one of its models. That takes up to a
    second per file, so it is left to ``calibrary convert``, which also reports the error of such a file.
    """
    name = f"{Path(entry.path).stem}-entry.yaml"
    own = Download(
        format="entry", title="calibrary entry", name=name, data=data, remark="exact", left_out="nothing"
    )
    return (*files_of(entry.calibration), own)


def files_of(calibration: Calibration) -> tuple[Download, ...]:
    """Files of a calibration in all formats that can be written, in alphabetical order."""
    size = "{}x{}".format(*calibration.intrinsics.image_size)
    stem = f"{slug(calibration.camera.model or '')}-{size}"
    return tuple(
        _download(calibration, record, f"{stem}-{record.name}{record.suffixes[0]}")
        for record in parsers.formats()
        if record.write is not None
    )


def _download(calibration: Calibration, record: parsers.Format, name: str) -> Download:
    reason = reason_for_fit(calibration, record.capacity) if record.capacity is not None else None
    if reason is not None:
        remark = f"{reason}; calibrary convert fits the nearest and says how far it is off"
        return Download(format=record.name, title=record.title, remark=remark)
    try:
        data, verdict = parsers.encode([calibration], record, name=name)
    except InputError as error:
        return Download(format=record.name, title=record.title, remark=error.message)
    return Download(
        format=record.name,
        title=record.title,
        name=name,
        data=data,
        remark=str(replace(verdict, dropped=())),
        left_out=", ".join(verdict.dropped) or "nothing",
    )


GRID = (17, 13)
MOST_SOURCES = 60
WHOLE = ("mrcal", "opencv_storage", "keyed_text")
"""Formats that represent most lenses completely."""

STRONG = 0.7
"""Smallest correlation that is mentioned."""


def camera_page(
    entry: Entry,
    *,
    id_: str,
    place: Place,
    revisions: Sequence[EntryRevision],
    changes: Sequence[Step],
    files: Sequence[Download],
    approvals: Sequence[Evidence] = (),
    is_proposed: bool = False,
) -> View:
    """Make the page of an entry.

    Args:
        entry: the present entry.
        id_: its longest KEY.
        place: location of the page.
        revisions: of the entry, newest first.
        changes: of its calibration, newest first.
        files: to download.
        approvals: of the entry.
        is_proposed: whether a proposal to replace it waits for approval.
    """
    calibration = entry.calibration
    newest = revisions[0].revision if revisions else None

    def way_to(_: Download, name: str) -> str:
        return way(place.page, place.file(name))

    lead = f"Grade: {calibration.grade.value}, {_origin(calibration)}."
    if newest is not None:
        lead += f" Last changed on {newest.authored:%Y-%m-%d} by {newest.author.name}."
    return View(
        title=f"{entry.label}: {calibration.camera}" if entry.label is not None else str(calibration.camera),
        badge=Badge(entry.status.value, STATUSES[entry.status]),
        lead=lead,
        sections=(
            Section(title="Which K to use", blocks=tuple(_use(entry, id_, place, is_proposed=is_proposed))),
            Section(title="K", blocks=tuple(_k(entry, id_))),
            Section(title="Lens", blocks=tuple(_lens(calibration)), printed=False),
            Section(title="Uncertainty", blocks=tuple(_uncertainty(calibration)), printed=False),
            Section(title="Where it is from", blocks=(*_provenance(entry), *_approved(approvals, revisions))),
            Section(title="History", blocks=tuple(story(id_, place, revisions, changes))),
            Section(title="Download", blocks=tuple(download_blocks(files, way_to)), printed=False),
        ),
        made_by=made_at(newest),
    )


def _use(entry: Entry, id_: str, place: Place, *, is_proposed: bool) -> Iterator[Block]:
    """Whether this K is to be used, for which images, and otherwise what to do."""
    yield Link("All cameras", way(place.page, INDEX))
    reason = f" Reason: {entry.reason}" if entry.reason else ""
    size = "{} × {} px".format(*entry.calibration.intrinsics.image_size)
    whose = entry.label or ("this unit" if entry.unit is not None else "every unit of this model")
    stated = [f"of {size}", f"taken by {whose}"]
    stated += [f"with {entry.firmware}"] if entry.firmware is not None else []
    stated += [f"{entry.validity}"] if entry.validity is not None else []
    said = {
        Status.APPROVED: f"Use this K for images {', '.join(stated)}.",
        Status.DRAFT: "Do not use this K yet: a draft, not approved.",
        Status.RETIRED: f"Do not use this K any more: retired. Ask which K is used for images {', '.join(stated)}.",
    }
    action = {
        Status.DRAFT: f"calibrary registry approve {id_}",
        Status.RETIRED: f"calibrary registry resolve {id_}",
    }
    yield Note(text=said[entry.status] + reason, action=action.get(entry.status), tone=STATUSES[entry.status])
    if entry.validity is not None:
        text = "The day of an image decides which K it gets: for other days an earlier one may apply; see the history."
        yield Note(text=text, action="calibrary registry show IMAGE")
    if is_proposed:
        text = "Another K is proposed to replace it, and is not used before it is approved."
        yield Note(text=text, action=f"calibrary registry show {id_}@proposed", tone=Tone.CAUTION)
    named = (("label", entry.label or ""), ("tags", ", ".join(entry.tags)))
    if any(value for _, value in named):
        yield KeyValues(tuple((name, value) for name, value in named if value))


def _k(entry: Entry, id_: str) -> Iterator[Block]:
    calibration = entry.calibration
    yield KeyValues(tuple(intrinsics_items(calibration)))
    # 10⁻⁴ px is beyond the precision of any calibration; the files below have all digits.
    values = calibration.intrinsics.matrix.round(4)
    rows = ",\n ".join("[" + ", ".join(repr(float(value)) for value in row) + "]" for row in values)
    yield Code(text=f"[{rows}]", label="K, counted from the outer corner of the first pixel")
    if entry.override is not None:
        text = f"This K contradicts what is known of its camera, and is used in spite of that. Reason: {entry.override}"
        yield Note(text=text, tone=Tone.CAUTION)
    yield "Pixels are counted from the outer corner of the top-left one; OpenCV's cx and cy are half a pixel less."
    yield from distortion_blocks(calibration)
    yield Code(text=f"calibrary registry show {id_}", label="The command that shows this entry")


def _approved(approvals: Sequence[Evidence], revisions: Sequence[EntryRevision]) -> Iterator[Block]:
    """Who approved the present content, and in which commit."""
    commits = {path: one.revision.commit for one in revisions for path in one.revision.beside}
    if approvals:
        said = ((f"{one.made[:10]} by {one.by}", commits.get(one.path)) for one in approvals)
        yield KeyValues(
            tuple(("approved", f"{by}, commit {commit[:12]}" if commit else by) for by, commit in said)
        )


def _lens(calibration: Calibration) -> Iterator[Block]:
    if calibration.distortion is None:
        yield "Nothing is known of it, so there is nothing to draw."
        return
    if not calibration.distortion.coefficients:
        yield "Where a pinhole would show a point is where this image shows it."
        return
    size = calibration.intrinsics.image_size
    points = pixel_grid(size, GRID if size[0] >= size[1] else GRID[::-1])
    moved = displacement(calibration, points.reshape(-1, 2)).reshape(points.shape)
    axis = Axis("displacement by the lens", "px")
    arrows = arrow_map(
        points,
        moved,
        size,
        axis=axis,
        caption="From where a pinhole would see a point to where this lens shows it.",
    )
    amounts = amount_map(
        points,
        np.hypot(moved[..., 0], moved[..., 1]),
        size,
        axis=axis,
        caption="How far the lens moves each part of the image.",
    )
    yield SideBySide((arrows, amounts))


def _uncertainty(calibration: Calibration) -> Iterator[Block]:
    quality = calibration.quality
    if quality is not None:
        stated = (
            ("reprojection error (RMS)", quality.rms_px, "{:.3g} px"),
            ("views", quality.views, "{}"),
            ("points", quality.points, "{}"),
            ("coverage of the image", quality.coverage, "{:.0%}"),
            ("variance factor κ²", quality.kappa2, "{:.3g}"),
        )
        items = tuple((name, form.format(value)) for name, value, form in stated if value is not None)
        if items:
            yield KeyValues(items)
    spread = spread_of(calibration)
    if spread.covariance is None:
        prior, K = PRIORS[calibration.grade], calibration.intrinsics
        yield Note(
            text=f"Its source states no uncertainty. A K of grade {calibration.grade.value} is usually worth "
            f"± {number(prior.focal * K.fx)} px of fx and ± {number(prior.centre * K.image_size[0])} px of the "
            "principal point."
        )
        return
    yield f"σ: {spread.source}."
    drawn = _spread_map(calibration, spread.covariance)
    if drawn is not None:
        yield drawn
    if quality is not None and quality.covariance is not None:
        told = _strongest(quality.covariance)
        yield Bullets(told) if told else "No two of its parameters are strongly correlated."


def _spread_map(calibration: Calibration, covariance: Covariance) -> Figure | None:
    try:
        found = projection_uncertainty(calibration, covariance, shape=GRID)
    except (CalibraryError, np.linalg.LinAlgError):
        return None
    return amount_map(
        found.pixels,
        found.std_px,
        calibration.intrinsics.image_size,
        axis=Axis("1 σ of the pixel of a far point", "px"),
        caption="1 σ of the pixel in which a far point is seen, the camera free to turn. "
        "It is largest where nothing was observed.",
    )


def _strongest(covariance: Covariance) -> tuple[str, ...]:
    rho = covariance.correlation
    pairs = [
        (abs(rho[row, column]), row, column)
        for row in range(len(rho))
        for column in range(row)
        if math.isfinite(rho[row, column]) and abs(rho[row, column]) >= STRONG
    ]
    return tuple(
        minus(
            f"{covariance.names[column]} moves with {covariance.names[row]}: correlation {rho[row, column]:+.2f}"
        )
        for _, row, column in sorted(pairs, reverse=True)[:5]
    )


def _provenance(entry: Entry) -> Iterator[Block]:
    calibration = entry.calibration
    made, camera = calibration.provenance, calibration.camera
    stated = (
        *(facts(made) if made != UNSTATED else (("source", "not stated"),)),
        ("for firmware", str(entry.firmware) if entry.firmware is not None else None),
        ("valid", str(entry.validity) if entry.validity is not None else None),
        ("tolerance", f"± {entry.tolerance:.2%} of fx" if entry.tolerance is not None else None),
        ("serial number", f"hash {camera.serial}" if camera.serial is not None else None),
        ("supersedes", entry.supersedes),
        ("also called", ", ".join(f"{alias.make} {alias.model}" for alias in entry.aliases) or None),
    )
    yield KeyValues(tuple((name, value) for name, value in stated if value))
    if entry.notes:
        yield Bullets(tuple(entry.notes))
    if made.sources:
        shown = made.sources[:MOST_SOURCES]
        more = (f"and {len(made.sources) - len(shown)} more",) if len(made.sources) > len(shown) else ()
        files = Bullets((*(f"{file.name}, sha256 {file.sha256}" for file in shown), *more))
        yield Details(summary=f"The {len(made.sources)} files behind it", blocks=(files,))
    yield Details(summary="Every field of the entry", blocks=(KeyValues(tuple(entry_rows(entry))),))


def download_blocks(files: Sequence[Download], way_to: Callable[[Download, str], str]) -> Iterator[Block]:
    """Table of files to download, and what cannot be; ``way_to`` gives the link to a file of this name."""
    held = [file for file in files if file.name is not None]
    yield Table(
        caption="The calibration in every format that can contain it; each file was read back and compared",
        columns=(Column("format"), Column("file"), Column("contains"), Column("leaves out")),
        rows=tuple(
            (file.title, Link(file.name, way_to(file, file.name)), file.remark, file.left_out)
            for file in held
            if file.name is not None
        ),
    )
    without = tuple(f"{file.title}: {file.remark}" for file in files if file.name is None)
    if not without:
        return
    yield Details(summary=f"{len(without)} formats that cannot contain it", blocks=(Bullets(without),))
    best = next((file.name for file in held if file.format in WHOLE), None)
    if best is not None:
        yield Code(
            text=f"calibrary convert {best} OUT --to FORMAT --max-error-px 0.2",
            label="The command that fits another lens model to a file of this table",
        )


def _origin(calibration: Calibration) -> str:
    made = calibration.provenance
    if made == UNSTATED:
        return "of unstated origin"
    return f"from {made.tag or made.kind}" + (f" of {made.source}" if made.source is not None else "")
