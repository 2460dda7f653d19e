"""Whatever order, parts and repetitions observations are merged in, the same is said of them."""

from __future__ import annotations

import json
import tracemalloc
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.errors import InputError
from calibrary.jobs.extract.report import encode
from calibrary.jobs.extract.run import Judging, judge_images
from calibrary.jobs.images import accumulator as module
from calibrary.jobs.images.accumulator import Accumulator, Flight, IdTable, Names
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.observation import Image, Observation, Seen
from calibrary.jobs.images.reading import Reading
from calibrary.records import replace, to_json
from tests.evidence.scenes import p4_rtk, xmp
from tests.jobs.extract.fleet import KNOWLEDGE
from tests.thorough import examples

BASE = replace(p4_rtk(), serial="5f1d0c7a9be24d3c")
# Two calibrations of one camera, a lost one, another camera, an image of none, and one of another frame.
METADATA = [
    BASE,
    replace(BASE, xmp=xmp("drone-dji", DewarpData="2019-03-05;3659.4,3655.2,-4.5,22.7,-0.268,0.1,0,0,0")),
    replace(BASE, xmp=xmp("drone-dji", DewarpData="2019-03-05;3663.0,3655.2,-4.5,22.7,-0.268,0.1,0,0,0")),
    replace(BASE, xmp=(), software="v2"),
    replace(BASE, make="Example", model="One"),
    replace(BASE, exif_size=(4000, 3000)),
]
SEEN = st.builds(
    Seen,
    metadata=st.sampled_from(METADATA),
    day=st.sampled_from([None, date(2024, 5, 17), date(2025, 5, 17)]),
    is_export=st.just(False),
)


@st.composite
def observations(draw: st.DrawFn) -> list[Observation]:
    """Of few images, so that many come twice: under another name, changed since, or read once and not another time."""
    found = []
    for number, name in draw(
        st.lists(st.tuples(st.integers(0, 12), st.sampled_from("abc")), min_size=1, max_size=30)
    ):
        seen = draw(st.none() | SEEN)
        found.append(
            Observation(
                id=Image(name="", place=f"/images/{number}.jpg").id,
                name=f"{name}/{number}.jpg",
                seen=seen,
                reason="" if seen else draw(st.sampled_from(["cut off", "forbidden"])),
            )
        )
    return found


def taken(observations: list[Observation], *, list_all: bool = True) -> Accumulator:
    found = Accumulator(list_all=list_all)
    for one in observations:
        found.add(one)
    return found


def merged(parts: list[Accumulator], *, list_all: bool = True) -> Accumulator:
    found = Accumulator(list_all=list_all)
    for part in parts:
        found.merge(part)
    return found


def report(images: Accumulator, folder: Path) -> bytes:
    listing = Listing([folder], recursive=False)

    found = judge_images(Reading(images=images), listing, Judging(knowledge=KNOWLEDGE))
    return encode(to_json(found))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("empty")


@settings(max_examples=examples(24), deadline=None)
@given(st.data(), observations(), st.booleans())
def test_every_order_split_and_repetition_gives_the_same_report(
    folder: Path, data: st.DataObject, images: list[Observation], list_all: bool
) -> None:
    shuffled = data.draw(st.permutations([*images, *data.draw(st.lists(st.sampled_from(images)))]))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(shuffled)), max_size=5)))
    parts = [
        taken([*shuffled[begin:end]], list_all=list_all)
        for begin, end in zip([0, *cuts], [*cuts, len(shuffled)], strict=True)
    ]
    again = data.draw(st.lists(st.sampled_from(parts)))
    one, other = taken(images, list_all=list_all), merged([*parts, *again], list_all=list_all)
    assert other.settled() == one.settled()
    assert list(other.settled().seen) == list(one.settled().seen)
    assert other.to_bytes() == one.to_bytes()
    assert report(other, folder) == report(one, folder)


@given(observations())
def test_a_written_part_is_read_again_as_it_was(images: list[Observation]) -> None:
    found = taken(images)
    again = Accumulator.from_bytes(found.to_bytes())
    assert again.settled() == found.settled()
    assert again.to_bytes() == found.to_bytes()


@given(observations(), observations(), observations())
def test_merging_is_associative_however_the_tree_is_built(
    a: list[Observation], b: list[Observation], c: list[Observation]
) -> None:
    left = merged([merged([taken(a), taken(b)]), taken(c)])
    right = merged([taken(a), merged([taken(b), taken(c)])])
    assert left.to_bytes() == right.to_bytes()


def _one(name: str, seen: Seen | None, reason: str = "", place: str = "/p") -> Observation:
    return Observation(id=Image(name=name, place=place).id, name=name, seen=seen, reason=reason)


