"""``calibrary registry``: the fleet's calibrations in git, a module for each subcommand, and the registry they use."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from calibrary.cli.commands import Command
from calibrary.cli.flags import add_flags, call
from calibrary.cli.shown import Group, Shown
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

LISTED = (
    ("init", "create a registry, or copy one"),
    ("add", "put calibrations into the registry: a file, a folder, the catalogue"),
    ("list", "list the cameras of the fleet"),
    ("show", "show one entry, as it is or as it was, or the one of an image"),
    ("resolve", "print the K of an image or a camera, and its use, in one line"),
    ("check", "is the registry sound? check every entry, or what changed"),
    ("audit", "is what flew right? compare the registry with images of flights"),
    ("status", "what waits, and for whom?"),
    ("approve", "approve proposals"),
    ("retire", "stop using entries"),
    ("set", "set labels, tags, notes or days of entries, by a table too"),
    ("log", "list the revisions of an entry or of all"),
    ("export", "write all entries for another program"),
    ("lock", "pin the entries that a run uses"),
    ("sync", "fetch the commits of others, put yours on top and send them"),
    ("publish", "write the registry as files that programs read from a web server"),
    ("site", "write the registry as web pages"),
)
MODULES = {"list": "list_", "set": "set_"}
"""Modules of the commands with a name that is reserved in Python."""

DESCRIPTION = "Keep the calibrations of a fleet: one YAML file per camera, in git, with history and review."
EXAMPLES = """\
Every command uses the registry that is named with --registry; without it those in $CALIBRARY_REGISTRY, separated by
";"; else the nearest registry.yaml, in this folder or above it; else your own. 'resolve', 'extract' and 'check'
read several, and published ones at https:// addresses; the others use the first folder. --registry none uses none:
'extract' and 'check' work without a registry, and without a word where none is found.

KEY is make/model[/variant] in any case, as short as it is unambiguous: fc6310r, dji/fc6310r. A unit's label (P4R-03),
its serial number and the first digits of its hash (0e25) are KEYs too; P4R-03/5472 is one of its entries.

KEY@REV is the entry as it was: at a commit, tag or branch, on a day (fc6310r@2026-05-01), or for a firmware
(fc6310r@firmware:01.09).

exit codes: 0 good; 1 something is wrong with an entry; 2 usage; 3 an input cannot be read; 4 the registry.
"""


COMMAND = Group(
    DESCRIPTION,
    EXAMPLES,
    [Command(name, text, f"{__name__}.{MODULES.get(name, name)}") for name, text in LISTED],
)


class OfRegistry(Shown):
    """A command that calls a method of the selected registry.

    Args:
        at: whether an earlier state may be selected.
        used: the paths of the entries that a result uses; that others wait for approval in their place is noted.
    """

    def __init__(
        self,
        *declared: Any,
        at: bool = False,
        used: Callable[[Any], Iterable[str]] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(*declared, **more)
        self._at, self._used = at, used

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments, with ``--registry``, and ``--at`` for an earlier state."""
        super().add_arguments(parser)
        add_flags(parser, Fleet.named, without=() if self._at else ("at",))

    def done(self, arguments: argparse.Namespace, job: Callable[..., Any] | None = None) -> Any:
        """Call the method of the selected registry."""
        fleet = opened(arguments)
        done = super().done(arguments, job or getattr(fleet, self.job.__name__))
        if self._used is not None and (sentence := fleet.waiting(self._used(done))) is not None:
            from calibrary.cli.console import note

            note(arguments).say(("note", "yellow"), f" {sentence}")
        return done


def where(arguments: argparse.Namespace) -> str:
    """Return the flag that selects the same registry in the next command; empty if none was given."""
    return f" --registry {shlex.quote(str(arguments.registry))}" if arguments.registry is not None else ""


def opened(arguments: argparse.Namespace) -> Fleet:
    """Open the selected registry, at the selected state.

    Raises:
        RegistryError: no registry is selected.
    """
    return call(Fleet.named, arguments)


def entries(count: int) -> str:
    """Return a number of entries in words."""
    return "1 entry" if count == 1 else f"{count} entries"


def note_cut(arguments: argparse.Namespace, registry: Fleet) -> None:
    """Report on standard error if the history is incomplete."""
    from calibrary.cli.console import note

    if registry.cut is not None:
        note(arguments).say(registry.cut)
