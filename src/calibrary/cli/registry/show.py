"""``calibrary registry show``: one entry, as it is or as it was."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from rich.console import Console

    from calibrary.keep.keeper import Held

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary registry show dji/fc6310r
  calibrary registry show fc6310r@2026-05-01            as it was at the end of that day
  calibrary registry show fc6310r@firmware:01.09        as it was made for that firmware
  calibrary registry show fc6310r --yaml                the file itself
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "show",
        help="show one entry, as it is or as it was",
        description="Show one entry, as it is or as it was.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("key", metavar="KEY[@REV]")
    add_registry_flag(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON on standard output")
    form.add_argument("--yaml", action="store_true", help="print the entry's file")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import make_console
    from calibrary.keep.entry_json import held_json
    from calibrary.registry.entry_yaml import entry_yaml

    held = opened(arguments).get(arguments.key)
    if arguments.json:
        sys.stdout.write(json.dumps(held_json(held), indent=2, ensure_ascii=True, allow_nan=False) + "\n")
    elif arguments.yaml:
        sys.stdout.write(entry_yaml(held.entry).decode())
    else:
        _show(make_console(stderr=False), held)
    return 0


def _show(console: Console, held: Held) -> None:
    from rich.table import Table

    from calibrary.cli.console import plain

    table = Table(
        box=None, show_header=False, padding=(0, 2, 0, 0), title=plain(held.id), title_justify="left"
    )
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in _rows(held):
        table.add_row(name, plain(value))
    console.print(table)


def _rows(held: Held) -> list[tuple[str, str]]:
    entry, calibration = held.entry, held.entry.calibration
    K, quality, made = calibration.intrinsics, calibration.quality, calibration.provenance
    std = dict(quality.std) if quality is not None else {}
    if quality is not None and quality.covariance is not None:
        std |= quality.covariance.std
    rows = [
        ("camera", str(calibration.camera)),
        ("status", entry.status.value + (f": {entry.reason}" if entry.reason else "")),
        ("grade", calibration.grade.value),
        *(
            (name, f"{getattr(K, name):.4f}" + (f" ± {std[name]:.2g}" if name in std else "") + " px")
            for name in ("fx", "fy", "cx", "cy")
        ),
    ]
    if K.skew:
        rows.append(("skew", f"{K.skew:.6g} px"))
    if calibration.distortion is None:
        rows.append(("distortion", "unknown"))
    else:
        rows.append(("distortion", calibration.distortion.model))
        rows += [(f"  {name}", f"{value:.8g}") for name, value in calibration.distortion.coefficients.items()]
    if quality is not None:
        measured = (
            ("rms", quality.rms_px, "{:.4g} px"),
            ("views", quality.views, "{}"),
            ("κ²", quality.kappa2, "{:.3g}"),
            ("coverage", quality.coverage, "{:.0%}"),
        )
        rows += [(name, form.format(value)) for name, value, form in measured if value is not None]
    stated = (
        ("serial", calibration.camera.serial and f"hash {calibration.camera.serial}"),
        ("firmware", entry.firmware and str(entry.firmware)),
        ("valid", entry.validity and str(entry.validity)),
        ("made from", made.source or made.kind),
        ("sha256", made.sha256),
        ("made with", made.tool),
        ("made by", made.operator),
        ("made on", made.date),
        ("made at firmware", made.firmware),
        ("focus", made.focus),
        ("supersedes", entry.supersedes),
        ("commit", held.commit[:12]),
    )
    rows += [(name, value) for name, value in stated if value]
    return rows + [("note", note) for note in entry.notes]
