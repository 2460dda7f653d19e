"""An entry as the bytes of its file, and back: one writer, one strict reader, and a seal over the numbers."""

from __future__ import annotations

from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Final, cast

from calibrary.calibration import Calibration, Covariance, Provenance, Quality
from calibrary.errors import InputError, ParseError
from calibrary.registry.digest import digest
from calibrary.registry.entry import BLOCKS_WITH_EXTENSIONS, UNSTATED, Entry, Validity
from calibrary.registry.entry_document import EntryDocument, entry_from
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.migrations import CURRENT, migrated
from calibrary.registry.yaml_text import block, number, quoted, rows, scalar
from calibrary.schemas import require
from calibrary.strictyaml import YamlScalar, YamlValue, line_of, load_yaml

__all__ = ["LARGEST_ENTRY", "entry_yaml", "parse_entry"]

LARGEST_ENTRY: Final = 256 << 10
"""Bytes; an entry has some two thousand."""
DEEPEST: Final = 16
UTF_16: Final = (BOM_UTF16_LE, BOM_UTF16_BE)

LEGEND: Final = """\
# One camera of a fleet registry, written by calibrary; schema: entry-1.
# K is fx fy cx cy skew in pixels of an image of image_size (width, height), x to the right, y down. The origin is the
# outer corner of the top-left pixel, so the middle is (width/2, height/2); for OpenCV take 0.5 off cx and cy.
# The distortion is no part of K; its model maps ideal to observed x/z, y/z. null: unknown; "none": known to be none.
# The digest seals the numbers. To change one, take the digest line out and run: calibrary registry add FILE
"""

PARAMETERS: Final = ("fx", "fy", "cx", "cy", "skew")


def entry_yaml(entry: Entry) -> bytes:
    """The entry's file: the same bytes for the same entry, and the same entry from the bytes, bit for bit.

    Raises:
        InputError: a text holds a lone surrogate, a number is not finite, or an extension is nested too deep.
    """
    return (LEGEND + "\n".join(_lines(entry)) + "\n").encode()


def parse_entry(data: bytes, name: str, *, require_digest: bool = True) -> Entry:
    """Read one entry; older schema versions are brought to the present one.

    Args:
        data: the file's bytes.
        name: what errors call the file.
        require_digest: refuse a file without a digest. Where it is not required, one that is there still has to
            fit the numbers.

    Raises:
        ParseError: it is no YAML of one meaning, breaks schemas/entry-1.schema.json, is of a newer schema, or
            its numbers are not those that the digest was made over.
        InputError: its numbers are no camera's.
    """
    if data.startswith(UTF_16):
        raise ParseError("is text in UTF-16, which git shows to nobody; wanted UTF-8", source=name)
    value = load_yaml(data, source=name, max_bytes=LARGEST_ENTRY, max_depth=DEEPEST)
    document = migrated(value, source=name)
    require(document, f"entry-{CURRENT}", source=name, locate=partial(line_of, data))
    checked = cast("EntryDocument", document)
    try:
        entry = entry_from(checked, _extensions(document))
    except InputError as error:
        raise type(error)(error.message, source=name, place=error.place) from None
    stated = checked.get("digest")
    if stated is None:
        if require_digest:
            raise ParseError(
                "has no digest over its numbers; 'calibrary registry add FILE' checks it and writes it with one",
                source=name,
                place="digest",
            )
        return entry
    found = digest(entry.calibration, entry.sensor)
    if stated != found:
        raise ParseError(
            f"the digest is {_short(stated)} and the numbers give {_short(found)}: K, distortion, sensor or "
            "uncertainty were changed by hand, or a merge put two calibrations together; take a version that is "
            "whole (git checkout REV -- FILE), or, if these numbers are meant, take the digest line out and run "
            "'calibrary registry add FILE'",
            source=name,
            place="digest",
        )
    return entry


def _short(text: str) -> str:
    return f"{text.removeprefix('sha256:')[:12]}…"


def _extensions(document: Mapping[str, YamlValue]) -> dict[str, YamlValue]:
    found = {name: value for name, value in document.items() if name.startswith("x-")}
    for name in BLOCKS_WITH_EXTENSIONS:
        inner = document.get(name)
        if isinstance(inner, dict):
            found |= {f"{name}/{key}": value for key, value in inner.items() if key.startswith("x-")}
    return found


def _lines(entry: Entry) -> Iterator[str]:
    calibration, sensor = entry.calibration, entry.sensor
    yield f'schema: "calibrary/entry-{CURRENT}"'
    yield f"status: {quoted(entry.status.value)}"
    yield from _stated("", {"reason": entry.reason})
    yield f"digest: {quoted(digest(calibration, sensor))}"
    yield from _camera(entry)
    yield from _intrinsics(calibration)
    yield from _distortion(calibration)
    if sensor is not None:
        sides = {"width_mm": sensor.width_mm, "height_mm": sensor.height_mm, "pitch_um": sensor.pitch_um}
        yield from _block("sensor", _stated("  ", sides), entry)
    yield f"grade: {quoted(calibration.grade.value)}"
    if calibration.quality is not None:
        yield from _block("quality", _quality(calibration.quality), entry)
    if calibration.provenance != UNSTATED:
        yield from _block("provenance", _provenance(calibration.provenance), entry)
    yield from _list(
        "aliases", ((f"make: {quoted(a.make)}", f"model: {quoted(a.model)}") for a in entry.aliases)
    )
    if entry.validity is not None:
        yield from ("validity:", *_validity(entry.validity))
    yield from _stated("", {"tolerance": entry.tolerance, "supersedes": entry.supersedes})
    yield from _list("notes", ((quoted(note),) for note in calibration.notes))
    if calibration.extras:
        yield "extras:"
        yield from (f"  {quoted(name)}: {quoted(text)}" for name, text in calibration.extras)
    for name, value in entry.extensions.items():
        if "/" not in name:
            yield from block(name, value)


