"""Pairing of the frames that several cameras took at the same time, by folder and file name.

With one folder per camera, frames with the same name belong together, or else with the same number (left01,
right01). In a single folder, the names contain camera and shot in the scheme of a known payload, or in a
pattern given by the user. Nothing is guessed: if two interpretations of the names differ, both are shown and
--pattern decides.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.jobs.calibrate.frames import find_frames, refuse_recordings
from calibrary.records import replace

MOST_CAMERAS: Final = 24
NAMES_SHOWN: Final = 3
ENOUGH: Final = 0.5
"""Fraction of the frames that must find a partner for an interpretation of the names to be accepted."""


class RigFrames(Struct, frozen=True, kw_only=True):
    """The frames of a rig.

    Attributes:
        shots: frames by shot and camera name.
        how: how the frames were paired, in words.
        notes: remarks on the pairing.
        order: of the cameras, reference first.
    """

    shots: Mapping[str, Mapping[str, Path]]
    how: str
    notes: tuple[str, ...] = ()
    order: tuple[str, ...] = ()

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras, reference first."""
        return self.order or tuple(dict.fromkeys(name for frames in self.shots.values() for name in frames))

    def of(self, camera: str) -> tuple[Path, ...]:
        """Frames of a camera in the order of the shots."""
        return tuple(frames[camera] for frames in self.shots.values() if camera in frames)


class _Naming(Struct, frozen=True, kw_only=True):
    """Naming scheme of a payload's frames."""

    title: str
    expression: re.Pattern[str]
    read: Callable[[re.Match[str]], tuple[str, str]]


def _camera_and_shot(match: re.Match[str]) -> tuple[str, str]:
    return match["camera"], match["shot"]


def _of_p4m(match: re.Match[str]) -> tuple[str, str]:
    number = int(match["number"])
    band = ("RGB", "Blue", "Green", "Red", "RedEdge", "NIR")[number % 10]
    return band, f"{match['folder'] or ''}DJI_{number // 10}"


PATTERNS: Final = (
    _Naming(
        title="MicaSense (IMG_0001_1.tif)",
        expression=re.compile(r"(?P<shot>IMG_\d{4})_(?P<camera>\d{1,2})\.tiff?", re.IGNORECASE),
        read=_camera_and_shot,
    ),
    _Naming(
        title="P4 Multispectral (DJI_0010.JPG, DJI_0011.TIF …)",
        expression=re.compile(
            r"(?P<folder>)DJI_(?P<number>\d{3}(?:0(?=\.JPE?G)|[1-5](?=\.TIF)))\.(?:JPE?G|TIFF?)",
            re.IGNORECASE,
        ),
        read=_of_p4m,
    ),
    _Naming(
        title="Mavic 3 Multispectral (DJI_…_0001_D.JPG, DJI_…_0001_MS_G.TIF)",
        expression=re.compile(
            r"(?P<shot>DJI_(?:\d{14}_)?\d{4})_(?P<camera>D|MS_[A-Z]{1,3})\.(?:JPE?G|TIFF?)", re.IGNORECASE
        ),
        read=_camera_and_shot,
    ),
    _Naming(
        title="Sequoia (IMG_170101_120000_0001_GRE.TIF)",
        expression=re.compile(
            r"(?P<shot>IMG_\d{6}_\d{6}_\d{4})_(?P<camera>GRE|RED|REG|NIR|RGB)\.(?:JPE?G|TIFF?)", re.IGNORECASE
        ),
        read=_camera_and_shot,
    ),
    _Naming(
        title="stereo (left01, right01)",
        expression=re.compile(
            r"(?P<before>.*?)(?<![a-z])(?P<camera>left|right|cam[_-]?\d{1,2}|camera[_-]?\d{1,2})(?![a-z])[_-]?(?P<after>.*)\.\w+",
            re.IGNORECASE,
        ),
        read=lambda match: (match["camera"].lower(), f"{match['before']}{match['after']}"),
    ),
)


