"""OPF (Open Photogrammetry Format) project, ``.opf``: the list of the files in which Pix4D keeps a project's cameras.

In the format's own words::

    {"format": "application/opf-project+json", "version": "1.0", "generator": {"name": "PIX4Dmatic", …}, "items": [
      {"type": "input_cameras", "resources": [{"format": "application/opf-input-cameras+json", "uri": "…"}], …},
      {"type": "calibration", "resources": [{"format": "application/opf-calibrated-cameras+json", "uri": "…"}], …}]}

The cameras are those of the project's calibration, with the sizes and names of its input cameras; the input cameras
themselves, if it has not been calibrated. A resource may lie in a folder beside the project, never outside. Of a
project with several calibrations, each is read by its own file.

Source: OPF specification 1.0, "Project format specification".
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from calibrary.calibration import Calibration, SourceFile
from calibrary.errors import ParseError
from calibrary.parsers.account import Account
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.document import Documents, keeping
from calibrary.parsers.format import Format, ReadContext, Sniff
from calibrary.parsers.formats import _opf, opf_calibrated_cameras, opf_input_cameras
from calibrary.parsers.formats._json_text import loaded
from calibrary.records import replace


def sniff(content: Content) -> Sniff | None:
    """The document names its format."""
    return _opf.sniffed(content, _opf.PROJECT_MARK)


def read(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """The cameras of its one calibration, else its input cameras."""
    project = loaded(data, context)
    for kind in (opf_calibrated_cameras, opf_input_cameras):
        named = list(dict.fromkeys(_opf.resources(project, kind.MARK)))
        if len(named) > 1:
            raise ParseError(
                f"the project has {kind.FORMAT.title} in {', '.join(named)}; read one of these files"
            )
        if named:
            break
    else:
        raise ParseError("the project has no cameras: export it again, with its calibration")

    def beside(name: str) -> bytes | None:
        return data if name in opf_calibrated_cameras.PROJECT_NAMES else context.companion(name)

    [name] = named
    cameras = context.companion(name)
    if cameras is None:
        raise ParseError(f"its cameras, {name}, are not beside it; keep the project's folder together")
    within = replace(context, name=name, companion=beside, json=None)
    account = Account(kind.FORMAT, cameras, within, Documents(), is_text=True)
    with keeping(account.documents):
        found = account.settled(kind.read(cameras, account.context))
    file = SourceFile(name=name, sha256=hashlib.sha256(cameras).hexdigest())
    return [
        replace(item, provenance=replace(item.provenance, source=context.name, sources=(file,)))
        for item in found
    ]


FORMAT = Format(
    name="opf_project",
    title="OPF project (Pix4D)",
    suffixes=(".opf",),
    syntaxes=(Syntax.JSON,),
    reference="https://pix4d.github.io/opf-spec/specification/project.html",
    convention=_opf.CONVENTION,
    sniff=sniff,
    read=read,
)
