"""Comments and the order of fields that a person put into an entry's file, over what changes the entry."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry
from calibrary.registry.entry_yaml import (
    LARGEST_ENTRY,
    LEGEND,
    comments_in,
    entry_yaml,
    lost_comments,
    parse_entry,
)
from tests.registry.entries import a_content, entries
from tests.thorough import examples

ONE = a_content(label="Hugo", tags=("a", "b"))


def by_hand(entry: Entry, *edits: tuple[str, str]) -> bytes:
    """An entry's file with places edited by a person."""
    text = entry_yaml(entry).decode()
    for before, after in edits:
        assert text.count(before) == 1
        text = text.replace(before, after)
    assert parse_entry(text.encode(), "x") == entry.as_draft
    return text.encode()


def lines_of(data: bytes) -> list[str]:
    return data.decode().removeprefix(LEGEND).splitlines()


@settings(max_examples=examples(8, 1200))
@given(entries(), entries(), st.randoms(use_true_random=False))
def test_what_is_read_is_what_was_asked_for_and_every_comment_is_there_or_its_loss_is_said(
    before: Entry, after: Entry, chance: random.Random
) -> None:
    lines, said = entry_yaml(before).decode().splitlines(), []
    for number in chance.sample(range(len(lines)), min(8, len(lines))):
        said.append(f'# {number} said: ["it\'s", {{#}}')
        lines[number] = chance.choice([f"{lines[number]} {said[-1]}", f"  {said[-1]}\n\n{lines[number]}"])
    former = "\n".join([*lines, ""]).encode()
    assert parse_entry(former, "x") == before
    data = entry_yaml(after, [former])
    assert parse_entry(data, "x") == after
    # What is added to the legend's own lines is a comment as a whole.
    is_there = all(any(one in found for found in comments_in(data)) for one in said)
    assert is_there == (lost_comments(data, after, [former]) is None)
    assert entry_yaml(after, [data]) == data


@settings(max_examples=examples(5, 600))
@given(entries(), st.randoms(use_true_random=False))
def test_fields_stay_in_the_order_that_a_person_gave_them(entry: Entry, chance: random.Random) -> None:
    text = entry_yaml(entry).decode().removeprefix(LEGEND).replace("\n ", "\0 ")
    blocks = text.replace("\n]", "\0]").splitlines(keepends=True)
    chance.shuffle(blocks)
    former = "".join(blocks).replace("\0", "\n").encode()
    after = replace(entry, tolerance=0.0123)
    data = entry_yaml(after, [former])
    assert parse_entry(data, "x") == after
    names = [line.partition(":")[0] for line in lines_of(data) if line[:1] not in " ]#"]
    wanted = [block.partition(":")[0] for block in blocks]
    assert [name for name in names if name in wanted] == wanted


def test_a_comment_stays_at_its_field_and_goes_to_the_next_one_without_it() -> None:
    former = by_hand(
        ONE,
        ('label: "Hugo"\n', '# painted red\nlabel: "Hugo"  # since May\n'),
        ("  fx:", "  # twice\n  fx:"),
        ('["a", "b"]', "# for searching\n  - a # first\n  - b\n# seen\n"),
    )
    kept = lines_of(entry_yaml(replace(ONE, calibration=a_content(fx=3700.5).calibration), [former]))
    assert kept[kept.index("  # twice") + 1] == "  fx: 3700.5"
    assert kept[kept.index("# painted red") + 1] == 'label: "Hugo"  # since May'
    gone = lines_of(entry_yaml(replace(ONE, label=None, tags=("a", "b", "c")), [former]))
    at = gone.index("# painted red")
    assert gone[at + 1] == "# since May"
    assert 'tags: ["a", "b", "c"]  # for searching' in gone
    assert {"# first", "# seen"} <= {*gone}


def test_a_comment_goes_with_its_item_of_a_list_which_is_said_and_stays_with_one_that_moves() -> None:
    named = tuple(Alias(make="Example", model=f"M{number}") for number in (1, 2, 3))
    two = replace(ONE, aliases=named)
    former = by_hand(
        two, ('model: "M1"', 'model: "M1"  # the first'), ('model: "M3"', 'model: "M3"  # the last')
    )
    less = replace(ONE, aliases=named[1:])
    data = entry_yaml(less, [former])
    assert 'model: "M3"  # the last' in data.decode()
    assert "# the first" not in data.decode()
    assert (
        lost_comments(data, less, [former])
        == "what is taken out of its file takes the comment # the first with it"
    )
    assert lost_comments(entry_yaml(two, [former]), two, [former]) is None


def test_what_turns_the_direction_of_a_comment_is_written_as_its_escape_and_nothing_else() -> None:
    # The blanks of French and Japanese, and what stands between letters of Persian, are no less a person's text.
    former = by_hand(ONE, ("grade:", "# 5.2\u202e\u00a0mm\tlens é\u3000レンズ می\u200cشود\ngrade:"))
    data = entry_yaml(replace(ONE, tags=("c",)), [former])
    assert "# 5.2\\u202e\u00a0mm\tlens é\u3000レンズ می\u200cشود\n" in data.decode()
    assert comments_in(former) == comments_in(data)


def test_a_file_without_comments_is_written_as_always() -> None:
    assert entry_yaml(ONE, [entry_yaml(a_content(fx=3700.5))]) == entry_yaml(ONE)


def test_a_file_that_comments_make_too_large_has_none() -> None:
    former = by_hand(ONE, ("camera:", f"# {'x' * (LARGEST_ENTRY - 1500)}\ncamera:"))
    after = replace(ONE, tags=tuple(f"tag-{number}" for number in range(300)))
    assert entry_yaml(after, [former]) == entry_yaml(after)
    said = lost_comments(entry_yaml(after), after, [former])
    assert said is not None
    assert said.endswith("with them it would be larger than 256 KiB")


@pytest.mark.parametrize("text", [b"# one\nnot: [yaml # two", b"\xff # one\n# two"])
def test_comments_of_what_is_no_yaml_are_known_too(text: bytes) -> None:
    assert {"# one", "# two"} <= comments_in(text)
    assert entry_yaml(ONE, [text]) == entry_yaml(ONE)