def find_rig(
    operands: Sequence[Path],
    *,
    pattern: str | None = None,
    in_order: bool = False,
    reference: str | None = None,
) -> RigFrames:
    """Find and pair the frames of a rig.

    Args:
        operands: folders, one per camera; or files, a folder or patterns, with names that contain camera and
            shot.
        pattern: scheme of the names, such as "{camera}/{shot}.png"; ``*`` matches anything.
        in_order: whether to pair the n-th frames of all folders.
        reference: name of the camera that defines the rig's frame; default is the first.

    Raises:
        InputError: there are no frames or fewer than two cameras, or the pairing is ambiguous.
    """
    refuse_recordings(
        operands, "which frames of a rig belong together is read from their names; give image files"
    )
    by_folder = len(operands) > 1 and all(folder.is_dir() for folder in operands) and pattern is None
    if in_order and not by_folder:
        raise InputError(
            "--in-order pairs the frames of folders, one for each camera; expected two folders or more"
        )
    if pattern is not None:
        found = _by_pattern(list(_files(operands)), pattern)
    elif by_folder:
        found = _by_folders(operands, in_order=in_order)
    else:
        found = _by_names(list(_files(operands)))
    if not 2 <= len(found.cameras) <= MOST_CAMERAS:
        raise InputError(
            f"frames of {len(found.cameras)} camera(s) ({', '.join(found.cameras[:NAMES_SHOWN])}); expected 2 to "
            f"{MOST_CAMERAS}"
        )
    if not any(len(frames) > 1 for frames in found.shots.values()):
        raise InputError(
            f"no two cameras took a frame of the same shot ({found.how}); give the names by --pattern"
        )
    return _referred(found, reference)


def pair_names(
    names: Sequence[str], pattern: str | None = None, reference: str | None = None
) -> RigFrames | None:
    """Pair images of which only the names are known; None if these are of one camera, or do not say.

    Args:
        names: with folders, if the images are in several.
        pattern: scheme of the names, such as "{camera}/{shot}.png".
        reference: name of the camera that defines the rig's frame; default is the first.

    Raises:
        InputError: the pattern or the reference fits no name.
    """
    paths = [Path(name) for name in names]
    if pattern is not None:
        found = _by_pattern(paths, pattern)
    else:
        try:
            found = _by_names(paths)
        except InputError:
            shots = _shots((path, path.parent.name, path.stem) for path in paths)
            found = RigFrames(shots=shots, how="by their folders")
    if len(found.cameras) < 2 or not _is_paired(found, len(found.shots)):
        return None
    return _referred(found, reference)


def _files(operands: Sequence[Path]) -> Iterator[Path]:
    """Files of the arguments, with sub-folders, because payloads write frames into 000/, 001/ and so on."""
    for folder in operands:
        if folder.is_dir():
            inner = sorted(
                path for path in folder.rglob("*") if path.is_dir() and not path.name.startswith(".")
            )
            for one in (folder, *inner):
                if any(path.is_file() for path in one.iterdir()):
                    yield from _images(one)
        else:
            yield from find_frames([folder])


def _images(folder: Path) -> tuple[Path, ...]:
    try:
        return find_frames([folder])
    except InputError:
        return ()


def _by_pattern(paths: Sequence[Path], pattern: str) -> RigFrames:
    expression = _expression(pattern)
    depth = pattern.count("/") + 1
    read = {
        path: match
        for path in paths
        if (match := expression.fullmatch("/".join(path.parts[-depth:]))) is not None
    }
    if not read:
        example = "/".join(paths[0].parts[-depth:]) if paths else "no file"
        raise InputError(f"no name fits the pattern {pattern}; the first is {example}", place="--pattern")
    shots = _shots((path, match["camera"], match["shot"]) for path, match in read.items())
    out = len(paths) - len(read)
    notes = (f"{out} files do not fit the pattern and were not read",) if out else ()
    return RigFrames(shots=shots, how=f"by the pattern {pattern}", notes=notes)


def _expression(pattern: str) -> re.Pattern[str]:
    for name in ("camera", "shot"):
        if pattern.count(f"{{{name}}}") != 1:
            raise InputError(
                f"{pattern!r:.80} has {pattern.count(f'{{{name}}}')} times {{{name}}}; expected {{camera}} and "
                "{shot} once each, as in {camera}/{shot}.png",
                place="--pattern",
            )
    parts = re.split(r"(\{camera\}|\{shot\}|\*)", pattern)
    words = {"{camera}": r"(?P<camera>[^/]+?)", "{shot}": r"(?P<shot>[^/]+?)", "*": r"[^/]*?"}
    return re.compile("".join(words.get(part, re.escape(part)) for part in parts))


