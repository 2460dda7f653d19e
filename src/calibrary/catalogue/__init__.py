"""Cameras known by name: one YAML file a maker in ``registry/catalogue/``, every number beside its source.

A catalogue states what a camera *is* (its sensor's pitch, its nominal lens), not how a unit was calibrated:
what it yields is a K to start from and a value to compare others with. Where sources disagree the entry says
so, and where none gives a number the number is left out.
"""

from calibrary.catalogue.files import CatalogueListing, Maker, load_catalogue, search_catalogue, shipped_with
from calibrary.catalogue.matching import Basis, Catalogue, Match, MatchOutcome, match_image

__all__ = [
    "Basis",
    "Catalogue",
    "CatalogueListing",
    "Maker",
    "Match",
    "MatchOutcome",
    "load_catalogue",
    "match_image",
    "search_catalogue",
    "shipped_with",
]
