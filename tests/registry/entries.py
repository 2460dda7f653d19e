"""Entries of our own making for the registry's tests."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import Any

import numpy as np
from hypothesis import strategies as st

from calibrary.calibration import (
    Calibration,
    CameraKey,
    Covariance,
    Grade,
    Intrinsics,
    Provenance,
    Quality,
    SourceFile,
)
from calibrary.distortion import BrownConrady, Distortion
from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Sensor, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.writing import FileChange, Written
from calibrary.registry.proposals import write_changes
from calibrary.registry.registry import Registry
from calibrary.registry.stating import Action, Change, stated
from tests.strategies import any_distortions, image_sizes

DIGITS = "5c" * 32
KEY = CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648))
FILE = Provenance(kind="calibration-file", source="lab.xml", sha256=DIGITS, date="2026-02-03", tool="lab 3.1")
LENS = BrownConrady(k1=-0.262, k2=0.104, p1=0.0007, p2=-0.0002, k3=-0.031)
_KEPT: Any = object()


def covariance(names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "k1"), seed: int = 7) -> Covariance:
    """Some uncertainty with correlations."""
    spread = np.random.default_rng(seed).normal(size=(len(names), len(names)))
    return Covariance.from_matrix(names, spread @ spread.T)


def put_entries(registry: Registry, entries: Sequence[tuple[Entry, str | None]], message: str) -> Written:
    """Write entries without comparing them with others, each with the blob id of the content it replaces."""
    changes = [FileChange(path=entry.path, data=entry_yaml(entry), base=base) for entry, base in entries]
    said = statements_on(registry, [entry for entry, _ in entries])
    return write_changes(registry.repo, [*changes, *said], message)


def statements_on(registry: Registry, entries: Sequence[Entry]) -> Sequence[FileChange]:
    """Who writes these entries also states that they are what their status says."""
    changes = []
    for entry in entries:
        if entry.status is Status.DRAFT:
            continue
        changes.append(a_change("approve", entry))
        if entry.status is not Status.APPROVED:
            changes.append(a_change("retire", entry))
    return stated(registry.snapshot(), changes).changes if registry.repo.tip() is not None else ()


def a_change(action: Action, entry: Entry, **more: Any) -> Change:
    """What a person does with an entry, told of nothing that was before."""
    return Change(action=action, before=None, after=entry, why=entry.reason, fields=(), **more)


def an_entry(
    key: CameraKey = KEY,
    *,
    fx: float = 3661.25,
    distortion: Distortion | None = LENS,
    quality: Quality | None = None,
    provenance: Provenance = FILE,
    grade: Grade = Grade.CALIBRATED,
    notes: tuple[str, ...] = (),
    size: tuple[int, int] | None = _KEPT,
    **fields: Any,
) -> Entry:
    """An approved entry of a Phantom 4 RTK; what is not an entry's own goes into its key or calibration."""
    stated = {
        name: fields.pop(name)
        for name in list(fields)
        if name in CameraKey.__struct_fields__ and name != "firmware"
    }
    key = replace(key, **stated)
    if size is not _KEPT:
        key = replace(key, image_size=size)
    width, height = key.image_size or (5472, 3648)
    calibration = Calibration(
        camera=key,
        intrinsics=Intrinsics(
            fx=fx, fy=fx - 2.5, cx=width / 2 - 4.5, cy=height / 2 + 7.25, image_size=(width, height)
        ),
        distortion=distortion,
        grade=grade,
        quality=quality,
        provenance=provenance,
        notes=notes,
    )
    return Entry(calibration=calibration, **{"status": Status.APPROVED, **fields})


def a_content(*given: Any, **fields: Any) -> Entry:
    """An entry as its file says it."""
    return an_entry(*given, **fields).as_draft


def texts() -> st.SearchStrategy[str]:
    """Whatever a camera or a person may write, but for what is no character."""
    return st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=40)


