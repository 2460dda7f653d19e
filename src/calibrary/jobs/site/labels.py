"""A sheet of labels to print: for each unit its name, its serial number's hash, its K and a QR code of its page."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape
from urllib.parse import quote

from msgspec import Struct

from calibrary.errors import InputError

LABELS = "labels.html"
PRINTABLE = re.compile(r"https?://[A-Za-z0-9.:\[\]-]+(?:/[!$-.0->@-\[\]-~/]*)?")
"""An address of visible ASCII, with a host, and without a password, a query or a fragment."""
LONGEST_ADDRESS = 300
"""Longer ones would make codes that a telephone does not read from a small label."""
QUIET = 4
"""Modules of white around a code (ISO/IEC 18004)."""
HASH_DIGITS = 8

HEAD = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Labels of the units</title>
<style>
@page { size: A4; margin: 10mm }
body { margin: 0; background: #fff; color: #000; font: 8pt/1.3 sans-serif }
h1 { font-size: 11pt; margin: 0 0 3mm }
ul { display: grid; grid-template-columns: repeat(auto-fill, 62mm); gap: 2mm; margin: 0; padding: 0; list-style: none }
li { display: grid; grid-template-columns: 26mm 1fr; gap: 2mm; align-items: center; height: 30mm; overflow: hidden;
  padding: 1mm; box-sizing: border-box; border: .2mm dashed #888; break-inside: avoid; overflow-wrap: anywhere }
li svg { width: 26mm; height: 26mm }
b { display: block; font-size: 11pt }
@media print { h1 { display: none } }
</style>
</head>
<body>
<h1>Labels of the units</h1>
<ul>
"""


class Label(Struct, frozen=True, kw_only=True):
    """A unit's label.

    Attributes:
        name: what people call the unit; None if it has no label.
        camera: make and model.
        serial: hash of its serial number.
        entry: KEY of the entry with its K.
        page: address of that entry's page within the site.
    """

    name: str | None
    camera: str
    serial: str
    entry: str
    page: str


def check_address(address: str) -> str:
    """Return the address of a site with a slash at its end.

    Raises:
        InputError: it is not one, or too long.
    """
    if not PRINTABLE.fullmatch(address) or len(address) > LONGEST_ADDRESS:
        raise InputError(
            f"expected where the pages are served, as https://HOST/PATH/, in at most {LONGEST_ADDRESS} characters",
            source=address,
        )
    return f"{address.rstrip('/')}/"


def sheet(labels: Iterable[Label], address: str) -> str:
    """Return the sheet as HTML, which loads nothing and runs no script.

    Args:
        labels: of the units, in the order of the sheet.
        address: of the site, with a slash at its end.
    """
    parts = [_label(one, address) for one in sorted(labels, key=lambda one: (one.name or "~", one.entry))]
    return HEAD + "".join(parts) + "</ul>\n</body>\n</html>\n"


def code_of(address: str, light: str | None = None) -> str:
    """Return a QR code as SVG, black on what is around it, or on the colour ``light``."""
    import segno

    return segno.make_qr(address, error="m").svg_inline(
        omitsize=True, border=QUIET, svgclass=None, lineclass=None, light=light
    )


def _label(one: Label, address: str) -> str:
    code = code_of(address + quote(one.page, safe="/"))
    lines = (one.camera, f"sn-{one.serial[:HASH_DIGITS]}", one.entry)
    text = "<br>".join(escape(line) for line in lines)
    return (
        f'<li><a href="{escape(one.page)}">{code}</a><div><b>{escape(one.name or "")}</b>{text}</div></li>\n'
    )
