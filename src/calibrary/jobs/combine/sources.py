"""Read the calibrations to combine: files with a covariance, entries, and the JSON of earlier calibrations."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.arguments import Place, Reading
from calibrary.calibration import Calibration, Covariance, Quality, SourceFile
from calibrary.errors import CalibrationError, InputError
from calibrary.extras import SFM, require
from calibrary.jobs.calibrate.frames import find_frames
from calibrary.jobs.calibrate.run import Told
from calibrary.jobs.calibrate_flight.reconstruction import MOST_IMAGES, solve_reconstruction
from calibrary.jobs.calibrate_flight.run import FlightOptions, SolvedFlight, solve_images
from calibrary.jobs.files import file_of, read_argument
from calibrary.parsers.files import read_regular_file
from calibrary.progress import Progress
from calibrary.records import replace

_RULE: Final = re.compile(r"([a-z][a-z-]+): ")


class Source(Struct, frozen=True, kw_only=True):
    """A calibration with its label.

    Attributes:
        label: name of the file, without its folders if unique, or KEY@REV of an entry.
        calibration: the calibration.
        file: name and hash of the file; None for an entry.
    """

    label: str
    calibration: Calibration
    file: SourceFile | None = None

    @property
    def quality(self) -> Quality:
        """Quality as stated; empty if none is."""
        return self.calibration.quality or Quality()

    @property
    def covariance(self) -> Covariance | None:
        """Covariance including the variance factor; None if none is stated."""
        stated = self.quality.covariance
        if stated is None:
            return None
        return Covariance.from_matrix(stated.names, stated.matrix * self.quality.inflation)

    @property
    def fx_std(self) -> float | None:
        """Standard deviation of fx including the variance factor, px; None if not stated."""
        std = self.quality.std.get("fx")
        if self.quality.covariance is not None:
            std = self.quality.covariance.std.get("fx", std)
        return std * math.sqrt(self.quality.inflation) if std is not None else None

    @property
    def shortcomings(self) -> frozenset[str]:
        """Rules that it failed, by its notes; empty if it passed."""
        short = self.calibration.shortfall
        if short is None:
            return frozenset()
        return frozenset(found[1] for note in self.calibration.notes if (found := _RULE.match(note))) - {
            short
        }


def read_sources(texts: Sequence[str], reading: Reading, registry: Place | None = None) -> list[Source]:
    """Read the calibrations that the arguments name.

    The label of a file is its name, without the folder because entries keep it; only if two files have the same name,
    as many folders are added as tell them apart.

    Raises:
        InputError: a file cannot be read, or contains several cameras and none was chosen.
        RegistryError: an argument is neither a file nor an entry.
    """
    read = [_read(text, reading, registry) for text in texts]
    labels = iter(
        _labels([Path(text) for text, one in zip(texts, read, strict=True) if one.file is not None])
    )
    return [one if one.file is None else replace(one, label=next(labels)) for one in read]


def read_flights(
    folders: Sequence[Path], told: Told, progress: Progress | None
) -> list[tuple[str, SolvedFlight]]:
    """Adjust the flights that folders hold, each alone; each with its label, as :func:`read_sources` makes them.

    Raises:
        InputError: a folder is given twice, holds no images and no reconstruction, or several cameras.
        CalibrationError: the images of a flight cannot be matched, or do not determine a camera.
        MissingExtraError: a folder holds images, and pycolmap is not installed.
    """
    given: dict[Path, Path] = {}
    for folder in folders:
        if (first := given.setdefault(folder.resolve(), folder)) is not folder:
            raise InputError(
                f"this is the same folder as {first}; expected each flight once", source=str(folder)
            )
    flights = []
    for label, folder in zip(_labels(folders), folders, strict=True):
        try:
            flights.append((label, _flight(folder, told, progress)))
        except CalibrationError as error:
            raise CalibrationError(f"{label}: {error}") from None
    return flights


def _labels(paths: Sequence[Path]) -> list[str]:
    """As many of the last parts of each path as no other ends with; all that one given twice has is its name."""
    whole = [Path(os.path.abspath(path)).parts for path in paths]  # noqa: PTH100  of a link, its own name
    return [
        next(
            (
                str(Path(*mine[-count:]))
                for count in range(1, len(mine) + 1)
                if sum(other[-count:] == mine[-count:] for other in whole) == 1
            ),
            mine[-1],
        )
        for mine in whole
    ]


def _flight(folder: Path, told: Told, progress: Progress | None) -> SolvedFlight:
    if file_of(folder) is not None:
        return solve_reconstruction(folder, (), told, FlightOptions(images=MOST_IMAGES))
    require(SFM, "a calibration from a flight")
    images = find_frames([folder], "the images of a flight, or its reconstruction")
    return solve_images(images, told, FlightOptions(), progress=progress)


def _read(text: str, reading: Reading, registry: Place | None) -> Source:
    path = Path(text)
    if not path.is_file():
        found = read_argument(text, reading, registry)
        return Source(label=found.label, calibration=found.calibration)
    data = read_regular_file(path, max_bytes=reading.max_bytes)
    file = SourceFile(name=path.name, sha256=hashlib.sha256(data).hexdigest())
    return Source(label=path.name, calibration=read_argument(text, reading).calibration, file=file)
