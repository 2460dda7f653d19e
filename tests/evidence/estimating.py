"""The estimates of one image."""

from __future__ import annotations

from calibrary.evidence.context import Source, SourceEstimate
from calibrary.evidence.weighing import Evidence


def estimate(evidence: Evidence, source: Source) -> SourceEstimate:
    return next(w for w in evidence.estimates if w.source is source)
