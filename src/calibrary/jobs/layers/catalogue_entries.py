"""Registry entries from the built-in catalogue: a K to start from for each camera for which it can be derived.

The K describes a camera model, not a unit: square pixels, principal point in the image centre, unknown
distortion. Its grade is ``derived`` whatever the source, because the individual camera was not measured. The
entry is a draft until it is approved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.catalogue import load_catalogue
from calibrary.known_camera import KnownCamera, Projection
from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Sensor
from calibrary.registry.paths import folder_of
from calibrary.version import __version__

KIND: Final = "catalogue"
"""Kind of provenance of these entries."""

SOURCE: Final = "calibrary's catalogue of known cameras"
ASSUMED: Final = ("square pixels", "the principal point in the middle of the frame")


class NotImported(Struct, frozen=True, kw_only=True):
    """A camera of the catalogue that gives no entry, and the reason."""

    title: str
    reason: str


def catalogue_entries(cameras: Sequence[KnownCamera] | None = None) -> tuple[list[Entry], list[NotImported]]:
    """Draft entries of all cameras for which K can be derived, and the cameras for which it cannot.

    Args:
        cameras: rows of the catalogue; default is the shipped catalogue.
    """
    known = [*(cameras if cameras is not None else load_catalogue())]
    found: list[tuple[Entry, KnownCamera]] = []
    left: list[NotImported] = []
    names = _names(known)
    for camera in known:
        over_width = camera.fx_over_w or _focal_over_width(camera)
        if (reason := _reason_against(camera, over_width)) is not None:
            left.append(NotImported(title=f"{camera.make} {camera.title}", reason=reason))
            continue
        found += [
            (_entry(camera, over_width or 0.0, own, sub_camera), camera)
            for sub_camera in _sub_cameras(camera)
            for own in _groups(camera, names)
        ]
    places = Counter(entry.path for entry, _ in found)
    entries = [_with_focal(entry, camera) if places[entry.path] > 1 else entry for entry, camera in found]
    return sorted(entries, key=lambda entry: entry.path), left


def _focal_over_width(camera: KnownCamera) -> float | None:
    if camera.focal_mm is None or camera.pitch_um is None or camera.native_size is None:
        return None
    return camera.focal_mm / (camera.pitch_um / 1000 * camera.native_size[0])


def _reason_against(camera: KnownCamera, over_width: float | None) -> str | None:
    if not camera.models:
        return "no source states the Model that its images carry"
    if camera.projection is not Projection.PERSPECTIVE:
        return f"a {camera.projection.value} lens, which a pinhole K does not describe"
    if camera.native_size is None:
        return "no source states its image size"
    if over_width is None:
        return "no source states its focal length and pixel size for one image size"
    return None


def _names(cameras: Iterable[KnownCamera]) -> dict[tuple[str, str], frozenset[int]]:
    """Indices of the cameras that share each make and model."""
    found: dict[tuple[str, str], set[int]] = {}
    for at, camera in enumerate(cameras):
        for name in _called(camera):
            found.setdefault(name, set()).add(at)
    return {name: frozenset(cameras) for name, cameras in found.items()}


def _called(camera: KnownCamera) -> Iterator[tuple[str, str]]:
    for make in (camera.make, *camera.other_makes):
        for model in camera.models:
            yield make, model


def _groups(
    camera: KnownCamera, names: dict[tuple[str, str], frozenset[int]]
) -> list[tuple[tuple[str, str], ...]]:
    """Group a camera's names by the set of cameras they mean: the first name is the entry's, the others are aliases.

    A name that another camera shares needs its own entries, otherwise the alias would also match that camera.
    """
    groups: dict[frozenset[int], dict[str, tuple[str, str]]] = {}
    for name in _called(camera):
        groups.setdefault(names[name], {}).setdefault(folder_of(*name), name)
    return [tuple(group.values()) for group in groups.values()]


def _sub_cameras(camera: KnownCamera) -> tuple[str | None, ...]:
    """Sub-cameras of a row: bands that it describes together are separate cameras, each named by its tag."""
    return camera.bands or (camera.sub_camera,)


def _entry(
    camera: KnownCamera, over_width: float, names: Sequence[tuple[str, str]], sub_camera: str | None
) -> Entry:
    (make, model), *others = names
    width, height = camera.native_size or (0, 0)
    fx = over_width * width
    is_zoom = camera.zoom_mm is not None
    return Entry(
        calibration=Calibration(
            camera=CameraKey(
                make=make,
                model=model,
                sub_camera=sub_camera,
                lens=camera.lens,
                # With a zoom lens K applies to one focal length; with a prime lens the focal length adds nothing.
                focal_mm=camera.focal_mm if is_zoom else None,
                image_size=(width, height),
            ),
            intrinsics=Intrinsics(fx=fx, fy=fx, cx=width / 2, cy=height / 2, image_size=(width, height)),
            grade=Grade.DERIVED,
            provenance=Provenance(
                kind=KIND,
                source=SOURCE,
                tag=f"{camera.make} {camera.title}",
                assumptions=ASSUMED,
                tool=f"calibrary {__version__}",
            ),
            notes=tuple(_notes(camera)),
        ),
        aliases=tuple(Alias(make=make, model=model) for make, model in others),
        sensor=Sensor(pitch_um=camera.pitch_um) if camera.pitch_um is not None else None,
        tolerance=camera.spread,
    )


def _with_focal(entry: Entry, camera: KnownCamera) -> Entry:
    """The entry with the focal length in its key, to distinguish it from one that differs in nothing else."""
    calibration = entry.calibration
    key = replace(calibration.camera, focal_mm=camera.focal_mm)
    return replace(entry, calibration=replace(calibration, camera=key))


def _notes(camera: KnownCamera) -> Iterator[str]:
    used = ("fx_over_w",) if camera.fx_over_w is not None else ("focal_mm", "pitch_um")
    for field in ("native_size", *used, "spread"):
        source = camera.source(field)
        if source is not None:
            yield f"{field} from {source}"
    yield from (f"the sources disagree: {text}" for text in camera.conflicts)
    yield from camera.notes
