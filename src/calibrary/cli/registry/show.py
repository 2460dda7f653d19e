"""``calibrary registry show``: an entry, now or at a revision, what changed between the two, or the one of an image."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, note_cut, opened
from calibrary.jobs.fleet import Fleet
from calibrary.jobs.resolve import names_image, resolve

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.calibration import Calibration
    from calibrary.cli.console import Screen
    from calibrary.cli.words import Words
    from calibrary.jobs.fleet import Approval, FieldChange, Recorded, ShownEntry
    from calibrary.jobs.resolve.run import FleetAnswer, UsedEntry

DESCRIPTION = (
    "Show one entry, as it is or as it was, or the one that applies to an image, with its K and its use."
)
EXAMPLES = """\
examples:
  calibrary registry show dji/fc6310r
  calibrary registry show dji/fc6310r@proposed          what is proposed to replace it
  calibrary registry show fc6310r@2026-05-01            as it was at the end of that day
  calibrary registry show fc6310r@firmware:01.09        as it was made for that firmware
  calibrary registry show fc6310r --diff v2026.1        what changed since that tag
  calibrary registry show fc6310r --yaml                the file itself
  calibrary registry show flight/DJI_0001.JPG           the entry of this image, K at its size, and what it may do

Of an image it tells what 'registry resolve' prints in one line: from the same registries, with the same exit code.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    if arguments.against is not None and arguments.yaml:
        arguments.parser.error("--diff: not together with --yaml; git diff compares files")
    return _show_of_image(arguments) if names_image(arguments.key) else _show(arguments)


def _show_of_image(arguments: argparse.Namespace) -> int:
    from calibrary.cli.registry.resolve import answered

    if arguments.against is not None or arguments.yaml:
        arguments.parser.error(
            "--diff and --yaml: of an entry; without them 'show IMAGE' tells which one it is"
        )
    found = resolve(arguments.key, registry=arguments.registry, history=True)
    return answered(arguments, found, _tell)


def _show(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import out
    from calibrary.cli.registry.changes import change_table

    registry = opened(arguments)
    shown = call(registry.show, arguments)
    if arguments.json:
        print_json(shown)
    elif arguments.yaml:
        sys.stdout.buffer.write(registry.file(shown))
    elif shown.against is None or shown.changes is None:
        _describe(out(arguments), shown)
        note_cut(arguments, registry)
    else:
        screen = out(arguments)
        screen.say(*_summary(arguments.key, shown.against, shown.changes))
        if shown.changes:
            screen.show(change_table(shown.changes, screen.width))
    return 0


def _summary(key: str, against: str, changes: tuple[FieldChange, ...]) -> tuple[Words, ...]:
    if not changes:
        return (f"{key} says what {against} said",)
    return (key, "bold"), f" against {against}"


def _describe(screen: Screen, shown: ShownEntry) -> None:
    from calibrary.cli.tables import facts

    label = f"{shown.label}  " if shown.label is not None else ""
    screen.say((label + shown.id, "bold"))
    place = [
        ("file", shown.path),
        ("digest of the file", (shown.blob or "")[:12]),
        ("commit", (shown.commit or "")[:12]),
        *_proposed(shown.proposal),
    ]
    rows = [*shown.rows(), *place, *_recorded(shown.recorded), *approval_rows(shown.approved)]
    screen.show(facts([(name, value) for name, value in rows], screen.width))


def _tell(screen: Screen, found: FleetAnswer) -> None:
    from calibrary.cli.tables import facts

    entry, path, why = found.entry, found.path or "", found.why or ""
    at = f" at {found.commit[:12]}" if found.commit is not None else ""
    status = entry.status.value if entry is not None else "of the type, not in any registry"
    rows = [
        ("camera", f"{found.camera}, by {found.known_by}"),
        ("registry", found.registry),
        ("entry", f"{path}{at}, {status}"),
        ("reason", why.removeprefix(f"{path} ")),
        *(_calibration_rows(found.calibration) if found.calibration is not None else ()),
        ("use", f"{found.use}: {found.use_reason}"),
        *(_story(entry) if entry is not None else ()),
    ]
    near = [("near", f"{item.path}: {item.reason}") for item in found.near]
    shown = [(name, value) for name, value in rows if value]
    screen.show(facts([*shown, *near], screen.width))


def _calibration_rows(calibration: Calibration) -> list[tuple[str, str]]:
    from calibrary.cli.registry.resolve import numbers

    lens, made = calibration.distortion, calibration.provenance
    return [
        ("adapted", made.adaptation or "no, it is of this size"),
        *(("assumed", text) for text in made.assumptions),
        ("grade", calibration.grade.value),
        ("K", numbers(calibration.intrinsics)),
        ("distortion", lens.model if lens is not None else "unknown"),
        *((f"  {name}", f"{value:.8g}") for name, value in (lens.shown.items() if lens else ())),
        ("made from", made.tag or ""),
    ]


def _story(entry: UsedEntry) -> list[tuple[str, str]]:
    override = f"it contradicts what is known of its camera: {entry.override}" if entry.override else ""
    return [
        ("label", entry.label or ""),
        ("overridden", override),
        *_proposed(entry.proposal),
        *_recorded(entry.recorded),
        *approval_rows(entry.approved),
    ]


def _proposed(key: str | None) -> list[tuple[str, str]]:
    said = f"another K waits for approval: calibrary registry show {key}"
    return [("proposed", said)] if key is not None else []


def approval_rows(approved: Sequence[Approval]) -> list[tuple[str, str]]:
    """Rows of the approvals, one each."""
    return [
        (
            "approved",
            f"{one.date:%Y-%m-%d} by {one.by}" + (f", commit {one.commit[:12]}" if one.commit else ""),
        )
        for one in approved
    ]


def _recorded(put: Recorded | None) -> list[tuple[str, str]]:
    """Row of the person who added the calibration to the registry, who need not be the one who made it."""
    if put is None:
        return []
    from_file = f", from {put.file}" if put.file is not None else ""
    return [("recorded", f"{put.date:%Y-%m-%d} by {put.by}{from_file}, commit {put.commit[:12]}")]


class _Show(OfRegistry):
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the flags; the document and the file are printed in place of one another."""
        super().add_arguments(parser)
        form = parser.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="print one JSON document on standard output")
        form.add_argument("--yaml", action="store_true", help="print the file of the entry")


COMMAND = _Show(
    Fleet.show,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"key": "KEY[@REV]|IMAGE"},
    spelled={"against": "--diff"},
    json=False,
)