def _numbers() -> st.SearchStrategy[float]:
    return st.floats(allow_nan=False, allow_infinity=False)


def _names() -> st.SearchStrategy[str]:
    return texts().filter(str.strip)


def _plain() -> st.SearchStrategy[Any]:
    integers = st.integers(-(2**63), 2**64 - 1)
    scalars = st.one_of(st.none(), st.booleans(), integers, _numbers(), texts())
    return st.recursive(scalars, _containers, max_leaves=8)


def _containers(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.lists(inner, max_size=3) | st.dictionaries(texts(), inner, max_size=3)


@st.composite
def entries(draw: st.DrawFn) -> Entry:
    """Entries with anything in them that one may hold."""

    def maybe(strategy: st.SearchStrategy[Any]) -> Any:
        return draw(st.none() | strategy)

    width, height = draw(image_sizes())
    positive = st.floats(1e-3, 1e6)
    names = ("fx", "cy", "k1")
    quality = Quality(
        rms_px=maybe(st.floats(0, 1e3)),
        points=maybe(st.integers(0, 10**9)),
        views=maybe(st.integers(0, 10**6)),
        std={name: draw(st.floats(0, 1e3)) for name in draw(st.sets(st.sampled_from(names)))},
        covariance=maybe(st.builds(covariance, st.just(names), st.integers(0, 9))),
        kappa2=maybe(st.floats(0, 1e3)),
        coverage=maybe(st.floats(0, 1)),
    )
    provenance = replace(
        FILE,
        tag=maybe(texts()),
        assumptions=tuple(draw(st.lists(texts(), max_size=2))),
        sources=tuple(SourceFile(name=name, sha256=DIGITS) for name in draw(st.lists(texts(), max_size=2))),
        operator=maybe(texts()),
        reference_size=maybe(image_sizes()),
    )
    return Entry(
        calibration=Calibration(
            camera=CameraKey(
                make=draw(_names()),
                model=draw(_names()),
                sub_camera=maybe(_names()),
                lens=maybe(_names()),
                focal_mm=maybe(st.floats(1e-3, 1e4)),
                capture_mode=maybe(_names()),
                image_size=(width, height),
                serial=maybe(_names()),
            ),
            intrinsics=Intrinsics(
                fx=draw(positive),
                fy=draw(positive),
                cx=draw(_numbers()),
                cy=draw(_numbers()),
                skew=draw(_numbers()),
                image_size=(width, height),
            ),
            distortion=maybe(any_distortions()),
            grade=draw(st.sampled_from([grade for grade in Grade if grade.is_metric])),
            quality=draw(st.none() | st.just(quality)),
            provenance=provenance,
            notes=tuple(draw(st.lists(texts(), max_size=2))),
            extras=tuple(draw(st.dictionaries(texts(), texts(), max_size=2)).items()),
        ),
        firmware=maybe(
            st.sampled_from([FirmwareRange(min="01.00.0128"), FirmwareRange(min="1.9", max="01.10")])
        ),
        aliases=tuple(
            Alias(make=a, model=b) for a, b in draw(st.lists(st.tuples(_names(), _names()), max_size=2))
        ),
        sensor=maybe(st.builds(Sensor, width_mm=positive, height_mm=st.none() | positive)),
        validity=maybe(st.builds(Validity, first=st.dates(), last=st.just(date.max))),
        tolerance=maybe(st.floats(1e-6, 1)),
        supersedes=maybe(texts()),
        label=maybe(st.sampled_from(["P4R-03", "Drohne 3 (Süd)", "№ 7 #1"])),
        tags=tuple(draw(st.lists(st.sampled_from(["survey", "lab", "2026", "a.b_c-d"]), max_size=3))),
        extensions=draw(
            st.dictionaries(st.sampled_from(["x-a", "x-b.c", "camera/x-d", "provenance/x-e"]), _plain())
        ),
    )
