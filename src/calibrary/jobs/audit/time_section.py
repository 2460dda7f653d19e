"""Section of an audit's page on K over time: a plot and a table for each unit with checked flights."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from calibrary.jobs.audit.from_pixels import DatedCheck, UnitOverTime, Verification
from calibrary.jobs.audit.over_time import Change
from calibrary.pages import Badge, Block, Column, Figure, Section, Tone
from calibrary.pages.plots import Axis, Role
from calibrary.pages.plots.over_time import Dated, Period, over_time
from calibrary.pages.wording import cut_table
from calibrary.sfm.pixel_check import PixelVerdict

__all__ = ["time_section"]

MOST_UNITS: Final = 50
MOST_FLIGHTS: Final = 100
COLUMNS: Final = (
    Column("day"),
    Column("verdict"),
    Column("by the pixels, ± 1 σ (px)", numeric=True),
    Column("fx of K (px)", numeric=True),
    Column("K from"),
    Column("flight"),
    Column("firmware"),
    Column("reason"),
)
ROLES: Final = {
    PixelVerdict.AGREES: Role.AGREES,
    PixelVerdict.CONTRADICTS: Role.DISAGREES,
    PixelVerdict.CANNOT_TELL: Role.NO_K,
}
TONES: Final = {
    PixelVerdict.AGREES: Tone.GOOD,
    PixelVerdict.CONTRADICTS: Tone.BAD,
    PixelVerdict.CANNOT_TELL: Tone.NEUTRAL,
}
STEADY: Final = {Change.STEADY: Tone.GOOD, Change.UNKNOWN: Tone.NEUTRAL, Change.SEVERAL_UNITS: Tone.NEUTRAL}


def time_section(done: Verification) -> Section:
    """Make the section on K over time."""
    blocks: list[Block] = [
        f"Of each unit and date up to {done.images} images of one flight were looked at; what they show does not "
        "depend on K. What the pixels cannot tell changes nothing."
    ]
    blocks += [
        Section(
            title=unit.name,
            badge=Badge(unit.change.value, STEADY.get(unit.change, Tone.CAUTION)),
            blocks=tuple(_unit(unit)),
        )
        for unit in done.units[:MOST_UNITS]
    ]
    if len(done.units) > MOST_UNITS:
        blocks.append(f"{len(done.units) - MOST_UNITS} more units are in the JSON.")
    if done.left_out:
        blocks.append(
            f"{done.left_out} more flights were not looked at within {done.minutes:g} min (--verify-minutes)."
        )
    return Section(title="K over time, by the pixels", blocks=tuple(blocks), printed=False)


def _unit(unit: UnitOverTime) -> Iterator[Block]:
    yield f"By the pixels: {unit.reason}."
    figure = _plot(unit)
    if figure is not None:
        yield figure
    caption = f"The flights of {unit.name} that were looked at"
    rows = [_row(one) for one in unit.flights]
    yield from cut_table(caption, COLUMNS, rows, most=MOST_FLIGHTS, rest="the JSON")


def _row(one: DatedCheck) -> tuple[str | Badge, ...]:
    check = one.pixels
    measured = "–"
    if check.measured_fx is not None and check.std is not None:
        measured = f"{check.measured_fx:.1f} ± {check.std * check.measured_fx:.1f}"
    return (
        one.day.isoformat() if one.day is not None else "–",
        Badge(check.verdict.value, TONES[check.verdict]),
        measured,
        f"{check.fx:.1f}",
        one.entry or "the images' tags",
        one.flight,
        one.firmware or "–",
        check.reason,
    )


def _plot(unit: UnitOverTime) -> Figure | None:
    """Plot of the measured fx by date against the registered fx; None without measurements."""
    measured = [
        Dated(day=one.day, value=fx, std=std * fx, role=ROLES[one.pixels.verdict])
        for one in unit.flights
        if one.day is not None
        and (fx := one.pixels.measured_fx) is not None
        and (std := one.pixels.std) is not None
    ]
    if not measured:
        return None
    periods = {
        (one.entry, one.pixels.fx, one.valid_from, one.valid_until): Period(
            first=one.valid_from,
            last=one.valid_until,
            value=one.pixels.fx,
            tolerance=(one.tolerance or 0.0) * one.pixels.fx,
            text=one.entry,
        )
        for one in unit.flights
        if one.entry is not None
    }
    dated = [one for one in unit.flights if one.day is not None and one.firmware is not None]
    marks = [
        (after.day, f"firmware {after.firmware}")
        for before, after in pairwise(dated)
        if before.firmware != after.firmware and after.day is not None
    ]
    return over_time(
        measured,
        [*periods.values()],
        axis=Axis("fx", "px"),
        caption="What the pixels of each date show, ± 3 σ. Line and shade: the registered K with its tolerance, over "
        "the days that it is valid on. A square cannot tell.",
        marks=marks,
    )
