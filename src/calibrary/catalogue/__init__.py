"""Cameras known by name: one YAML file per maker in ``registry/catalogue/``, with a source for every number.

The catalogue describes a camera model (pixel pitch, nominal lens), not the calibration of a unit: it gives a
K to start from and a value to compare others with. If sources disagree, the entry says so; a number that no
source states is left out.

A new camera is an entry of the maker's file:

1.  ``models`` are the spellings of EXIF Model and ``make`` that of EXIF Make, as the camera writes them
    (``calibrary inspect --tags IMAGE`` shows both); letter case and blanks do not matter. A maker without a file gets
    one, named as its make in lower case.
2.  Each number stands with its source, ``{value: 2.4, source: "DJI: data sheet"}``; the word before the colon is a key
    of the file's ``references``. :class:`~calibrary.known_camera.KnownCamera` explains the fields, ``native_size`` and
    ``pitch_um`` are the ones that give a K, ``fx_over_w`` is what a K is compared with. ``sizes`` are stated only if
    they are all: an image of another size is taken for a crop. If sources disagree, say so under ``conflicts`` instead
    of choosing silently.
3.  Several sensors under one Model are several entries, each with its ``sub_camera``; several lenses of one body each
    with its ``lens``.
4.  ``calibrary catalogue MODEL`` shows the entry. ``tests/registry/test_catalogue.py`` names what is wrong with it: a
    source without a reference, an image that would not find it, a focal length that does not give its fx.

A camera that writes its calibration in a new way also needs a reader in :mod:`calibrary.evidence` (a module with
``estimates(scene)``, and its row in ``SOURCES`` of ``evidence/weighing.py``) and an image that writes it so in
``tests/imagery/``.
"""

from calibrary.catalogue.files import (
    CatalogueListing,
    Maker,
    camera_named,
    load_catalogue,
    search_catalogue,
    shipped_catalogue,
    shipped_with,
)
from calibrary.catalogue.matching import (
    Basis,
    Catalogue,
    Identified,
    Match,
    MatchOutcome,
    identified,
    match_image,
)

__all__ = [
    "Basis",
    "Catalogue",
    "CatalogueListing",
    "Identified",
    "Maker",
    "Match",
    "MatchOutcome",
    "camera_named",
    "identified",
    "load_catalogue",
    "match_image",
    "search_catalogue",
    "shipped_catalogue",
    "shipped_with",
]
