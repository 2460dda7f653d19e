"""MATLAB's camera parameters as JSON or YAML: ``jsonencode(toStruct(cameraParams))`` and what scripts make of it.

In the format's own words::

    {"RadialDistortion": [-0.1131, 0.0247], "TangentialDistortion": [0, 0], "ImageSize": [3648, 5472],
     "IntrinsicMatrix": [[3650.1, 0, 0], [0, 3648.7, 0], [2741.3, 1815.9, 1]], "MeanReprojectionError": 0.31}

The fields are MATLAB's own (``_matlab_camera``): the matrix is transposed, or called K and is not, the centre of the
first pixel is (1, 1), and sizes are rows and columns. The struct may be under a name, and there may be several.

Source: The MathWorks, "cameraParameters" and ``jsonencode``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._matlab_camera import CONVENTION, cameras, is_camera


def sniff(content: Content) -> Sniff | None:
    """MATLAB's names of the distortion beside those of K."""
    document = content.json
    if isinstance(document, dict):
        if any(is_camera(value) for value in (document, *document.values())):
            return Sniff(Sure.MAGIC, "JSON with RadialDistortion and MATLAB's names of K")
        return None
    if "RadialDistortion" not in (content.text or ""):
        return None
    keys = {line.partition(":")[0].strip("\"' ") for line in content.lines}
    if "RadialDistortion" in keys and keys & {"IntrinsicMatrix", "FocalLength"} and not content.xml_tags:
        return Sniff(Sure.MAGIC, "the keys RadialDistortion and MATLAB's names of K")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera among the structs."""
    tree = storage.load(data, source=context.name)
    found = cameras(tree, context)
    if not found:
        tree.fail("there is no struct with RadialDistortion and a K, an IntrinsicMatrix or a FocalLength")
    return found


FORMAT = Format(
    name="matlab_json",
    title="MATLAB camera parameters in JSON or YAML",
    suffixes=(".json", ".yaml", ".yml"),
    syntaxes=(Syntax.JSON, Syntax.TEXT),
    reference="https://www.mathworks.com/help/vision/ref/cameraparameters.tostruct.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
