"""What flew: every camera in some folders of images, by unit and by firmware, and on which days."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from itertools import groupby
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary.calibration import CameraKey
from calibrary.errors import InputError
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.identity import firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.exchange.identity import identified
from calibrary.jobs.extract.cameras import DEFAULT_SENSOR_MM, Camera, Sensor, State, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.jobs.images.folders import SkippedFile, find_images
from calibrary.jobs.images.reading import gather
from calibrary.parsers.imagery.taken import taken_on
from calibrary.policy import Policy

__all__ = ["FlightDay", "Flights", "Flown", "Leg", "Progress", "flights"]

Progress = Callable[[int, int], None]
"""FrameMetadata how many of how many are done."""


OF_CAMERAS: Final = re.compile(r"DCIM|[0-9]{4}SET|[0-9]{3}(_[0-9]{4}|_?[A-Z]\w{2,4})?", re.IGNORECASE)
"""Folders that cameras make by themselves are not flights: DCF's 100MEDIA, DJI's 100_0001, MicaSense's 0000SET/000."""


class Leg(Struct, frozen=True, kw_only=True):
    """What one camera took on one flight.

    Attributes:
        flight: the folder of its images, without those that cameras make by themselves.
        images: how many.
        first, last: their days; None where none of them states one.
    """

    flight: str
    images: int
    first: date | None
    last: date | None


class FlightDay(Struct, frozen=True, kw_only=True):
    """The images that one camera took on one flight and day.

    Attributes:
        flight: as of a :class:`Leg`.
        day: None where they state none.
        paths: of the images, in the order of their names.
    """

    flight: str
    day: date | None
    paths: tuple[Path, ...]


class Flown(Struct, frozen=True, kw_only=True):
    """One unit of one camera with one firmware.

    Attributes:
        key: which, with its firmware.
        camera: what its images say.
        first, last: the days of its images; None where none of them says one.
        example: one of its images.
        legs: its flights, the oldest first.
        days: its images by flight and day.
        label: what its keeper calls the unit, by the registry.
    """

    key: CameraKey
    camera: Camera
    first: date | None
    last: date | None
    example: Path
    legs: tuple[Leg, ...] = ()
    days: tuple[FlightDay, ...] = ()
    label: str | None = None

    @property
    def images(self) -> int:
        """How many."""
        return self.camera.count


class Flights(Struct, frozen=True, kw_only=True):
    """All that flew.

    Attributes:
        flown: in a fixed order.
        images: how many were looked at.
        before: how many were left out, since they are older than was asked for.
        undated: how many say no day; they count as if they were recent.
        unreadable: images that no camera can be identified from.
    """

    flown: tuple[Flown, ...]
    images: int
    before: int = 0
    undated: int = 0
    unreadable: tuple[SkippedFile, ...] = ()


class _Found(Struct):
    """Images by name, each with its file's place and day."""

    paths: dict[str, tuple[Path, Path]] = field(default_factory=dict)
    days: dict[str, date | None] = field(default_factory=dict)
    before: int = 0


def flights(
    folders: Sequence[Path],
    policy: Policy,
    *,
    since: date | None = None,
    workers: int = 0,
    progress: Progress | None = None,
) -> Flights:
    """Look through folders and those within them.

    Args:
        folders: of images; one that lies in another counts once.
        policy: that K is judged by, as in extract.
        since: images of earlier days are left out; those that say no day are not.
        workers: processes that read images; 0 decides by itself.
        progress: called with how far it is.

    Raises:
        InputError: a folder cannot be read, or there is no image in any.
    """
    images = _images(folders)
    if not images.paths:
        raise InputError(
            "no images (JPEG, TIFF, DNG, HEIF, PNG) in it or its sub-folders",
            source=", ".join(map(str, folders)),
        )
    total = 2 * len(images.paths)
    _leave_out_older(images, since, progress, total)
    states: dict[ImageMetadata, list[str]] = {}
    unreadable: list[SkippedFile] = []
    done = total - len(images.paths)
    for folder, group in groupby(images.paths.items(), key=lambda item: item[1][0]):
        names = {path.relative_to(folder).as_posix(): name for name, (_, path) in group}

        def advance(count: int) -> None:
            nonlocal done
            done += count
            if progress is not None:
                progress(done, total)

        gathered = gather([folder / name for name in names], folder, workers=workers, progress=advance)
        for metadata, own in gathered.states.items():
            states.setdefault(metadata, []).extend(names[name] for name in own)
        unreadable += [SkippedFile(name=names[one.name], reason=one.reason) for one in gathered.unread]
    for metadata in list(states):
        contradiction = exif_contradiction(metadata)
        if contradiction is not None:
            unreadable += [SkippedFile(name=name, reason=contradiction) for name in states.pop(metadata)]
    return Flights(
        flown=tuple(_flown(states, images, policy)),
        images=len(images.paths),
        before=images.before,
        undated=sum(day is None for day in images.days.values()),
        unreadable=tuple(sorted(unreadable, key=lambda one: one.name)),
    )


