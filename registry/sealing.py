"""The verdict on a calibration, sealed in its entry.

The seal names the digest of the numbers that were judged, so that it says nothing of another K in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.records import replace
from calibrary.registry.entry import Entry, digest
from calibrary.strictyaml import YamlValue

__all__ = ["VERDICT_BLOCK", "Seal", "noted", "seal", "sealed"]

VERDICT_BLOCK: Final = "x-board-calibration"
"""Block that a calibration from a board or a flight, or a combination, adds to its entry: its verdict, and how it was
made."""


class Seal(Struct, frozen=True, kw_only=True):
    """A verdict with its reasons.

    Attributes:
        verdict: pass, provisional or refuse.
        reasons: names of the rules behind it.
    """

    verdict: str
    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the calibration may be approved; any other is a start at most."""
        return self.verdict == "pass"

    def __str__(self) -> str:
        why = f" ({', '.join(self.reasons)})" if self.reasons and not self.passed else ""
        return f"its calibration ended {self.verdict.upper()}{why}"


def seal(
    calibration: Calibration, verdict: str, reasons: list[str], how: Mapping[str, YamlValue]
) -> dict[str, YamlValue]:
    """Return the entry's block on a calibration: the verdict on its numbers, and how it was made."""
    return {"verdict": verdict, "reasons": [*reasons], "digest": digest(calibration), **how}


def sealed(entry: Entry) -> Seal | None:
    """Return the verdict on an entry's calibration; None if nobody judged it, or another K was judged.

    A verdict in the calibration's notes counts as well: entries had no other before they were sealed.
    """
    block = entry.extensions.get(VERDICT_BLOCK)
    said = block if isinstance(block, dict) and "verdict" in block else {}
    if said.get("digest", digest(entry.calibration)) != digest(entry.calibration):
        said = {}
    verdict = entry.calibration.shortfall or said.get("verdict")
    reasons = said.get("reasons")
    return (
        Seal(verdict=str(verdict), reasons=tuple(map(str, reasons)) if isinstance(reasons, list) else ())
        if verdict is not None
        else None
    )


def noted(entry: Entry) -> Calibration:
    """Return an entry's calibration, whose notes state the verdict if it did not pass."""
    found, calibration = sealed(entry), entry.calibration
    if found is None or found.passed or calibration.shortfall is not None:
        return calibration
    said = (
        f"{found.verdict}: {Calibration.SHORT}",
        *(f"{rule}: of its calibration" for rule in found.reasons),
    )
    return replace(calibration, notes=(*said, *calibration.notes))
