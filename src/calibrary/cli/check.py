"""``calibrary check``: check whether a K is right for the images of a flight before it is used."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.check import check

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.check.run import CheckReport

DESCRIPTION = (
    "Check whether the K that you are about to use is right for the images of a flight, and by how much it "
    "is off, in per cent and on the ground. ('calibrary registry check' checks the entries of a registry.)"
)
EXAMPLES = """\
examples:
  calibrary check flight/                        every calibration file beside the images
  calibrary check flight/ K.npy                  a K, of any format, for these images
  calibrary check flight/ camera.xml cameras.json --altitude-m 60
  calibrary check flight/ K.npy --json           the same for machines
  calibrary check flight/ --verify               the K of tags and files against the pixels of a dozen images

exit code 0: every file is right for every camera that it can belong to; 1: at least one is off, or the images give
no valid K to compare it with, or it is a start only, as the profile of a kind of lens.
"""

PIXEL_STYLES = {"agrees": "bold green", "contradicts": "bold red", "cannot tell": "bold yellow"}
STYLES = {"right": "bold green", "off": "bold red", "unknown": "bold yellow"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, check, positional={"images": "FOLDER", "files": "FILE"})
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    with Bar(note(arguments), "checking") as bar:
        result = call(check, arguments, progress=bar)
    if arguments.json:
        print_json(result)
    else:
        _show(out(arguments), result)
    return result.exit_code


def _show(screen: Screen, result: CheckReport) -> None:
    """Show one line per file and camera, and the answer at the end."""
    from calibrary.cli.console import plain

    for one in result.files:
        whose = f" for {one.camera}" if one.camera is not None else ""
        screen.say(f"[{STYLES[one.verdict.value]}]{one.verdict.value}[/]  {plain(f'{one.file}{whose}')}")
        screen.say(f"  {plain(one.message)}")
    for own in result.by_pixels:
        check = own.pixels
        text = f"{check.figures}; {check.reason}" if check.figures else check.reason
        style = PIXEL_STYLES[check.verdict.value]
        screen.say(f"[{style}]pixels: {check.verdict.value}[/]  {plain(f'K of {own.camera}')}")
        screen.say(f"  {plain(text)}")
    for skipped in result.not_read:
        screen.say(f"[dim]not read  {plain(f'{skipped.name}: {skipped.reason}')}[/]")
    screen.say("")
    wrong = [one for one in result.files if one.verdict.value != "right"]
    if not result.files:
        answers = {own.pixels.verdict.value for own in result.by_pixels}
        screen.say(f"[bold]the pixels say of the images' own K: {', '.join(sorted(answers)) or 'nothing'}[/]")
        return
    if not wrong and not result.is_right:
        screen.say("[bold red]the pixels contradict the K that the images state[/]")
        return
    if not wrong:
        screen.say("[bold green]the K you are about to use is right[/]")
        return
    count = f"{len(wrong)} of {len(result.files)}: " if len(result.files) > 1 else ""
    answer = wrong[0].answer or f"cannot be used: {wrong[0].message}"
    screen.say(f"[bold red]{count}the K you are about to use {plain(answer)}[/]")
