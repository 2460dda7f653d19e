"""OPF (Open Photogrammetry Format) input cameras: what Pix4D's database or the user said before calibration.

In the format's own words::

    {"format": "application/opf-input-cameras+json", "version": "1.0",
     "sensors": [{"id": 1, "name": "FC6310_8.8_5472x3648", "image_size_px": [5472, 3648], "pixel_size_um": 2.4,
                  "internals": {…}, "bands": […], "shutter_type": "global"}],
     "captures": [{"cameras": [{"sensor_id": 1, "model_source": "database", …}], …}]}

There is one camera for each sensor. Its grade depends on the source of its model that the pictures state: the camera
database or the user gives ``design``, the EXIF focal length gives ``derived``, and an unknown source gives only
``prior``.

Source: OPF specification 1.0, "Input cameras".
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Grade
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff
from calibrary.parsers.formats import _opf
from calibrary.parsers.formats._json_text import loaded

MARK = "application/opf-input-cameras+json"
PREFIX = "opf_input_cameras/"
KNOWN = frozenset({"image_size_px", "internals"})
GRADES = {
    "database": Grade.DESIGN,
    "user": Grade.DESIGN,
    "generic_from_exif": Grade.DERIVED,
    "generic": Grade.PRIOR,
}
"""By the ``model_source`` of the pictures taken with a sensor."""


def sniff(content: Content) -> Sniff | None:
    """The document names its format."""
    return _opf.sniffed(content, MARK)


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor, in order."""
    document = loaded(data, context)
    items = _opf.sensors(document, MARK)
    origins = _origins(document)
    names = {_opf.identity(item): item["name"].text() for item in items if "name" in item}
    found: list[Calibration] = []
    for item, label in zip(items, _opf.labels(items, names), strict=True):
        size = _opf.image_size(item)
        if len(items) == 1:
            size = context.size(size)
        intrinsics, distortion = _opf.optics(item["internals"], size)
        found.append(
            context.calibration(
                intrinsics,
                distortion,
                name=label,
                tag=item.place,
                grade=_grade(origins.get(_opf.identity(item), set())),
                notes=("these are the numbers a project began with, not what its adjustment found",),
                extras=_opf.extras(item, PREFIX, KNOWN),
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


FORMAT = Format(
    name="opf_input_cameras",
    title="OPF input cameras (Pix4D)",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://pix4d.github.io/opf-spec/specification/input_cameras.html",
    convention=_opf.CONVENTION,
    sniff=sniff,
    read=read,
)
