"""Which entry answers for a camera, in what frame, and what it says of the others."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from typing import Any

import pytest

from calibrary.calibration import CameraKey, SourceFile
from calibrary.errors import AmbiguousEntryError
from calibrary.known_camera import match_key
from calibrary.quality import Quality
from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Status, Validity
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.resolution import RegistryIndex, near, resolve
from tests.registry.entries import DIGITS, KEY, an_entry

SIZE = (5472, 3648)


def at_home(*entries: Entry) -> dict[str, Entry]:
    return {entry.path: entry for entry in entries}


def fx(entries: Mapping[str, Entry], key: CameraKey = KEY, **asked: Any) -> float | None:
    found = resolve(entries, key, **asked)
    return found.calibration.intrinsics.fx if found is not None else None


UNIT = an_entry(fx=3001.0, serial="9f2c")
FIRMWARE = an_entry(fx=3002.0, firmware=FirmwareRange(min="01.09"))
LENS = an_entry(fx=3003.0, lens="35 mm", focal_mm=None)
FOCAL = an_entry(fx=3004.0)
SUB_CAMERA = an_entry(fx=3005.0, sub_camera="wide", focal_mm=None)
MODEL = an_entry(fx=3006.0, focal_mm=None)
ALL = (UNIT, FIRMWARE, LENS, FOCAL, SUB_CAMERA, MODEL)
WHOLE_KEY = replace(KEY, serial="9f2c", firmware="01.10", lens="35 MM", sub_camera="WideCamera")


@pytest.mark.parametrize("left", range(len(ALL)))
def test_the_most_specific_entry_answers(left: int) -> None:
    assert fx(at_home(*ALL[left:]), WHOLE_KEY) == ALL[left].calibration.intrinsics.fx


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        (replace(WHOLE_KEY, serial="other"), 3002.0),
        (replace(WHOLE_KEY, serial=None), 3002.0),
        (replace(WHOLE_KEY, serial=None, firmware="01.08.99"), 3003.0),
        (replace(WHOLE_KEY, serial=None, firmware="Adobe Lightroom 7.3"), 3003.0),
        (replace(WHOLE_KEY, serial=None, firmware=None, lens=None), 3004.0),
        (replace(WHOLE_KEY, serial=None, firmware=None, lens=None, focal_mm=24.0), 3005.0),
        (CameraKey(make="dji ", model="fc6310r\0", image_size=SIZE, focal_mm=24.0), 3006.0),
        (replace(WHOLE_KEY, model="FC6310S"), None),
        (replace(WHOLE_KEY, make=None), None),
        (replace(WHOLE_KEY, capture_mode="dewarped"), None),
    ],
)
def test_what_an_entry_states_must_be_so(key: CameraKey, expected: float | None) -> None:
    assert fx(at_home(*ALL), key) == expected


def test_a_focal_length_that_is_not_known_is_no_proof() -> None:
    assert fx(at_home(FOCAL), replace(KEY, focal_mm=None)) == 3004.0
    assert fx(at_home(FOCAL, MODEL), replace(KEY, focal_mm=None)) == 3006.0
    with pytest.raises(AmbiguousEntryError, match="2 entries match"):
        fx(at_home(FOCAL, an_entry(focal_mm=24.0)), replace(KEY, focal_mm=None))


def test_the_nearest_focal_length_answers_and_a_distant_one_never() -> None:
    zoom = at_home(an_entry(fx=3000.0, focal_mm=24.0), an_entry(fx=3100.0, focal_mm=24.4))
    assert fx(zoom, replace(KEY, focal_mm=24.35)) == 3100.0
    assert fx(zoom, replace(KEY, focal_mm=23.9)) == 3000.0
    assert fx(zoom, replace(KEY, focal_mm=30.0)) is None


def test_two_that_fit_alike_are_an_error_that_names_both() -> None:
    twins = {"cameras/a.yaml": FOCAL, "cameras/b.yaml": an_entry()}
    with pytest.raises(AmbiguousEntryError, match=r"cameras/a\.yaml, cameras/b\.yaml"):
        fx(twins)


def test_two_open_ranges_of_firmware_that_both_hold_are_an_error_that_names_both() -> None:
    since, until = FirmwareRange(min="01.09"), FirmwareRange(max="01.20")
    both = at_home(an_entry(fx=3001.0, firmware=since), an_entry(fx=3002.0, firmware=until))
    assert fx(both, replace(KEY, firmware="01.30")) == 3001.0
    assert fx(both, replace(KEY, firmware="1.8")) == 3002.0
    with pytest.raises(AmbiguousEntryError, match="2 entries match"):
        resolve(both, replace(KEY, firmware="01.10"))


def test_a_firmware_that_cannot_be_compared_leaves_it_to_the_entry_of_all() -> None:
    entries = at_home(an_entry(fx=3001.0, firmware=FirmwareRange(min="01.09")), an_entry(fx=3002.0))
    for odd in ("Adobe Lightroom 12.0", "unknown", "ILCE-7RM4 v1.20"):
        assert fx(entries, replace(KEY, firmware=odd)) == 3002.0


@pytest.mark.parametrize(("seen", "answers"), [(8.97, True), (8.63, True), (8.99, False), (8.61, False)])
def test_a_focal_length_fits_within_two_per_cent_both_ways(seen: float, answers: bool) -> None:
    found = fx(at_home(an_entry(fx=3001.0)), replace(KEY, focal_mm=seen))
    assert (found is not None) == answers


def test_an_alias_of_a_draft_or_a_retired_entry_answers_for_nobody() -> None:
    for status in (Status.DRAFT, Status.RETIRED):
        entry = an_entry(aliases=(Alias(make="Hasselblad", model="L1D"),), status=status)
        index = RegistryIndex([entry.path], lambda _, entry=entry: (entry,))  # type: ignore[misc]  # bound here
        assert index.resolve(replace(KEY, make="Hasselblad", model="L1D")) is None


def test_a_file_under_another_cameras_path_answers_for_neither() -> None:
    entry, other = an_entry(), an_entry(model="FC330")
    files = {other.path: (entry,)}
    index = RegistryIndex(files, files.__getitem__)
    assert index.resolve(KEY) is None
    assert index.resolve(replace(KEY, model="FC330")) is None


@pytest.mark.parametrize(
    ("status", "why"),
    [(Status.DRAFT, "it is only a proposal"), (Status.RETIRED, "it is retired: lens swapped")],
)
def test_drafts_and_retired_entries_answer_only_when_asked_for(status: Status, why: str) -> None:
    entries = at_home(an_entry(status=status, reason="lens swapped"))
    assert fx(entries) is None
    assert fx(entries, statuses=list(Status)) == 3661.25
    [miss] = near(entries, KEY)
    assert miss.reason.startswith(why)


def test_an_entry_is_for_its_days_only() -> None:
    entries = at_home(an_entry(validity=Validity(first=date(2026, 5, 1))))
    assert fx(entries, on=date(2026, 5, 1)) == 3661.25
    assert fx(entries, on=date(2026, 4, 30)) is None
    assert fx(entries) == 3661.25


class TestFrames:
    """Scaling and centred cropping, as for every other source; nothing is stretched."""

    def test_the_same_aspect_is_a_scale(self) -> None:
        quality = Quality(rms_px=0.4, std={"fx": 1.0, "k1": 0.01})
        found = resolve(at_home(an_entry(quality=quality)), replace(KEY, image_size=(2736, 1824)))
        assert found is not None
        K = found.calibration.intrinsics
        assert (K.fx, K.cx, K.cy, K.image_size) == (
            3661.25 / 2,
            (2736 - 4.5) / 2,
            (1824 + 7.25) / 2,
            (2736, 1824),
        )
        assert found.calibration.quality is not None
        assert found.calibration.quality.std == {"fx": 0.5, "k1": 0.01}
        assert found.calibration.provenance.adaptation == "scaled 5472×3648 → 2736×1824"

    @pytest.mark.parametrize(
        ("size", "cx", "cy"), [((4864, 3648), 2731.5 - 304, 1831.25), ((5472, 3078), 2731.5, 1546.25)]
    )
    def test_three_to_two_becomes_four_to_three_and_sixteen_to_nine_by_a_centred_crop(
        self, size: tuple[int, int], cx: float, cy: float
    ) -> None:
        found = resolve(at_home(FOCAL), replace(KEY, image_size=size))
        assert found is not None
        K = found.calibration.intrinsics
        assert (K.fx, K.cx, K.cy, K.image_size) == (3004.0, cx, cy, size)
        assert found.calibration.provenance.assumptions == ("the crop is centred",)

    @pytest.mark.parametrize("size", [(3840, 2160), (6000, 6000)])
    def test_any_other_frame_is_refused_with_the_reason(self, size: tuple[int, int]) -> None:
        key = replace(KEY, image_size=size)
        assert resolve(at_home(FOCAL), key) is None
        assert "register the camera at this size" in near(at_home(FOCAL), key)[0].reason

    def test_the_nearest_frame_answers(self) -> None:
        sizes = at_home(*(an_entry(size=size, fx=size[0] / 2) for size in (SIZE, (2736, 1824), (4864, 3648))))
        for size, expected in (
            (SIZE, 2736.0),
            ((2736, 1824), 1368.0),
            ((1368, 912), 684.0),
            ((4864, 3648), 2432.0),
        ):
            assert fx(sizes, replace(KEY, image_size=size)) == expected
            found = resolve(sizes, replace(KEY, image_size=size))
            assert found is not None
            assert found.entry.calibration.intrinsics.image_size != (1368, 912)

    def test_without_an_image_the_entry_stays_at_its_own_size(self) -> None:
        found = resolve(at_home(FOCAL), replace(KEY, image_size=None))
        assert found is not None
        assert found.calibration.intrinsics.image_size == SIZE


def test_the_answer_tells_where_its_k_is_from_and_what_stands_behind() -> None:
    found = resolve(
        at_home(UNIT, MODEL, an_entry(fx=3000.0, status=Status.DRAFT)), replace(KEY, serial="9f2c")
    )
    assert found is not None
    assert found.path == "cameras/dji/fc6310r/sn-9f2c/5472x3648+f8.8.yaml"
    assert found.why == f"{found.path} is of this unit, 8.8 mm; 1 more match and are less specific"
    assert [miss.reason for miss in found.near] == [
        "it matches, and is less specific: its model only",
        "it is only a proposal, which nothing uses before it is approved",
    ]
    provenance = found.calibration.provenance
    assert (provenance.kind, provenance.source, provenance.tag) == (
        "registry",
        found.path,
        "calibration-file lab.xml",
    )
    assert provenance.sources == (SourceFile(name="lab.xml", sha256=DIGITS),)
    assert provenance.date == "2026-02-03"
    assert found.calibration.camera == replace(KEY, serial="9f2c")


class Files:
    """A registry's files, and which of them were read."""

    def __init__(self, *entries: Entry) -> None:
        self.data = {entry.path: (entry,) for entry in entries}
        self.read: list[str] = []

    def load(self, path: str) -> tuple[Entry, ...]:
        self.read.append(path)
        return self.data[path]

    def index(self, **more: Any) -> RegistryIndex:
        return RegistryIndex(self.data, self.load, **more)


