"""A fleet's registry, asked which calibration answers for a camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from calibrary.calibration import Calibration, CameraKey
from calibrary.jobs.exchange.resolve import Answer, Question, answer, asked, resolution_report
from calibrary.records import Json, to_json
from calibrary.registry.entry import Entry, Status
from calibrary.registry.registry import open_snapshot
from calibrary.registry.resolution import RejectedEntry
from calibrary.registry.snapshot import Snapshot

__all__ = ["Fleet", "FleetAnswer", "open_registry"]


@dataclass(frozen=True, slots=True, eq=False)
class FleetAnswer:
    """What a registry says of one camera.

    Attributes:
        answer: all of it, as the command line shows it.
        snapshot: the state of the registry that was asked.
        on: the day it is for.
    """

    answer: Answer
    snapshot: Snapshot
    on: date

    @property
    def camera(self) -> CameraKey:
        """The camera that was asked for, as far as it is known."""
        return self.answer.question.key

    @property
    def calibration(self) -> Calibration | None:
        """Its K and distortion at the camera's image size; None where no entry answers."""
        found = self.answer.resolution
        return found.calibration if found is not None else None

    @property
    def entry(self) -> Entry | None:
        """The entry that answers, as its file says it."""
        found = self.answer.resolution
        return found.entry if found is not None else None

    @property
    def status(self) -> Status | None:
        """Whether the entry is approved or held."""
        return self.entry.status if self.entry is not None else None

    @property
    def why(self) -> str | None:
        """Why this entry and no other."""
        found = self.answer.resolution
        return found.why if found is not None else None

    @property
    def near(self) -> tuple[RejectedEntry, ...]:
        """Other entries of the same make and model, each with its ``path`` and ``why_not``."""
        return self.answer.near

    def to_dict(self) -> dict[str, Json]:
        """The answer as plain data for JSON (schemas/resolution-1.schema.json)."""
        return to_json(resolution_report(self.snapshot, self.answer, on=self.on))


@dataclass(frozen=True, slots=True, eq=False)
class Fleet:
    """A registry at one state, which never changes while this is held.

    Attributes:
        snapshot: its entries.
    """

    snapshot: Snapshot

    @property
    def commit(self) -> str | None:
        """Which state, 40 hexadecimal digits; None for a plain folder."""
        return self.snapshot.commit

    def entries(self) -> Iterator[Entry]:
        """Every entry, whatever its status.

        Raises:
            RegistryError: one cannot be read.
        """
        return (stored.entry for stored in self.snapshot.entries())

    def resolve(self, camera: str | Path | Calibration | CameraKey, *, on: date | None = None) -> FleetAnswer:
        """The calibration that answers for a camera.

        Args:
            camera: an image of it, its KEY such as "dji/fc6310r", a calibration or key of it.
            on: the day it is for, as entries may be valid for some only; today when not given.

        Raises:
            InputError: the image cannot be read, or make and model are not known.
            RegistryError: the KEY is of several models, or several entries fit equally well; they are named.

        >>> fleet = calibrary.open_registry("fleet")
        >>> answer = fleet.resolve("survey/DJI_0001.JPG")
        >>> answer.status, answer.calibration.intrinsics.fx
        (<Status.APPROVED: 'approved'>, 3659.5)
        """
        day = on or date.today()
        found = answer(self.snapshot, self._question(camera), on=day)
        return FleetAnswer(found, self.snapshot, day)

    def _question(self, camera: str | Path | Calibration | CameraKey) -> Question:
        if isinstance(camera, str | Path):
            return asked(self.snapshot, str(camera), lambda known: known)
        key = camera.camera if isinstance(camera, Calibration) else camera
        told = asked(self.snapshot, None, lambda _: key)
        return Question(key=told.key, known_by="what was said")


def open_registry(path: str | Path, *, at: str | None = None) -> Fleet:
    """Open a fleet's registry for reading.

    Args:
        path: a registry in git, bare or checked out, read as committed; or a plain folder of entries.
        at: which state: a commit, tag, branch or day; the one that is checked out when not given.

    Raises:
        RegistryError: there is none, or no such state.

    >>> fleet = calibrary.open_registry("fleet")
    >>> [entry.id for entry in fleet.entries()]
    ['dji/fc6310r/5472x3648']
    """
    return Fleet(open_snapshot(Path(path), at))
