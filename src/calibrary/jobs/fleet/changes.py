"""Changes of a registry: proposals before they are written, and new registries."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.exchange.add import save_file
from calibrary.jobs.exchange.material import require_reason, with_material_changes
from calibrary.records import Json, replace, to_json
from calibrary.registry.entry import Entry, Validity
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.fields import FieldChange, differences
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.errors import Conflict, FileConflictError
from calibrary.registry.git.writing import Written
from calibrary.registry.init import DRIVER, DRIVER_COMMAND, Initialised, install_driver
from calibrary.registry.paths import id_of
from calibrary.registry.proposals import Proposals, change_report, save
from calibrary.registry.registry import Registry
from calibrary.registry.sync import field_conflicts, sync_report

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import DiffReport

__all__ = [
    "FileConflictError",
    "FirmwareRange",
    "NewRegistry",
    "ProposedChange",
    "conflict_changes",
    "field_conflicts",
    "id_of",
    "sync_report",
    "validity",
]


class ProposedChange(Struct, eq=False):
    """Proposed entries with their checks; nothing is written before :meth:`write`.

    Attributes:
        registry: registry to write to.
        proposals: each entry with its changes, and the findings of the check.
        source: file that the entries were read from.
        written: the commit, after writing.
        branch: branch to write to; None for the one that is checked out.
    """

    registry: Registry
    proposals: Proposals
    source: Path | None = None
    written: Written | None = None
    branch: str | None = None

    def __post_init__(self) -> None:
        """Find the changes of an approved K that exceed the policy's limits."""
        self.proposals = with_material_changes(self.proposals, self.registry.configuration.policy)

    def comparisons(self) -> dict[str, DiffReport]:
        """Return the effect of each change of a K, by entry id, where the two can be compared."""
        from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  loading takes 0.1 s

        found = {}
        for one in self.proposals.due:
            if one.current is None or _unnoted(one.current) == _unnoted(one.entry):
                continue
            with suppress(CalibraryError):
                found[one.entry.id] = compare(
                    one.current.calibration, one.entry.calibration, self.registry.configuration.policy
                )
        return found

    def write(self, reason: str | None = None) -> Written:
        """Write the change as one commit.

        Raises:
            FileConflictError: an entry was changed since it was proposed; nothing was written.
            RegistryError: a check failed, there is nothing to write, the registry cannot be written, or an approved K
                changes by more than the policy's limits and no reason is given.
        """
        require_reason(self.proposals, reason)
        if self.source is not None:
            self.written = save_file(
                self.registry, self.proposals, self.source, reason=reason, branch=self.branch
            )
        else:
            self.written = save(self.registry, self.proposals, reason=reason, branch=self.branch)
        return self.written

    def to_dict(self) -> dict[str, Json]:
        """Return the written or proposed change as plain data for JSON (schemas/registry-change-1.schema.json)."""
        return to_json(change_report(self.registry.repo.path, self.proposals, self.written))


def _unnoted(entry: Entry) -> Calibration:
    """Return the calibration of an entry without notes, for the comparison."""
    return replace(entry.calibration, notes=())


class NewRegistry(Struct, eq=False):
    """A registry that was created or cloned.

    Attributes:
        made: complete result, as the command line shows it.
        shows_fields: whether its git shows changes of entries field by field.
    """

    made: Initialised
    shows_fields: bool = False

    @property
    def place(self) -> Path:
        """Folder of the registry."""
        return self.made.registry.repo.path

    @property
    def driver(self) -> str:
        """Shell command equivalent to :meth:`show_fields`."""
        return f"git -C {self.place} config {DRIVER} '{DRIVER_COMMAND}'"

    def show_fields(self) -> None:
        """Configure this repository's git to show changes of entries field by field.

        Raises:
            RegistryError: the configuration cannot be written.
        """
        install_driver(self.made.registry.repo)
        self.shows_fields = True

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/registry-begun-1.schema.json)."""
        return to_json(self.made.report(textconv=self.shows_fields))


def validity(first: date | None, last: date | None) -> Validity | None:
    """Return the days from ``first`` to ``last``, both included; None if neither is stated."""
    return Validity(first=first, last=last) if first is not None or last is not None else None


def conflict_changes(conflicts: Sequence[Conflict]) -> dict[str, tuple[FieldChange, ...]]:
    """Return, by path, the fields in which the entry to write differs from another writer's version."""
    found = {}
    for conflict in conflicts:
        if conflict.theirs is None or conflict.ours is None:
            continue
        try:
            theirs, ours = (
                parse_entry(data, conflict.path, require_digest=False)
                for data in (conflict.theirs, conflict.ours)
            )
        except InputError:
            continue
        found[conflict.path] = differences(theirs, ours)
    return found
