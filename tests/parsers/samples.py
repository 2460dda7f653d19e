"""One small file of every format, written by us: by the format's own writer, or by the format's own test.

A test module in ``formats/`` whose format has no writer exports ``SAMPLES``, a :class:`Sample` by the format's
name. It is found there, so a new format is tested, and fuzzed, by being there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parent / "formats"


@dataclass(frozen=True, slots=True)
class Sample:
    """A file and what its reader has to be given.

    Attributes:
        data: its bytes.
        options: answers to the format's questions.
        beside: the files that belong to it, by name.
    """

    data: bytes
    options: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, bytes] = field(default_factory=dict)


@cache
def exported() -> Mapping[str, Sample]:
    """What the formats' own tests export, by format."""
    found: dict[str, Sample] = {}
    for path in sorted(FOLDER.glob("test_*.py")):
        module = import_module(f"tests.parsers.formats.{path.stem}")
        found.update(getattr(module, "SAMPLES", {}))
    return found
