"""OPF, the Open Photogrammetry Format: its documents of cameras, and the project that lists them."""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from urllib.parse import unquote

from msgspec import Struct

from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, SourceFile
from calibrary.distortion import BrownConrady, Distortion, FisheyePolynomial, NoDistortion, required
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.account import Account
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Documents, Node, keeping
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._json_text import loaded
from calibrary.records import Json, replace

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("R1", "R2", "R3", "T1", "T2"),
    remarks=(
        "a fisheye's polynomial p0 p1 p2 p3 takes 2θ/π, the angle from the axis in right angles, to the radius",
        "a fisheye's focal length is 2/π of its affine matrix",
    ),
)
PROJECT_MARK = "application/opf-project+json"
MOST_POWERS = 5
"""Most coefficients of a fisheye's polynomial, up to p4 as in calibrary's model."""

RIGHT_ANGLE = math.pi / 2


def sniffed(content: Content, mark: str) -> Sniff | None:
    """Recognise a document with the ``format`` ``mark``."""
    document = content.json
    if isinstance(document, dict) and document.get("format") == mark:
        return Sniff(Sure.MAGIC, f"its format is '{mark}'")
    return None


def sensors(document: Node, mark: str) -> tuple[Node, ...]:
    """The sensors of a document.

    Raises:
        ParseError: it is not a document of this format, or contains no sensor.
        UnsupportedModelError: it has a later major version.
    """
    found = document["format"].text()
    if found != mark:
        raise ParseError(f"its format is {strict.shown(found)}, expected '{mark}'", source=document.source)
    version = document["version"].text()
    if version.partition(".")[0] not in {"0", "1"}:
        raise UnsupportedModelError(
            f"it is of version {strict.shown(version)}; 0 and 1 are known",
            source=document.source,
            place="version",
        )
    items = document["sensors"].items()
    if not items:
        document["sensors"].fail("there is no sensor")
    return items


def resources(project: Node, mark: str) -> Iterator[str]:
    """Where a project's documents of the format ``mark`` are, relative to the project."""
    for item in project["items"].items():
        for resource in item["resources"].items():
            if resource["format"].value == mark:
                yield unquote(resource["uri"].text())


def labels(items: tuple[Node, ...], names: Mapping[int, str]) -> list[str | None]:
    """Distinct labels of a document's sensors: names, with the id if names are equal; None for a single sensor."""
    if len(items) == 1:
        return [None]
    ids = [identity(item) for item in items]
    called = [names.get(number, "") for number in ids]
    bearers = Counter(called)
    return [
        name if name and bearers[name] == 1 else f"{name or 'sensor'} {number}"
        for name, number in zip(called, ids, strict=True)
    ]


def identity(sensor: Node) -> int:
    """A sensor's id, a 64-bit integer, which a float would round.

    Raises:
        ParseError: it is not an integer.
    """
    value = sensor["id"].value
    if not isinstance(value, int) or isinstance(value, bool):
        sensor["id"].fail("this is not a whole number, as an id is")
    return value


def image_size(sensor: Node) -> ImageSize:
    """The image size of an input camera.

    Raises:
        ParseError: it is not an image size.
    """
    node = sensor["image_size_px"]
    width, height = node.numbers(2)
    return strict.image_size(width, height, source=node.source, place=node.place)


def extras(sensor: Node, prefix: str, known: frozenset[str]) -> tuple[tuple[str, str], ...]:
    """The other keys of a sensor, as JSON."""
    return tuple(
        (prefix + key, json.dumps(value.value)) for key, value in sensor.entries() if key not in known
    )


def optics(node: Node, size: ImageSize) -> tuple[Intrinsics, Distortion]:
    """K and distortion of a sensor's ``internals``.

    Raises:
        ParseError: the internals are invalid.
        UnsupportedModelError: a spherical camera, or an affine matrix or polynomial without a counterpart.
    """
    kind = node["type"].text()
    if kind == "perspective":
        return _perspective(node, size)
    if kind == "fisheye":
        return _fisheye(node, size)
    raise UnsupportedModelError(
        f"a {strict.shown(kind)} camera has no K; expected perspective or fisheye",
        source=node.source,
        place=node["type"].place,
    )