def _images(folders: Sequence[Path]) -> _Found:
    found, seen = _Found(), set()
    for folder in folders:
        for path in find_images(folder, recursive=True):
            real = path.resolve()
            if real not in seen:
                seen.add(real)
                name = path.relative_to(folder).as_posix()
                found.paths[name if len(folders) == 1 else f"{folder}/{name}"] = (folder, path)
    return found


def _leave_out_older(images: _Found, since: date | None, progress: Progress | None, total: int) -> None:
    for done, (name, (_, path)) in enumerate([*images.paths.items()], start=1):
        try:
            day = taken_on(path)
        except (InputError, OSError):
            # Whoever reads it for its camera tells why it cannot be read.
            day = None
        if since is not None and day is not None and day < since:
            del images.paths[name]
            images.before += 1
        else:
            images.days[name] = day
        if progress is not None and done % 16 == 0:
            progress(done, total)


def _flown(states: dict[ImageMetadata, list[str]], images: _Found, policy: Policy) -> Iterator[Flown]:
    # What the registry says is asked apart: here only the images and the catalogue are heard.
    knowledge = Knowledge.load(None)
    sensor = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)
    for key, group in group_cameras(undated(states), knowledge).items():
        for same in _by_firmware(group):
            for camera in judge(key, same, policy=policy, sensor=sensor):
                by_day = _by_day(camera.names, images)
                days = [day for name in camera.names if (day := images.days[name]) is not None]
                yield Flown(
                    key=identified(camera.states[0].metadata, knowledge.catalogue).key,
                    camera=camera,
                    first=min(days, default=None),
                    last=max(days, default=None),
                    example=images.paths[camera.names[0]][1],
                    legs=_legs(by_day),
                    days=by_day,
                )


def _by_day(names: Sequence[str], images: _Found) -> tuple[FlightDay, ...]:
    found: dict[tuple[str, date | None], list[Path]] = {}
    for name in names:
        folder, path = images.paths[name]
        found.setdefault((_flight(folder, path), images.days[name]), []).append(path)
    return tuple(
        FlightDay(flight=flight, day=day, paths=tuple(sorted(paths)))
        for (flight, day), paths in found.items()
    )


def _legs(by_day: Sequence[FlightDay]) -> tuple[Leg, ...]:
    by_flight: dict[str, list[FlightDay]] = {}
    for part in by_day:
        by_flight.setdefault(part.flight, []).append(part)
    legs = []
    for flight, parts in by_flight.items():
        known = [part.day for part in parts if part.day is not None]
        first, last = min(known, default=None), max(known, default=None)
        legs.append(Leg(flight=flight, images=sum(len(part.paths) for part in parts), first=first, last=last))
    return tuple(sorted(legs, key=lambda leg: (leg.last or date.min, leg.flight)))


def _flight(folder: Path, path: Path) -> str:
    """The folder that a person gave a flight: the image's, up to what was asked for."""
    here = path.parent
    while here != folder and OF_CAMERAS.fullmatch(here.name):
        here = here.parent
    inside = here.relative_to(folder).as_posix()
    return inside if inside != "." else folder.name or folder.resolve().name


def _by_firmware(group: Sequence[State]) -> list[tuple[State, ...]]:
    parts: dict[str | None, list[State]] = {}
    for state in group:
        parts.setdefault(firmware(state.metadata), []).append(state)
    return [tuple(parts[name]) for name in sorted(parts, key=lambda name: name or "")]
