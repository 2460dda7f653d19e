"""The cameras that took the images in some folders, by unit and firmware, with the days of their flights."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from itertools import groupby
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary.calibration import CameraKey
from calibrary.catalogue import identified
from calibrary.errors import InputError
from calibrary.evidence.identity import firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import no_frame
from calibrary.jobs.audit.report import Leg
from calibrary.jobs.extract.cameras import Camera, State, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.jobs.images.folders import SkippedFile, find_images
from calibrary.jobs.images.reading import gather
from calibrary.parsers.imagery.taken import taken_on
from calibrary.policy import Policy

OF_CAMERAS: Final = re.compile(r"DCIM|[0-9]{4}SET|[0-9]{3}(_[0-9]{4}|_?[A-Z]\w{2,4})?", re.IGNORECASE)
"""Folders created by cameras, which are not flights: DCF's 100MEDIA, DJI's 100_0001, MicaSense's 0000SET/000."""


class FlightDay(Struct, frozen=True, kw_only=True):
    """The images that one camera took on one flight and day.

    Attributes:
        flight: folder of the images, without the folders that cameras create.
        day: date; None if the images state none.
        paths: of the images, sorted by name.
    """

    flight: str
    day: date | None
    paths: tuple[Path, ...]


class Flown(Struct, frozen=True, kw_only=True):
    """One unit of one camera with one firmware.

    Attributes:
        key: the camera key, with firmware.
        camera: result of the extraction from its images.
        first, last: first and last date of its images; None if none states a date.
        example: one of its images.
        legs: its flights, oldest first.
        days: its images by flight and day.
        label: label of the unit in the registry.
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
        """Number of its images."""
        return self.camera.count


class Flights(Struct, frozen=True, kw_only=True):
    """All cameras that flew.

    Attributes:
        flown: the cameras, in a fixed order.
        images: number of images that were read.
        before: number of images that were skipped because they are older than requested.
        undated: number of images without a date; they are treated as recent.
        unreadable: images from which no camera can be identified.
    """

    flown: tuple[Flown, ...]
    images: int
    before: int = 0
    undated: int = 0
    unreadable: tuple[SkippedFile, ...] = ()


class _Found(Struct):
    """Images by name, each with its path and date."""

    paths: dict[str, tuple[Path, Path]] = field(default_factory=dict)
    days: dict[str, date | None] = field(default_factory=dict)
    before: int = 0


def flights(
    folders: Sequence[Path],
    policy: Policy,
    *,
    since: date | None = None,
    workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Flights:
    """Find the cameras of all images in folders and their sub-folders.

    Args:
        folders: of images; a folder inside another one is read once.
        policy: limits for K, as in extract.
        since: skip images of earlier days; images without a date are kept.
        workers: processes that read images; 0 for automatic.
        progress: called with the number done and the total.

    Raises:
        InputError: a folder cannot be read, or no folder contains an image.
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
        contradiction = no_frame(metadata)
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


def _leave_out_older(
    images: _Found, since: date | None, progress: Callable[[int, int], None] | None, total: int
) -> None:
    for done, (name, (_, path)) in enumerate([*images.paths.items()], start=1):
        try:
            day = taken_on(path)
        except (InputError, OSError):
            # The extraction reports why the image cannot be read.
            day = None
        if since is not None and day is not None and day < since:
            del images.paths[name]
            images.before += 1
        else:
            images.days[name] = day
        if progress is not None and done % 16 == 0:
            progress(done, total)


def _flown(states: dict[ImageMetadata, list[str]], images: _Found, policy: Policy) -> Iterator[Flown]:
    # Only the images and the catalogue are used here; the registry is compared with the result later.
    knowledge = Knowledge.load(None)
    for key, group in group_cameras(undated(states), knowledge).items():
        for same in _by_firmware(group):
            for camera in judge(key, same, policy=policy):
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
    """The folder that a user made for a flight: that of the image without the folders that cameras create."""
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