def _by_folders(folders: Sequence[Path], *, in_order: bool) -> RigFrames:
    names = _folder_names(folders)
    frames = {name: find_frames([folder]) for name, folder in zip(names, folders, strict=True)}
    if in_order:
        counts = {name: len(paths) for name, paths in frames.items()}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{count} of {name}" for name, count in counts.items())
            raise InputError(f"--in-order needs as many frames of each camera, found {listed}")
        shots = _shots(
            (path, name, f"{at + 1:04}") for name, paths in frames.items() for at, path in enumerate(paths)
        )
        return RigFrames(shots=shots, how="in order, as asked")
    ways: list[tuple[str, Callable[[str, Path], str | None]]] = [
        ("by the same file names", lambda _, path: path.stem),
        (
            "by file names without the camera's",
            lambda name, path: re.sub(re.escape(name), "", path.stem, flags=re.IGNORECASE),
        ),
        ("by the numbers at the end of file names", lambda _, path: _number(path.stem)),
    ]
    for how, key in ways:
        keyed = [(path, name, key(name, path)) for name, paths in frames.items() for path in paths]
        named = [(path, name, shot) for path, name, shot in keyed if shot is not None]
        if not _is_unique(named):
            continue
        found = RigFrames(shots=_shots(named), how=how)
        if _is_paired(found, min(len(paths) for paths in frames.values())):
            return found
    shown = "; ".join(
        f"{name}: {', '.join(path.name for path in paths[:NAMES_SHOWN])} …" for name, paths in frames.items()
    )
    raise InputError(
        f"the frames' names do not say which belong together ({shown}); rename them, give --pattern, or --in-order if "
        "the n-th frames of all folders are one shot"
    )


def _by_names(paths: Sequence[Path]) -> RigFrames:
    found: list[RigFrames] = []
    for naming in PATTERNS:
        read = [(path, naming.expression.fullmatch(path.name)) for path in paths]
        # Payloads restart the numbering in each folder.
        named = [
            (path, camera, f"{path.parent.name}/{shot}")
            for path, match in read
            if match is not None
            for camera, shot in [naming.read(match)]
        ]
        if not named or not _is_unique(named):
            continue
        rig = RigFrames(
            shots=_plain(_shots(named)),
            how=f"by the names of {naming.title}",
            notes=(f"{len(paths) - len(named)} files are named otherwise and were not read",)
            if len(named) < len(paths)
            else (),
        )
        if len(rig.cameras) > 1 and _is_paired(rig, max(len(rig.shots), 1)):
            found.append(rig)
    if not found:
        shown = ", ".join(path.name for path in paths[:NAMES_SHOWN])
        known = "; ".join(naming.title for naming in PATTERNS)
        raise InputError(
            f"the frames' names ({shown} …) do not say camera and shot; expected one folder for each camera, --pattern "
            f"such as '{{camera}}_{{shot}}.png', or names as of {known}"
        )
    if len({tuple(sorted((shot, *sorted(f)) for shot, f in rig.shots.items())) for rig in found}) > 1:
        raise InputError(
            f"the names can be read in several ways: {'; '.join(rig.how for rig in found)}; say which by --pattern"
        )
    return found[0]


def _shots(
    named: Iterator[tuple[Path, str, str]] | Sequence[tuple[Path, str, str]],
) -> dict[str, dict[str, Path]]:
    shots: dict[str, dict[str, Path]] = {}
    for path, camera, shot in named:
        other = shots.setdefault(shot, {}).setdefault(camera, path)
        if other != path:
            raise InputError(
                f"two frames of camera {camera} in shot {shot}: {other} and {path}; say by --pattern what "
                "distinguishes shots"
            )
    return {shot: shots[shot] for shot in sorted(shots, key=_natural)}


def _plain(shots: dict[str, dict[str, Path]]) -> dict[str, dict[str, Path]]:
    """The shots without the folder in their names, if all are from one folder."""
    if len({shot.partition("/")[0] for shot in shots}) > 1:
        return shots
    return {shot.partition("/")[2]: frames for shot, frames in shots.items()}


def _natural(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key for natural order, in which 2 precedes 10."""
    return tuple(
        (0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", text) if part
    )


def _number(stem: str) -> str | None:
    match = re.search(r"(\d+)\D*$", stem)
    return str(int(match[1])) if match is not None else None


def _is_unique(named: Sequence[tuple[Path, str, str]]) -> bool:
    return len({(camera, shot) for _, camera, shot in named}) == len(named)


def _is_paired(rig: RigFrames, most: int) -> bool:
    shared = sum(len(frames) > 1 for frames in rig.shots.values())
    return shared >= max(1.0, ENOUGH * most)


def _folder_names(folders: Sequence[Path]) -> list[str]:
    """Names of the folders, extended by their parents if they are equal."""
    for depth in range(1, 4):
        names = ["/".join(folder.resolve().parts[-depth:]) for folder in folders]
        if len(set(names)) == len(names):
            return names
    raise InputError("a folder is given twice; expected one for each camera")


def _referred(found: RigFrames, reference: str | None) -> RigFrames:
    """The frames with the reference camera first."""
    names = sorted(found.cameras, key=_natural)
    if {"left", "right"} == set(names):
        names = ["left", "right"]
    if reference is not None:
        if reference not in names:
            raise InputError(f"no camera {reference!r:.60} among {', '.join(names)}", place="--reference")
        names = [reference, *(name for name in names if name != reference)]
    return replace(found, order=tuple(names))
