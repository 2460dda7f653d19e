"""What a comparison shows: the verdict, all numbers, and the difference over the image and on the ground."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from calibrary.arrays import BoolArray
from calibrary.calibration import Calibration
from calibrary.jobs.diff.comparison import ChangeVerdict, DiffReport, Numbers, Parameter
from calibrary.jobs.diff.fleet import EntryChange, FleetDiffReport
from calibrary.jobs.diff.wording import chance, length, percent, pixels
from calibrary.pages.plots.canvas import Axis, number
from calibrary.pages.plots.svg_plots import amount_map, arrow_map
from calibrary.pages.wording import count, made_by, minus, rounded, sentence
from calibrary.provenance import facts
from calibrary.records import replace
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Figure,
    KeyValues,
    Link,
    Note,
    Plots,
    Section,
    SideBySide,
    Table,
    Tone,
    View,
)

TONES = {
    ChangeVerdict.IDENTICAL: Tone.GOOD,
    ChangeVerdict.NOISE: Tone.GOOD,
    ChangeVerdict.NEGLIGIBLE: Tone.GOOD,
    ChangeVerdict.UNRESOLVED: Tone.CAUTION,
    ChangeVerdict.DRIFT: Tone.BAD,
    ChangeVerdict.STRUCTURAL: Tone.BAD,
}
MEANINGS = {
    ChangeVerdict.IDENTICAL: "Both say the same.",
    ChangeVerdict.NOISE: "They differ by no more than their measured uncertainty.",
    ChangeVerdict.NEGLIGIBLE: "They differ by too little to be seen on a map.",
    ChangeVerdict.UNRESOLVED: "They may be the same or not: their uncertainty is larger than the limits.",
    ChangeVerdict.DRIFT: "They differ by enough to be seen on a map, and no noise explains it.",
    ChangeVerdict.STRUCTURAL: "The image size, lens or convention changed, or parameters were lost; this is not drift.",
}
IN_PX = frozenset({"fx", "fy", "cx", "cy", "skew"})

PARAMETERS = (
    Column("parameter"),
    Column("A", numeric=True),
    Column("σ of A", numeric=True, rank=2),
    Column("B", numeric=True),
    Column("σ of B", numeric=True, rank=2),
    Column("Δ", numeric=True),
    Column("Δ / σ", numeric=True, rank=1),
)

EVERY = 2
"""Step of the drawn points on the grid on which a difference was computed."""

MOST_SECTIONS = 200
"""Most comparisons of a fleet shown in full, worst first."""


def told(comparison: DiffReport | FleetDiffReport, altitude_m: float | None = None) -> View:
    """Describe a comparison of two calibrations, or of a fleet then and now.

    Args:
        comparison: the result.
        altitude_m: altitude above ground, for the effect on the ground; by default as it was compared.
    """
    if isinstance(comparison, FleetDiffReport):
        return told_fleet(comparison)
    a, b = comparison.a, comparison.b
    camera = b.calibration.camera if b.calibration.camera.model is not None else a.calibration.camera
    if altitude_m is None:
        altitude_m = comparison.numbers.ground.altitude_m if comparison.numbers is not None else 100.0
    badge = badge_of(comparison)
    attention = ", needs attention" if comparison.alarm else ""
    return View(
        title=f"Has K moved? {camera}",
        badge=badge,
        lead=f"{badge.text}{attention}. {comparison.advice}",
        facts=tuple(_of_each(comparison)),
        sections=comparison_sections(comparison, altitude_m),
        made_by=made_by(f"from {a.label} and {b.label}"),
    )


def _of_each(comparison: DiffReport) -> Iterator[tuple[str, Cell]]:
    """How A and B were made as far as it is known of either; once where both say the same."""
    sides = (comparison.a, comparison.b)
    a, b = (dict(facts(side.calibration.provenance, traced=False)) for side in sides)
    for name in dict.fromkeys([*a, *b]):
        stated = [f"{letter}: {of[name]}" for letter, of in (("A", a), ("B", b)) if name in of]
        yield name, f"A and B: {a[name]}" if a.get(name) == b.get(name) else "; ".join(stated)


def comparison_sections(comparison: DiffReport, altitude_m: float) -> tuple[Section, ...]:
    """The sections of a comparison, in the order in which they are needed for a decision."""
    numbers = comparison.detail
    sections = [Section(title=f"Which K to use: {comparison.use.value}", blocks=tuple(_verdict(comparison)))]
    if numbers is not None:
        sections += [
            Section(title="Parameters", blocks=tuple(_in_numbers(numbers))),
            Section(title="Over the image", blocks=tuple(_over_the_image(numbers))),
            Section(title="On the ground", blocks=tuple(_on_the_ground(numbers, altitude_m))),
        ]
    sections.append(Section(title="Where both are from", blocks=(_sources(comparison),), printed=False))
    return tuple(sections)


def told_fleet(found: FleetDiffReport, title: str = "the fleet", altitude_m: float = 100.0) -> View:
    """Describe all changed cameras of a fleet.

    Args:
        found: the changes.
        title: what was compared: "the fleet since v1.0".
        altitude_m: altitude above ground, for the effect on the ground.
    """
    changes, nothing = found.changes, found.unmatched or "no entry differs"
    alarms = sum(change.alarm for change in changes)
    sections = [Section(title="Overview", anchor="overview", blocks=tuple(_overview(changes)))]
    sections += [
        Section(
            title=change.id,
            badge=_badge(change),
            anchor=f"entry-{n}",
            blocks=tuple(_change(change, altitude_m)),
            printed=False,
        )
        for n, change in enumerate(changes[:MOST_SECTIONS])
    ]
    verdicts = Counter(_badge(change).text for change in changes)
    counts = ", ".join(f"{number} {verdict}" for verdict, number in verdicts.items())
    judged = f"{alarms} need{'s' * (alarms == 1)} attention" if alarms else "nothing to do"
    return View(
        title=f"Has K moved? {title}",
        badge=Badge("look at it" if found.alarm else "nothing to look at", _tone(found)),
        lead=f"{judged}: {count(len(changes), 'entry', 'entries')}: {counts}" if changes else nothing,
        sections=tuple(sections) if changes else (),
        contents=False,
        made_by=made_by(),
    )


def badge_of(comparison: DiffReport) -> Badge:
    """Badge of the verdict; a structural change that needs no attention has its own tone."""
    kinds = ", ".join(one.kind.value for one in comparison.structural)
    text = f"{comparison.verdict.value}{f': {kinds}' if kinds else ''}"
    if comparison.verdict is ChangeVerdict.STRUCTURAL and not comparison.alarm:
        return Badge(text, Tone.CAUTION)
    return Badge(text, TONES[comparison.verdict])


def _verdict(comparison: DiffReport) -> Iterator[Block]:
    yield KeyValues((("A", comparison.a.label), ("B", comparison.b.label)))
    yield MEANINGS[comparison.verdict]
    kinds = {one.reason: one.kind.value for one in comparison.structural}
    yield Bullets(
        tuple(
            sentence((f"{kinds[reason]}: " if reason in kinds else "") + reason)
            for reason in comparison.reasons
        )
    )
    for warning in comparison.warnings:
        yield Note(text=sentence(warning), tone=Tone.CAUTION)
    if comparison.steps:
        yield f"To be compared at all, {'; '.join(comparison.steps)}."
    if comparison.numbers is None:
        yield "No scale and no crop brings the two to one frame, so their numbers are not compared."


def _in_numbers(numbers: Numbers) -> Iterator[Block]:
    width, height = numbers.a.intrinsics.image_size
    table = Table(
        caption=f"Every parameter of both, at {width} × {height} px; fx, fy, cx, cy in px",
        columns=PARAMETERS,
        rows=tuple(_parameter(row) for row in numbers.parameters),
    )
    found = numbers.significance
    facts = KeyValues(
        (
            ("change of the focal length", minus(percent(numbers.focal_change))),
            (
                "chance of it from noise",
                chance(found.p) if found.p is not None else "unknown",
            ),
            ("uncertainty of the difference", numbers.significance.basis.value),
            ("σ of A", found.spread_a),
            ("σ of B", found.spread_b),
        )
    )
    yield SideBySide((table, facts))


def _parameter(row: Parameter) -> tuple[Cell, ...]:
    form = ".2f" if row.name in IN_PX else ".6g"
    a = rounded(row.a, row.std_a, form) if row.a is not None else ("–", "–")
    b = rounded(row.b, row.std_b, form) if row.b is not None else ("–", "–")
    known = [len(text.partition(".")[2]) for text in (a[1], b[1]) if text != "–"]
    delta = f"{{:+.{min(known)}f}}" if known else "{:+.2f}" if row.name in IN_PX else "{:+.2g}"
    return (row.name, *a, *b, _cell(row.delta, delta if row.delta else "0"), _cell(row.z, "{:+.1f}"))


def _over_the_image(numbers: Numbers) -> Iterator[Block]:
    seen, policy, unknown = numbers.difference, numbers.policy, numbers.unknown
    yield KeyValues(
        (
            ("difference (RMS)", f"{pixels(seen.rms_px)} (limit {policy.drift_rms_px:g} px)"),
            ("largest difference", f"{pixels(seen.max_px)} (limit {policy.drift_max_px:g} px)"),
            (
                "change of the image scale",
                f"{minus(percent(numbers.scale.change))} (limit {policy.drift_focal:.2%})",
            ),
            ("in the centre (RMS)", pixels(seen.centre_rms_px)),
            ("camera turned by", f"{number(round(seen.rotation_deg, 4))}°"),
            ("unknown in", f"{unknown.mean():.0%} of the image"),
        )
    )
    yield (
        "A camera that is free to turn takes up a part of any difference, and a reconstruction turns it so; "
        "that rotation is taken out first."
    )
    if round(seen.max_px, 3):
        yield Plots(partial(_maps, numbers, seen.region & ~unknown))


def _maps(numbers: Numbers, known: BoolArray) -> Iterator[Figure]:
    seen = numbers.difference
    points, vectors, inside = (grid[::EVERY, ::EVERY] for grid in (seen.pixels, seen.vectors, known))
    grey = "" if inside.all() else " Grey: unknown, known to no better than the limit."
    yield arrow_map(
        points,
        vectors,
        seen.image_size,
        axis=Axis("difference of the projections", "px"),
        caption=f"From where A sees a direction to where B sees it.{grey}",
        inside=inside,
    )
    if seen.std_px is None:
        return
    std = seen.std_px[::EVERY, ::EVERY]
    with np.errstate(all="ignore"):
        z = np.where(std > 0, np.hypot(vectors[..., 0], vectors[..., 1]) / std, np.nan)
    yield amount_map(
        points,
        z,
        seen.image_size,
        axis=Axis("difference", "σ"),
        caption="How large the difference is against its own uncertainty: up to 2 or 3 is noise.",
        inside=inside,
    )
    yield amount_map(
        points,
        std,
        seen.image_size,
        axis=Axis("1 σ of the difference", "px"),
        caption=f"Uncertainty of the difference: {numbers.significance.basis.value}.",
        inside=inside,
    )


def _on_the_ground(numbers: Numbers, altitude_m: float) -> Iterator[Block]:
    ground = numbers.ground(altitude_m)
    yield KeyValues(
        (
            ("altitude above ground", f"{altitude_m:g} m"),
            ("pixel on the ground (GSD)", f"{number(ground.gsd_cm)} cm"),
            ("difference (RMS)", length(ground.rms_cm / 100)),
            ("largest difference", length(ground.max_cm / 100)),
            ("error of heights", minus(length(ground.height_cm / 100, signed=True))),
        )
    )
    yield "Heights err with the image scale where no control point holds them: Δh = h · Δf / f."


def _sources(comparison: DiffReport) -> Table:
    a, b = _provenance_facts(comparison.a.calibration), _provenance_facts(comparison.b.calibration)
    names = [name for name in dict.fromkeys([*a, *b]) if a.get(name) or b.get(name)]
    return Table(
        caption="Where both calibrations are from",
        columns=(Column("what"), Column("A"), Column("B")),
        rows=(
            ("called", comparison.a.label, comparison.b.label),
            *((name, a.get(name) or "–", b.get(name) or "–") for name in names),
        ),
    )


def _provenance_facts(calibration: Calibration) -> dict[str, str | None]:
    made = calibration.provenance
    lens, quality = calibration.distortion, calibration.quality
    return {
        "camera": str(calibration.camera),
        "image": "{} × {} px".format(*calibration.intrinsics.image_size),
        "grade": calibration.grade.value,
        "distortion": lens.model if lens is not None else "unknown",
        "reprojection error (RMS)": f"{quality.rms_px:.3g} px"
        if quality is not None and quality.rms_px is not None
        else None,
        **dict(facts(replace(made, firmware=made.firmware or calibration.camera.firmware))),
    }


def _tone(found: FleetDiffReport) -> Tone:
    return Tone.BAD if found.alarm else Tone.GOOD


CHANGES = (
    Column("entry", lambda row: row[0]),
    Column("verdict", lambda row: _badge(row[1])),
    Column("Δf / f", lambda row: _if_known(row[1].focal_change, percent), numeric=True, rank=1),
    Column("difference (RMS)", lambda row: _if_known(row[1].rms_px, pixels), numeric=True, rank=2),
    Column("largest", lambda row: _if_known(row[1].max_px, pixels), numeric=True, rank=3),
    Column("reason", lambda row: _reason(row[1]), below=""),
)


def _overview(changes: Sequence[EntryChange]) -> Iterator[Block]:
    rows = [
        (Link(change.id, f"#entry-{n}") if n < MOST_SECTIONS else change.id, change)
        for n, change in enumerate(changes)
    ]
    yield Table.of("Every entry that changed, those to look at first", rows, CHANGES)
    if len(changes) > MOST_SECTIONS:
        yield f"The {len(changes) - MOST_SECTIONS} least of them are in this table only."


def _if_known(value: float | None, told: Callable[[float], str]) -> str:
    return minus(told(value)) if value is not None else "–"


def _reason(change: EntryChange) -> str:
    """Of what is compared, that its badge does not say; of what cannot be, why."""
    return change.reasons[0] if change.verdict is None and change.alarm else ""


def _badge(change: EntryChange) -> Badge:
    if change.comparison is not None:
        return badge_of(change.comparison)
    return Badge("not compared", Tone.BAD) if change.alarm else Badge(change.reasons[0], Tone.NEUTRAL)


def _change(change: EntryChange, altitude_m: float) -> Iterator[Block]:
    if change.comparison is None:
        yield Note(text=sentence(change.reasons[0]), tone=_badge(change).tone)
        return
    yield from comparison_sections(change.comparison, altitude_m)


def _cell(value: float | None, form: str) -> str:
    return minus(form.format(value)) if value is not None else "–"
