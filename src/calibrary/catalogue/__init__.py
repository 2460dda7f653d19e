"""Cameras known by name: one YAML file per maker in ``registry/catalogue/``, with a source for every number.

The catalogue describes a camera model (pixel pitch, nominal lens), not the calibration of a unit: it gives a
K to start from and a value to compare others with. If sources disagree, the entry says so; a number that no
source states is left out.
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
from calibrary.catalogue.matching import Basis, Catalogue, Match, MatchOutcome, match_image

__all__ = [
    "Basis",
    "Catalogue",
    "CatalogueListing",
    "Maker",
    "Match",
    "MatchOutcome",
    "camera_named",
    "load_catalogue",
    "match_image",
    "search_catalogue",
    "shipped_catalogue",
    "shipped_with",
]
