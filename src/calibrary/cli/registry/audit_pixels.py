"""``calibrary registry audit --verify``: K over time as estimated from the pixels, one line per flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.audit.from_pixels import UnitOverTime, Verification

__all__ = ["show_verification"]

VERDICTS = {"agrees": "green", "contradicts": "red", "cannot tell": "dim"}
CHANGES = {"steady": "green", "cannot tell": "dim"}
COLUMNS = (
    Column(name="day"),
    Column(name="flight", rank=2, wraps=True),
    Column(name="firmware", rank=4),
    Column(name="K from", rank=3),
    Column(name="fx of K", rank=1, right=True),
    Column(name="by the pixels", right=True),
    Column(name="verdict"),
    Column(name="reason", rank=5, wraps=True),
)


def show_verification(screen: Screen, done: Verification) -> None:
    """Show a table for each unit with the changes of its K, then the flights that were not used."""
    from calibrary.cli.console import plain

    for unit in done.units:
        screen.say(f"[bold]K over time by the pixels[/]: {plain(unit.name)}")
        _show_unit(screen, unit)
    if not done.units:
        screen.say("[dim]no flight has 8 images of one camera and day and a K to compare them with[/]")
    if done.left_out:
        flights = "1 flight was" if done.left_out == 1 else f"{done.left_out} flights were"
        screen.say(f"[yellow]{flights} not looked at in {done.minutes:g} min[/]: --verify-minutes")


def _show_unit(screen: Screen, unit: UnitOverTime) -> None:
    from calibrary.cli.console import plain

    rows = []
    for one in unit.flights:
        check, verdict = one.pixels, one.pixels.verdict.value
        measured = "–"
        if check.measured_fx is not None and check.std is not None:
            measured = f"{check.measured_fx:.1f} ± {check.std * check.measured_fx:.1f}"
        rows.append(
            (
                one.day.isoformat() if one.day is not None else "no day",
                plain(one.flight),
                plain(one.firmware or ""),
                plain(one.entry or "the images' tags"),
                f"{check.fx:.1f}",
                measured,
                f"[{VERDICTS[verdict]}]{verdict}[/]",
                plain(check.reason) if verdict == "cannot tell" else "",
            )
        )
    screen.show(fitted(COLUMNS, rows, screen.width - 2), indent=2)
    style = CHANGES.get(unit.change.value, "yellow")
    screen.say(f"  [{style}]{unit.change.value}[/]: {plain(unit.reason)}")