def internals(K: Intrinsics, distortion: Distortion | None) -> dict[str, Json]:
    """The ``internals`` of a camera."""
    native = CONVENTION.native(K)
    centre: dict[str, Json] = {"principal_point_px": [native.cx, native.cy]}
    if isinstance(distortion, FisheyePolynomial):
        k2, k3, k4 = distortion.coefficients.values()
        polynomial: list[Json] = [0.0, 1.0, k2 * RIGHT_ANGLE, k3 * RIGHT_ANGLE**2]
        affine: list[Json] = [
            native.fx * RIGHT_ANGLE,
            native.skew * RIGHT_ANGLE,
            0.0,
            native.fy * RIGHT_ANGLE,
        ]
        return {
            "type": "fisheye",
            **centre,
            "is_symmetric_affine": native.fx == native.fy and not native.skew,
            "affine": affine,
            "polynomial": [*polynomial, k4 * RIGHT_ANGLE**3] if k4 else polynomial,
            "is_p0_zero": True,
        }
    brown = required(distortion, BrownConrady)
    return {
        "type": "perspective",
        **centre,
        "focal_length_px": native.fx,
        "radial_distortion": [brown.k1, brown.k2, brown.k3],
        "tangential_distortion": [brown.p1, brown.p2],
    }


def _perspective(node: Node, size: ImageSize) -> tuple[Intrinsics, Distortion]:
    focal = node["focal_length_px"].number()
    cx, cy = node["principal_point_px"].numbers(2)
    k1, k2, k3 = node["radial_distortion"].numbers(3)
    p1, p2 = node["tangential_distortion"].numbers(2)
    K = CONVENTION.intrinsics(Native(fx=focal, fy=focal, cx=cx, cy=cy), size, source=node.source)
    if not any((k1, k2, k3, p1, p2)):
        return K, NoDistortion()
    return K, BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)


def _fisheye(node: Node, size: ImageSize) -> tuple[Intrinsics, Distortion]:
    cx, cy = node["principal_point_px"].numbers(2)
    c, d, e, f = node["affine"].numbers(4)
    if e:
        raise UnsupportedModelError(
            f"the affine matrix is rotated (e = {e:g}), which K has no place for",
            source=node.source,
            place=node["affine"].place,
        )
    polynomial = node["polynomial"].numbers()
    while len(polynomial) > 2 and not polynomial[-1]:
        polynomial = polynomial[:-1]
    if not 2 <= len(polynomial) <= MOST_POWERS or polynomial[0] or not polynomial[1] > 0:
        raise UnsupportedModelError(
            f"the polynomial is {', '.join(f'{p:g}' for p in polynomial[: MOST_POWERS + 1])}; expected p0 = 0, "
            f"p1 > 0 and nothing past p{MOST_POWERS - 1}",
            source=node.source,
            place=node["polynomial"].place,
        )
    p1, *rest = polynomial[1:]
    k2, k3, k4 = (p / p1 / RIGHT_ANGLE**power for power, p in enumerate([*rest, 0.0, 0.0, 0.0][:3], start=1))
    scale = p1 / RIGHT_ANGLE
    native = Native(fx=c * scale, fy=f * scale, cx=cx, cy=cy, skew=d * scale)
    K = CONVENTION.intrinsics(native, size, source=node.source)
    return K, FisheyePolynomial(k2=k2, k3=k3, k4=k4)


CALIBRATED_MARK = "application/opf-calibrated-cameras+json"
INPUT_MARK = "application/opf-input-cameras+json"
INPUT_NAMES = ("input_cameras.json", "input-cameras.json")
PROJECT_NAMES = ("project.opf",)
CALIBRATED_KNOWN = frozenset({"internals"})
CALIBRATED_PREFIX = "opf_calibrated_cameras/"


class _Input(Struct, frozen=True):
    """What a project's input cameras say of its sensors, by id."""

    sizes: Mapping[int, ImageSize]
    names: Mapping[int, str]


def sniff_calibrated(content: Content) -> Sniff | None:
    """The document names its format."""
    return sniffed(content, CALIBRATED_MARK)