def _camera(entry: Entry) -> Iterator[str]:
    camera = entry.calibration.camera
    width, height = entry.calibration.intrinsics.image_size
    yield "camera:"
    yield from _stated(
        "  ",
        {
            "make": camera.make,
            "model": camera.model,
            "sub_camera": camera.sub_camera,
            "lens": camera.lens,
            "focal_mm": camera.focal_mm,
            "capture_mode": camera.capture_mode,
        },
    )
    yield f"  image_size: [{width}, {height}]"
    yield from _stated("  ", {"serial": camera.serial})
    if entry.firmware is not None:
        yield from ("  firmware:", *_firmware(entry.firmware))
    yield from _inner("camera", entry)


def _firmware(firmware: FirmwareRange) -> Iterator[str]:
    yield f"    min: {scalar(firmware.min)}"
    yield f"    max: {scalar(firmware.max)}"


def _intrinsics(calibration: Calibration) -> Iterator[str]:
    yield from ("intrinsics:", '  pixel_origin: "corner"')
    yield from (f"  {name}: {number(getattr(calibration.intrinsics, name))}" for name in PARAMETERS)


def _distortion(calibration: Calibration) -> Iterator[str]:
    lens = calibration.distortion
    if lens is None:
        yield "distortion: null"
        return
    yield from ("distortion:", f"  model: {quoted(lens.model)}")
    yield from (f"  {name}: {number(value)}" for name, value in lens.coefficients.items())


def _quality(quality: Quality) -> Iterator[str]:
    yield from _stated("  ", {"rms_px": quality.rms_px, "points": quality.points, "views": quality.views})
    if quality.std:
        first = [name for name in PARAMETERS if name in quality.std]
        names = [*first, *sorted(name for name in quality.std if name not in PARAMETERS)]
        yield "  std:"
        yield from (f"    {_name(name)}: {number(quality.std[name])}" for name in names)
    if quality.covariance is not None:
        yield from ("  covariance:", *_covariance(quality.covariance))
    yield from _stated("  ", {"kappa2": quality.kappa2, "coverage": quality.coverage})


def _covariance(covariance: Covariance) -> Iterator[str]:
    names = covariance.names
    yield f"    names: [{', '.join(map(quoted, names))}]"
    yield from ("    upper: [", *rows(range(len(names), 0, -1), covariance.upper, "      "), "    ]")


def _provenance(provenance: Provenance) -> Iterator[str]:
    yield from _stated("  ", {"kind": provenance.kind, "source": provenance.source, "tag": provenance.tag})
    if provenance.reference_size is not None:
        yield f"  reference_size: [{', '.join(map(str, provenance.reference_size))}]"
    yield from _stated("  ", {"adaptation": provenance.adaptation})
    yield from _list("assumptions", ((quoted(text),) for text in provenance.assumptions), "  ")
    yield from _stated("  ", {"sha256": provenance.sha256})
    files = ((f"name: {quoted(f.name)}", f"sha256: {quoted(f.sha256)}") for f in provenance.sources)
    yield from _list("sources", files, "  ")
    yield from _stated(
        "  ",
        {
            "tool": provenance.tool,
            "date": provenance.date,
            "operator": provenance.operator,
            "firmware": provenance.firmware,
            "focus": provenance.focus,
        },
    )


def _validity(validity: Validity) -> Iterator[str]:
    for name, day in (("from", validity.first), ("until", validity.last)):
        yield f"  {name}: {scalar(day.isoformat() if day is not None else None)}"


def _stated(indent: str, fields: Mapping[str, YamlScalar]) -> Iterator[str]:
    """The fields that say something; what is absent reads as null."""
    return (f"{indent}{name}: {scalar(value)}" for name, value in fields.items() if value is not None)


def _list(name: str, items: Iterable[tuple[str, ...]], indent: str = "") -> Iterator[str]:
    """A list of scalars, or of maps given as their lines; nothing where there is none."""
    for at, (first, *more) in enumerate(items):
        if at == 0:
            yield f"{indent}{name}:"
        yield f"{indent}  - {first}"
        yield from (f"{indent}    {line}" for line in more)


def _block(name: str, lines: Iterable[str], entry: Entry) -> Iterator[str]:
    inside = [*lines, *_inner(name, entry)]
    yield from (f"{name}:", *inside) if inside else (f"{name}: {{}}",)


def _inner(name: str, entry: Entry) -> Iterator[str]:
    """A block's own ``x-`` fields."""
    for path, value in entry.extensions.items():
        inside, slash, key = path.partition("/")
        if slash and inside == name:
            yield from block(key, value, "  ")


def _name(parameter: str) -> str:
    return parameter if parameter.isidentifier() and parameter.isascii() else quoted(parameter)