def test_an_image_that_was_read_once_is_read_whatever_befell_it_elsewhere() -> None:
    good, bad = _one("a.jpg", Seen(metadata=BASE)), _one("a.jpg", None, "503")
    for images in ([good, bad], [bad, good]):
        flight = taken(images).settled()
        assert flight == Flight(seen={Seen(metadata=BASE): Names(("a.jpg",), 1)}, unread=(), unread_count=0)


def test_an_image_under_two_names_has_the_smaller_and_counts_once() -> None:
    what = Seen(metadata=BASE)
    assert taken([_one("b.jpg", what), _one("a.jpg", what)]).settled().seen == {what: Names(("a.jpg",), 1)}
    two = taken([_one("b.jpg", what), _one("a.jpg", what, place="/q")])
    assert two.settled().seen == {what: Names(("a.jpg", "b.jpg"), 2)}


def test_an_image_that_changed_while_it_was_read_is_named_with_what_it_counts_for_alone() -> None:
    one, other = Seen(metadata=METADATA[1]), Seen(metadata=METADATA[2])
    twice = [_one("twice.jpg", what, place="/t") for what in (one, other)]
    seen = taken([*twice, _one("a.jpg", one, place="/a"), _one("b.jpg", other, place="/b")]).settled().seen
    assert sorted(sorted(names.listed) for names in seen.values()) in (
        [["a.jpg"], ["b.jpg", "twice.jpg"]],
        [["a.jpg", "twice.jpg"], ["b.jpg"]],
    )


def test_of_many_images_the_first_names_are_kept_and_all_are_counted() -> None:
    what = Seen(metadata=BASE)
    images = [_one(f"{number:05}.jpg", what, place=f"/{number}") for number in range(40_000)]
    images += [_one(f"x{number:05}.jpg", None, "cut off", place=f"/x{number}") for number in range(5000)]
    found = merged([taken(images[start::7], list_all=False) for start in range(7)], list_all=False)
    flight = found.settled()
    assert flight.seen[what] == Names(tuple(f"{n:05}.jpg" for n in range(module.EXAMPLES)), 40_000)
    assert (len(flight.unread), flight.unread_count) == (module.UNREAD_SHOWN, 5000)
    assert flight.unread[0] == SkippedFile(name="x00000.jpg", reason="cut off")
    assert len(found.to_bytes()) < 17 * len(images) + 100_000


def test_parts_that_keep_names_and_parts_that_do_not_are_not_mixed() -> None:
    with pytest.raises(ValueError, match="keeps the name"):
        Accumulator().merge(Accumulator(list_all=False))


@pytest.mark.parametrize("data", [b"", b"other", b"calibrary images 1\n\x93"])
def test_a_part_that_is_damaged_is_said_to_be(data: bytes) -> None:
    with pytest.raises(InputError, match="worker's result"):
        Accumulator.from_bytes(data)


@pytest.mark.thorough
def test_ten_million_images_fit_into_300_mb() -> None:
    """Of a million what is held is measured, and what it takes at the most to put it in order."""
    what = [Seen(metadata=replace(BASE, software=f"v{number}")) for number in range(20)]
    found = Accumulator(list_all=False)
    random = np.random.default_rng(1)
    numbers = [found._number(seen) for seen in what]
    tracemalloc.start()
    try:
        for _ in range(100):
            part = Accumulator(list_all=False)
            part._ids.merge(rows(random, 10_000, len(numbers)), numbers)
            part._numbers, part._kept = dict(found._numbers), found._kept
            found.merge(part)
        flight = found._ids.counts([*range(len(numbers))])
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert sum(flight[0]) == 1_000_000
    assert held * 10 < 190e6
    # The interpreter with all that extract loads takes some 65 MB.
    assert peak * 10 < 235e6


def rows(random: np.random.Generator, count: int, kinds: int) -> IdTable:
    """A table of so many images that were never seen before."""
    ids = np.frombuffer(random.bytes(12 * count), np.uint8).reshape(count, 12)
    what = random.integers(0, kinds, count).astype("<u4").view(np.uint8).reshape(count, 4)
    return IdTable.from_bytes(np.hstack([ids, what]).tobytes())


def test_a_report_of_many_counts_what_it_does_not_list(folder: Path) -> None:
    what = Seen(metadata=METADATA[1])
    images = [_one(f"{number}.jpg", what, place=f"/{number}") for number in range(100)]
    found = json.loads(report(taken(images, list_all=False), folder))
    [camera] = found["cameras"]
    assert found["images"] == 100
    assert len(camera["images"]) + camera["more_images"] == 100
    assert len(camera["images"]) == module.EXAMPLES