def read_calibrated(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor, in order."""
    items = sensors(loaded(data, context), CALIBRATED_MARK)
    tool = _generator(context)
    known = _input(context)
    found: list[Calibration] = []
    for item, label in zip(items, labels(items, known.names), strict=True):
        stated = known.sizes.get(identity(item))
        # A size from the caller is for the sensors that the project does not describe.
        size = stated if stated is not None and len(items) > 1 else context.size(stated)
        intrinsics, distortion = optics(item["internals"], size)
        found.append(
            context.calibration(
                intrinsics,
                distortion,
                name=label,
                tag=item.place,
                tool=tool,
                grade=Grade.ADJUSTED,
                extras=extras(item, CALIBRATED_PREFIX, CALIBRATED_KNOWN),
            )
        )
    return found


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The sensors, without any camera that took a picture with them."""
    rows: list[Json] = []
    taken: set[int] = set()
    for calibration in calibrations:
        fields: dict[str, Json] = {
            key.removeprefix(CALIBRATED_PREFIX): json.loads(value)
            for key, value in calibration.extras
            if key.startswith(CALIBRATED_PREFIX)
        }
        number = fields.pop("id", None)
        if not isinstance(number, int) or number in taken:
            number = next(free for free in range(1, len(calibrations) + 2) if free not in taken)
        taken.add(number)
        optics = internals(calibration.intrinsics, calibration.distortion)
        rows.append({"id": number, "internals": optics, **fields})
    document: dict[str, Json] = {"format": CALIBRATED_MARK, "version": "1.0", "sensors": rows, "cameras": []}
    return (json.dumps(document, indent=4) + "\n").encode()


def _input(context: ReadContext) -> _Input:
    """The input cameras of the same project, empty where there are none beside the file."""
    sizes: dict[int, ImageSize] = {}
    names: dict[int, str] = {}
    for name in _companions(context):
        data = context.companion(name)
        if data is None:
            continue
        for sensor in sensors(loaded(data, context.of_companion(name)), INPUT_MARK):
            number = identity(sensor)
            sizes[number] = image_size(sensor)
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
            for uri in resources(loaded(data, context.of_companion(name)), INPUT_MARK):
                if not (uri.startswith("/") or ":" in uri or ".." in uri.split("/")):
                    yield uri
    yield from INPUT_NAMES


CALIBRATED = Format(
    name="opf_calibrated_cameras",
    title="OPF calibrated cameras (Pix4D)",
    words="""\
OPF (Open Photogrammetry Format) calibrated cameras: what Pix4D's bundle adjustment found.

In the format's own words::

    {"format": "application/opf-calibrated-cameras+json", "version": "1.0",
     "sensors": [{"id": 1, "internals": {…}, "rig_relatives": {…}}],
     "cameras": [{"id": 2, "sensor_id": 1, "position": […], "orientation_deg": […]}]}

There is one camera for each sensor. The size of its images and its name are in the *input cameras* of the same project.
calibrary looks for them beside the file: by the project's list of resources in ``project.opf``, else under their usual
names. The project also names the program that wrote it. Where an image was taken from is left out, and not written.

Source: OPF specification 1.0, "Calibrated cameras".
""",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://pix4d.github.io/opf-spec/specification/calibrated_cameras.html",
    convention=CONVENTION,
    sniff=sniff_calibrated,
    read=read_calibrated,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, FisheyePolynomial),
        two_focals=False,
        several_cameras=True,
        unknown_lens=UnknownLens.FREE,
    ),
    needs_image_size=True,
)


INPUT_MARK = "application/opf-input-cameras+json"
INPUT_PREFIX = "opf_input_cameras/"
INPUT_KNOWN = frozenset({"image_size_px", "internals"})
GRADES = {
    "database": Grade.DESIGN,
    "user": Grade.DESIGN,
    "generic_from_exif": Grade.DERIVED,
    "generic": Grade.PRIOR,
}
"""By the ``model_source`` of the pictures taken with a sensor."""


def sniff_input(content: Content) -> Sniff | None:
    """The document names its format."""
    return sniffed(content, INPUT_MARK)


