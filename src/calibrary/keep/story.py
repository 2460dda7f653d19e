"""What became of an entry, and who last said each thing in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.keep.fields import Field, entry_fields
from calibrary.keep.keeper import Keeper
from calibrary.keep.names import find_path
from calibrary.records import Json
from calibrary.registry.entry import ROOT, SUFFIX, Entry
from calibrary.registry.git.history import Revision

__all__ = ["Chapter", "Said", "blame", "blame_json", "chapters", "story_json"]

K_NAMES: Final = ("fx", "fy", "cx", "cy", "skew")


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """One commit.

    Attributes:
        revision: by whom and when.
        entry: as it left the entry; None where it removed it, wrote none that can be read, or is of several.
        before: as the entry was before it.
    """

    revision: Revision
    entry: Entry | None = None
    before: Entry | None = None

    @property
    def reason(self) -> str | None:
        """Why, as the commit says."""
        return next((value for key, value in self.revision.trailers if key == "Reason"), None)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Whose entries the commit names."""
        return tuple(value for key, value in self.revision.trailers if key == "Camera")

    @property
    def firmware(self) -> str | None:
        """Of the camera when the calibration was made, else of the range that the entry is of."""
        if self.entry is None:
            return None
        ranged = self.entry.firmware
        return self.entry.calibration.provenance.firmware or (str(ranged) if ranged is not None else None)

    @property
    def delta(self) -> dict[str, float] | None:
        """How much each number of K is more than before; None where there is nothing to compare with."""
        if self.entry is None or self.before is None:
            return None
        one, other = self.before.calibration.intrinsics, self.entry.calibration.intrinsics
        if one.image_size != other.image_size:
            return None
        return {name: float(getattr(other, name) - getattr(one, name)) for name in K_NAMES}


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """One field of an entry and the commit that last changed it."""

    field: str
    value: Field
    chapter: Chapter


def chapters(keeper: Keeper, key: str | None = None, *, most: int | None = None) -> tuple[Chapter, ...]:
    """Every revision of an entry, or of the whole registry, newest first.

    Args:
        keeper: of the registry.
        key: of an entry; one that was removed by its whole id. None is the registry.
        most: at most so many.

    Raises:
        UnknownCameraError: there is no such entry and never was.
    """
    if key is None:
        return tuple(Chapter(revision=one) for one in keeper.registry.history(most=most))
    # One more than asked for, since the oldest of them is told by what was before it.
    told = list(islice(keeper.revisions(_path(keeper, key)), most + 1 if most is not None else None))
    befores = [entry for _, entry in told[1:]] + [None]
    found = [
        Chapter(revision=revision, entry=entry, before=before)
        for (revision, entry), before in zip(told, befores, strict=True)
    ]
    return tuple(found[:most])


def blame(keeper: Keeper, key: str) -> tuple[Said, ...]:
    """Each field of an entry as it is, with the commit since which it says so.

    Raises:
        UnknownCameraError: there is no such entry.
        RegistryError: it cannot be read.
    """
    if "@" in key:
        raise RegistryError(f"{key}: it is told of the entry as it is; name it without @REV")
    held = keeper.get(key)
    told = chapters(keeper, held.id)
    fields = entry_fields(held.entry)
    return tuple(
        Said(field=name, value=value, chapter=_since(told, name, value)) for name, value in fields.items()
    )


def story_json(told: Sequence[Chapter], key: str | None) -> dict[str, Json]:
    """The JSON form of a story (schemas/registry-log-1.schema.json)."""
    return {"schema": "calibrary/registry-log-1", "key": key, "revisions": [_revision(one) for one in told]}


def blame_json(said: Sequence[Said], key: str) -> dict[str, Json]:
    """The JSON form of who said what (schemas/registry-blame-1.schema.json)."""
    return {
        "schema": "calibrary/registry-blame-1",
        "id": key,
        "fields": [
            {
                "field": one.field,
                "value": one.value,
                **_commit(one.chapter),
            }
            for one in said
        ],
    }


def _path(keeper: Keeper, key: str) -> str:
    try:
        return find_path(keeper.registry.snapshot().paths, key)
    except UnknownCameraError:
        gone = f"{ROOT}{key.strip('/')}{SUFFIX}"
        if keeper.registry.history(gone, most=1):
            return gone
        raise


def _since(told: Sequence[Chapter], name: str, value: Field) -> Chapter:
    found = told[0]
    for one in told:
        if one.entry is None or entry_fields(one.entry).get(name) != value:
            break
        found = one
    return found


def _commit(chapter: Chapter) -> dict[str, Json]:
    revision = chapter.revision
    return {
        "commit": revision.commit,
        "date": revision.authored.isoformat(),
        "author": revision.author.name,
        "subject": revision.subject,
        "reason": chapter.reason,
    }


def _revision(chapter: Chapter) -> dict[str, Json]:
    entry, delta = chapter.entry, chapter.delta
    K = entry.calibration.intrinsics if entry is not None else None
    changed: dict[str, Json] | None = dict(delta) if delta is not None else None
    numbers: dict[str, Json] | None = (
        {name: float(getattr(K, name)) for name in K_NAMES} if K is not None else None
    )
    cameras: list[Json] = list(chapter.cameras)
    return {
        **_commit(chapter),
        "cameras": cameras,
        "path": chapter.revision.path or None,
        "status": entry.status.value if entry is not None else None,
        "grade": entry.calibration.grade.value if entry is not None else None,
        "firmware": chapter.firmware,
        "K": numbers,
        "delta_K": changed,
    }