class TestIndex:
    """Only candidates are read."""

    def test_other_models_and_other_units_are_not_read(self) -> None:
        others = [an_entry(model=f"FC{n}") for n in range(50)]
        units = [an_entry(serial=f"{n:04x}") for n in range(50)]
        files = Files(UNIT, MODEL, *others, *units)
        index = files.index()
        key = replace(KEY, serial="9f2c")
        assert [index.resolve(key), index.resolve(key)][1] is not None
        assert sorted(files.read) == sorted([UNIT.path, MODEL.path])

    def test_models_whose_names_begin_alike_are_kept_apart(self) -> None:
        models = [
            an_entry(model=model, fx=3000.0 + n)
            for n, model in enumerate(("M3", "M3T", "M3 T", "M3-T", "M3.T"))
        ]
        index = Files(*models).index()
        for entry in models:
            found = index.resolve(entry.calibration.camera)
            assert found is not None
            assert found.path == entry.path

    def test_another_name_leads_to_the_same_entry(self) -> None:
        files = Files(an_entry(aliases=(Alias(make="Hasselblad", model="L1D-20c"),)), an_entry(model="FC220"))
        key = replace(KEY, make="HASSELBLAD", model="l1d-20C")
        names = {(match_key("Hasselblad"), match_key("L1D-20c")): frozenset({"cameras/dji/fc6310r/"})}
        for aliases in (None, lambda: names):
            files.read.clear()
            found = files.index(aliases=aliases).resolve(key)
            assert found is not None
            assert found.path == an_entry().path
            assert "of which this is an alias" in found.why
            assert (an_entry(model="FC220").path in files.read) is (aliases is None)

    def test_its_own_name_comes_before_anothers(self) -> None:
        files = Files(
            an_entry(aliases=(Alias(make="DJI", model="FC220"),)), an_entry(model="FC220", fx=3000.0)
        )
        found = files.index().resolve(replace(KEY, model="FC220"))
        assert found is not None
        assert found.calibration.intrinsics.fx == 3000.0

    def test_what_is_near_is_told_where_nothing_fits(self) -> None:
        index = Files(FOCAL, an_entry(model="FC220")).index()
        key = replace(KEY, focal_mm=24.0)
        assert index.resolve(key) is None
        assert [(miss.path, miss.reason) for miss in index.near(key)] == [
            (FOCAL.path, "it is of 8.8 mm, not 24 mm")
        ]

    def test_a_camera_without_a_name_has_no_candidates(self) -> None:
        assert Files(FOCAL).index().resolve(CameraKey(image_size=SIZE)) is None
