"""What an answer for a camera shows: which K, why, what contradicts it, and what a solver may do with it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from calibrary.calibration import Calibration
from calibrary.jobs.resolve.run import FleetAnswer, UsedEntry
from calibrary.jobs.use import Allowed
from calibrary.pages.wording import distortion_blocks, intrinsics_items, made_by
from calibrary.provenance import facts
from calibrary.registry.history import story
from calibrary.validation import Use
from calibrary.view import Badge, Block, Bullets, Cell, KeyValues, Note, Section, Tone, View

TONES: Final = {Use.FIXED: Tone.GOOD, Use.START: Tone.CAUTION, Use.NONE: Tone.BAD}
USES: Final = {
    Use.FIXED: "A solver may keep it fixed",
    Use.START: "A solver may start from it, and refines it",
    Use.NONE: "A solver may not use it",
}


def told(found: FleetAnswer) -> View:
    """Describe the answer of one or several registries for a camera."""
    tone = TONES[found.allowed.use] if found.allowed is not None else Tone.BAD
    sections = [Section(title=_title(found), blocks=tuple(_answer(found, tone)))]
    if found.near:
        near = tuple(f"{one.path}: {one.reason}" for one in found.near)
        sections.append(Section(title="Near, but not used", blocks=(Bullets(near),)))
    return View(
        title=f"Which K for {found.camera}?",
        lead=_lead(found),
        badge=Badge(found.use or "none", tone),
        sections=tuple(sections),
        made_by=made_by(),
    )


def _title(found: FleetAnswer) -> str:
    if found.calibration is not None:
        return "The K to use"
    return "No K to use" if found.path is not None else "No K"


def _lead(found: FleetAnswer) -> str:
    if found.path is None:
        return f"No approved K applies to {found.camera} on {found.on}."
    if found.calibration is None:
        return f"The K of {found.path} may not be used for {found.camera}: {found.use_reason}."
    return f"{found.use}: {found.use_reason}."


def _answer(found: FleetAnswer, tone: Tone) -> Iterator[Block]:
    """The verdict with what to do, what contradicts it, and the numbers."""
    K, entry = found.calibration, found.entry
    if K is None:
        todo = "approve a proposal, or put a calibration into the registry" if found.path is None else None
        yield Note(text=_lead(found), action=found.remedy or todo, tone=tone)
    else:
        label = f" ({entry.label})" if entry is not None and entry.label else ""
        text = f"Use this K for {found.camera}{label} on {found.on}: {found.why}."
        yield Note(text=text, action=found.remedy, tone=Tone.GOOD)
    yield from (Note(text=text, tone=Tone.CAUTION) for text in (*found.disagreements, *found.warnings))
    if entry is not None and entry.override:
        text = f"It contradicts what is known of its camera: {entry.override}"
        yield Note(text=text, action="look at its limits", tone=Tone.CAUTION)
    if entry is not None and entry.proposal is not None:
        yield Note(text=f"Another K is proposed to replace it: {entry.proposal}", tone=Tone.CAUTION)
    yield KeyValues(tuple(_where(found, entry, tone)))
    for one in found.possible:
        how = "; ".join(one.steps) or "of this size"
        numbers = ", ".join(
            f"{name} {getattr(one.intrinsics, name):.2f}" for name in ("fx", "fy", "cx", "cy")
        )
        yield KeyValues((("how", how), ("K, if so", f"{numbers} px")))
    if K is not None:
        yield from _numbers(K)


def _where(found: FleetAnswer, entry: UsedEntry | None, tone: Tone) -> Iterator[tuple[str, Cell]]:
    yield "camera", f"{found.camera}, by {found.known_by}"
    if found.path is not None:
        at = f" at {found.commit[:12]}" if found.commit is not None else ""
        status = entry.status.value if entry is not None else "of the type, not in any registry"
        yield "registry", found.registry
        yield "entry", f"{found.path}{at}, {status}"
        yield "use", Badge(found.use or "none", tone)
    if entry is not None:
        yield from story(entry.recorded, entry.approved)


def use_said(found: Allowed) -> str:
    """What a solver may do with a K, in a sentence."""
    return f"{USES[found.use]}: {found.why}."


def use_blocks(found: Allowed) -> Iterator[Block]:
    """What a solver may do with a K."""
    yield KeyValues((("use", Badge(found.use.value, TONES[found.use])),))
    yield use_said(found)


def _numbers(K: Calibration) -> Iterator[Block]:
    made = K.provenance
    yield KeyValues(
        (
            *intrinsics_items(K),
            ("adapted", made.adaptation or "no, it is of this size"),
            *(("assumed", text) for text in made.assumptions),
            ("grade", K.grade.value),
            ("distortion", K.distortion.model if K.distortion is not None else "unknown"),
        )
    )
    yield from distortion_blocks(K)
    yield KeyValues(facts(made, traced=False))
