"""Cameras known by name: one YAML file a maker, every number beside its source.

A catalogue tells what a camera *is* (its sensor's pitch, its nominal lens), not how a unit was calibrated:
what it yields is a K to start from and a value to hold others against. Where sources disagree the entry says
so, and where none gives a number the number is left out.
"""

from calibrary.registry.catalogue.files import load_catalogue, to_json
from calibrary.registry.catalogue.images import match_image
from calibrary.registry.catalogue.matching import Basis, Catalogue, Match, MatchOutcome

__all__ = ["Basis", "Catalogue", "Match", "MatchOutcome", "load_catalogue", "match_image", "to_json"]