def read_input(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor, in order."""
    document = loaded(data, context)
    items = sensors(document, INPUT_MARK)
    origins = _origins(document)
    names = {identity(item): item["name"].text() for item in items if "name" in item}
    found: list[Calibration] = []
    for item, label in zip(items, labels(items, names), strict=True):
        size = image_size(item)
        if len(items) == 1:
            size = context.size(size)
        intrinsics, distortion = optics(item["internals"], size)
        found.append(
            context.calibration(
                intrinsics,
                distortion,
                name=label,
                tag=item.place,
                grade=_grade(origins.get(identity(item), set())),
                notes=("these are the numbers a project began with, not what its adjustment found",),
                extras=extras(item, INPUT_PREFIX, INPUT_KNOWN),
            )
        )
    return found


def _origins(document: Node) -> dict[int, set[str]]:
    """Where the pictures of each sensor say its model comes from."""
    found: dict[int, set[str]] = {}
    for capture in document["captures"].items() if "captures" in document else ():
        for camera in capture["cameras"].items():
            number, origin = camera["sensor_id"].value, camera.get("model_source")
            if isinstance(number, int) and origin is not None:
                found.setdefault(number, set()).add(origin.text())
    return found


def _grade(origins: set[str]) -> Grade:
    """The worst of them; a sensor without pictures stands as a database's would."""
    grades = [GRADES.get(origin, Grade.PRIOR) for origin in origins]
    return max(grades, key=lambda grade: grade.rank, default=Grade.DESIGN)


INPUT = Format(
    name="opf_input_cameras",
    title="OPF input cameras (Pix4D)",
    words="""\
OPF (Open Photogrammetry Format) input cameras: what Pix4D's database or the user said before calibration.

In the format's own words::

    {"format": "application/opf-input-cameras+json", "version": "1.0",
     "sensors": [{"id": 1, "name": "FC6310_8.8_5472x3648", "image_size_px": [5472, 3648], "pixel_size_um": 2.4,
                  "internals": {…}, "bands": […], "shutter_type": "global"}],
     "captures": [{"cameras": [{"sensor_id": 1, "model_source": "database", …}], …}]}

There is one camera for each sensor. Its grade depends on the source of its model that the pictures state: the camera
database or the user gives ``design``, the EXIF focal length gives ``derived``, and an unknown source gives only
``prior``.

Source: OPF specification 1.0, "Input cameras".
""",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://pix4d.github.io/opf-spec/specification/input_cameras.html",
    convention=CONVENTION,
    sniff=sniff_input,
    read=read_input,
)


def sniff_project(content: Content) -> Sniff | None:
    """The document names its format."""
    return sniffed(content, PROJECT_MARK)


def read_project(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """The cameras of its one calibration, else its input cameras."""
    project = loaded(data, context)
    for kind, mark in ((CALIBRATED, CALIBRATED_MARK), (INPUT, INPUT_MARK)):
        named = list(dict.fromkeys(resources(project, mark)))
        if len(named) > 1:
            raise ParseError(f"the project has {kind.title} in {', '.join(named)}; read one of these files")
        if named:
            break
    else:
        raise ParseError("the project has no cameras: export it again, with its calibration")

    def beside(name: str) -> bytes | None:
        return data if name in PROJECT_NAMES else context.companion(name)

    [name] = named
    cameras = context.companion(name)
    if cameras is None:
        raise ParseError(f"its cameras, {name}, are not beside it; keep the project's folder together")
    within = replace(context, name=name, companion=beside, json=None)
    account = Account(kind, cameras, within, Documents(), is_text=True)
    read = read_calibrated if kind is CALIBRATED else read_input
    with keeping(account.documents):
        found = account.settled(read(cameras, account.context))
    file = SourceFile(name=name, sha256=hashlib.sha256(cameras).hexdigest())
    return [
        replace(item, provenance=replace(item.provenance, source=context.name, sources=(file,)))
        for item in found
    ]


PROJECT = Format(
    name="opf_project",
    title="OPF project (Pix4D)",
    words="""\
OPF (Open Photogrammetry Format) project, ``.opf``: the list of the files in which Pix4D keeps a project's cameras.

In the format's own words::

    {"format": "application/opf-project+json", "version": "1.0", "generator": {"name": "PIX4Dmatic", …}, "items": [
      {"type": "input_cameras", "resources": [{"format": "application/opf-input-cameras+json", "uri": "…"}], …},
      {"type": "calibration", "resources": [{"format": "application/opf-calibrated-cameras+json", "uri": "…"}], …}]}

The cameras are those of the project's calibration, with the sizes and names of its input cameras; the input cameras
themselves, if it has not been calibrated. A resource may lie in a folder beside the project, never outside. Of a
project with several calibrations, each is read by its own file.

Source: OPF specification 1.0, "Project format specification".
""",
    suffixes=(".opf",),
    syntaxes=(Syntax.JSON,),
    reference="https://pix4d.github.io/opf-spec/specification/project.html",
    convention=CONVENTION,
    sniff=sniff_project,
    read=read_project,
)

FORMATS = (
    CALIBRATED,
    INPUT,
    PROJECT,
)
