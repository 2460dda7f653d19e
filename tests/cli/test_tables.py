"""Tables are built without rich's Text, and say what rich would have said."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.text import Text

from calibrary.cli import tables
from calibrary.cli.console import folded
from calibrary.cli.tables import Column, fitted
from calibrary.cli.words import printable
from tests.thorough import examples

WORDS = ["fx", "3659.41", "[dim](+0.12)[/]", r"\[left]", "漢字", "x" * 30, "[b]m[/b]", "a\x1b[31m", ""]
CELLS = st.lists(st.sampled_from(WORDS), max_size=6).map(" ".join)


def shown(text: Text) -> tuple[str, list[frozenset[str]]]:
    """A line, and the styles of each of its characters."""
    styles = [{str(text.style)} - {""} for _ in text.plain]
    for start, end, style in text.spans:
        for at in range(start, min(end, len(styles))):
            styles[at].add(str(style))
    return text.plain, [frozenset(one) for one in styles]


@given(CELLS, st.sampled_from(["", "dim"]), st.sampled_from(["", "bold red"]), st.sampled_from([4, 12, 40]))
@settings(max_examples=examples(60))
def test_a_cell_is_text_and_is_wrapped_as_rich_does(words: str, style: str, own: str, width: int) -> None:
    text = Text(printable(words), style=style)
    if own:
        text.stylize(own)
    cell = tables._cell((words, own) if own else words, style)
    assert shown(cell.line()) == shown(text)
    lines = [shown(line.line()) for line in tables._folded(cell, width, indent=2, hang=1)]
    expected = [shown(line) for line in folded(text, width, indent=2, hang=1)]
    assert [plain for plain, _ in lines] == [plain for plain, _ in expected]


@pytest.mark.parametrize("width", [20, 40, 200])
def test_nothing_is_lost_at_any_width_and_each_cell_keeps_its_style(width: int) -> None:
    columns = [
        Column(name="commit"),
        Column(name="fx px", rank=1, right=True),
        Column(name="by", rank=3, style="dim"),
        Column(name="reason", rank=2, wraps=True),
    ]
    lines = fitted(columns, [("abc", ("3659.41", "bold"), "Ada", "flown again after landing")], width)
    styles = {word: {s for s, w in styled(lines) if w == word} for word in ("3659.41", "Ada", "abc")}
    assert styles == {"3659.41": {"bold"}, "Ada": {"dim"}, "abc": set()}
    words = " ".join(line.plain for line in lines).split()
    assert {"abc", "3659.41", "Ada", "flown", "again", "after", "landing"} <= {*words}
    assert max(len(line.plain) for line in lines) <= width


def test_a_sentence_takes_no_more_width_than_it_needs() -> None:
    columns = [Column(name="a", wraps=True), Column(name="b", wraps=True)]
    assert fitted(columns, [("one two", "three")], 80)[-1].plain == "one two  three"


def test_cells_below_a_row_share_a_line_that_they_fill() -> None:
    columns = [Column(name="a"), Column(name="b", rank=1), Column(name="c", rank=2)]
    lines = fitted(columns, [("flown in April", "2.34", "5.67")], len("    b 2.34  c 5.67"))
    assert [line.plain for line in lines] == ["a", "flown in April", "    b 2.34  c 5.67"]


def test_cells_below_a_row_that_do_not_fit_beside_each_other_have_lines_of_their_own() -> None:
    columns = [Column(name="a"), Column(name="b", rank=1), Column(name="c", rank=2)]
    lines = fitted(columns, [("flown in April", "2.34", "5.67")], len("    b 2.34  c 5.67") - 1)
    assert [line.plain for line in lines] == ["a", "flown in April", "    b 2.34", "    c 5.67"]


def test_a_sentence_fills_the_width_that_other_columns_leave() -> None:
    columns = [Column(name="a"), Column(name="b", wraps=True), Column(name="c")]
    lines = fitted(columns, [("one", "two three " * 6, "four")], 40)
    half = "two three two three two three"
    assert [line.plain for line in lines[1:]] == [f"one  {half}  four", f"     {half}"]


def styled(lines: list[Text]) -> set[tuple[str, str]]:
    """Every style with every word it covers."""
    return {
        (str(span.style), word)
        for line in lines
        for span in line.spans
        for word in line.plain[span.start : span.end].split()
    }
