"""OPF (Open Photogrammetry Format) calibrated cameras: what Pix4D's bundle adjustment found.

In the format's own words::

    {"format": "application/opf-calibrated-cameras+json", "version": "1.0",
     "sensors": [{"id": 1, "internals": {…}, "rig_relatives": {…}}],
     "cameras": [{"id": 2, "sensor_id": 1, "position": […], "orientation_deg": […]}]}

There is one camera for each sensor. The size of its images and its name are in the *input cameras* of the same project.
calibrary looks for them beside the file: by the project's list of resources in ``project.opf``, else under their usual
names. The project also names the program that wrote it. Where an image was taken from is left out, and not written.

Source: OPF specification 1.0, "Calibrated cameras".
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import BrownConrady, FisheyePolynomial, NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, UnknownLens, WriteContext
from calibrary.parsers.formats import _opf
from calibrary.parsers.formats._json_text import loaded
from calibrary.records import Json

MARK = "application/opf-calibrated-cameras+json"
INPUT_MARK = "application/opf-input-cameras+json"
INPUT_NAMES = ("input_cameras.json", "input-cameras.json")
PROJECT_NAMES = ("project.opf",)
KNOWN = frozenset({"internals"})
PREFIX = "opf_calibrated_cameras/"


class _Input(Struct, frozen=True):
    """What a project's input cameras say of its sensors, by id."""

    sizes: Mapping[int, ImageSize]
    names: Mapping[int, str]


def sniff(content: Content) -> Sniff | None:
    """The document names its format."""
    return _opf.sniffed(content, MARK)


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor, in order."""
    items = _opf.sensors(loaded(data, context), MARK)
    tool = _generator(context)
    known = _input(context)
    found: list[Calibration] = []
    for item, label in zip(items, _opf.labels(items, known.names), strict=True):
        stated = known.sizes.get(_opf.identity(item))
        # A size from the caller is for the sensors that the project does not describe.
        size = stated if stated is not None and len(items) > 1 else context.size(stated)
        intrinsics, distortion = _opf.optics(item["internals"], size)
        found.append(
            context.calibration(
                intrinsics,
                distortion,
                name=label,
                tag=item.place,
                tool=tool,
                grade=Grade.ADJUSTED,
                extras=_opf.extras(item, PREFIX, KNOWN),
            )
        )
    return found


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The sensors, without any camera that took a picture with them."""
    rows: list[Json] = []
    taken: set[int] = set()
    for calibration in calibrations:
        fields: dict[str, Json] = {
            key.removeprefix(PREFIX): json.loads(value)
            for key, value in calibration.extras
            if key.startswith(PREFIX)
        }
        number = fields.pop("id", None)
        if not isinstance(number, int) or number in taken:
            number = next(free for free in range(1, len(calibrations) + 2) if free not in taken)
        taken.add(number)
        optics = _opf.internals(calibration.intrinsics, calibration.distortion)
        rows.append({"id": number, "internals": optics, **fields})
    document: dict[str, Json] = {"format": MARK, "version": "1.0", "sensors": rows, "cameras": []}
    return (json.dumps(document, indent=4) + "\n").encode()


def _input(context: ReadContext) -> _Input:
    """The input cameras of the same project, empty where there are none beside the file."""
    sizes: dict[int, ImageSize] = {}
    names: dict[int, str] = {}
    for name in _companions(context):
        data = context.companion(name)
        if data is None:
            continue
        for sensor in _opf.sensors(loaded(data, context.of_companion(name)), INPUT_MARK):
            number = _opf.identity(sensor)
            sizes[number] = _opf.image_size(sensor)
            label = sensor.get("name")
            if label is not None:
                names[number] = label.text()
        break
    return _Input(sizes, names)


def _generator(context: ReadContext) -> str | None:
    """The program that wrote the project beside the file, with its version."""
    for name in PROJECT_NAMES:
        data = context.companion(name)
        generator = None if data is None else loaded(data, context.of_companion(name)).get("generator")
        if generator is not None:
            words = (generator.get(key) for key in ("name", "version"))
            return " ".join(word.text() for word in words if word is not None)
    return None


def _companions(context: ReadContext) -> Iterator[str]:
    """Where the input cameras may be, relative to the file; a project's resources, where they lie beside it."""
    for name in PROJECT_NAMES:
        data = context.companion(name)
        if data is not None:
            for uri in _opf.resources(loaded(data, context.of_companion(name)), INPUT_MARK):
                if not (uri.startswith("/") or ":" in uri or ".." in uri.split("/")):
                    yield uri
    yield from INPUT_NAMES


FORMAT = Format(
    name="opf_calibrated_cameras",
    title="OPF calibrated cameras (Pix4D)",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://pix4d.github.io/opf-spec/specification/calibrated_cameras.html",
    convention=_opf.CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, FisheyePolynomial),
        two_focals=False,
        several_cameras=True,
        unknown_lens=UnknownLens.FREE,
    ),
    needs_image_size=True,
)
