"""Pages as files: one that needs nothing beside it, and in which no text is more than text."""

from __future__ import annotations

import base64
import hashlib
import re
import textwrap
from html.parser import HTMLParser
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary import pages
from calibrary.errors import InputError
from calibrary.pages import render_page
from calibrary.pages.wording import LONGEST, sentence, visible
from calibrary.view import (
    Badge,
    Block,
    Code,
    Column,
    Figure,
    KeyValues,
    Link,
    Note,
    Section,
    SideBySide,
    Table,
    View,
)
from tests.pages.gallery import HOSTILE, gallery, plots

VOID = {"meta", "link", "img", "br", "circle", "path", "rect", "image", "use", "line"}
SQUARE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><rect width="9" height="9"/></svg>'


class Outline(HTMLParser):
    """What a browser's parser sees: elements with their attributes, and whether each is closed."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.misnested: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.misnested.append(tag)

    def all(self, *tags: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.elements if tag in tags]


def page(*blocks: Block, title: str = "A page") -> str:
    section = Section(title="A section", blocks=blocks)
    return render_page(View(title=title, lead="What it comes to.", sections=(section,), made_by="A test."))


def body(html: str) -> str:
    return html.partition("<body>")[2]


@pytest.fixture(scope="module")
def everything() -> str:
    return render_page(gallery())


@pytest.fixture(scope="module")
def outline(everything: str) -> Outline:
    return Outline(everything)


class TestOneFile:
    def test_it_names_no_address_in_the_network(self, everything: str) -> None:
        assert re.findall(r"(?:https?|ftp|wss?):", everything.replace("http://www.w3.org/2000/svg", "")) == []
        assert (
            re.findall(r"url\((?!#plot-)|@import|srcset|<link (?!rel=\"icon\" href=\"data:,\")", everything)
            == []
        )

    def test_its_policy_allows_its_own_style_sheet_and_pictures_and_nothing_else(
        self, everything: str
    ) -> None:
        style = re.findall(r"(?s)<style>(.*?)</style>", everything)
        assert len(style) == 1
        digest = base64.b64encode(hashlib.sha256(style[0].encode()).digest()).decode()
        [policy] = re.findall(r'Content-Security-Policy" content="([^"]*)"', everything)
        assert policy.replace("&#39;", "'") == (
            f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; form-action 'none'"
        )

    def test_it_needs_no_script_and_no_style_of_an_element_which_that_policy_forbids(
        self, outline: Outline
    ) -> None:
        assert outline.all("script", "iframe", "object", "embed", "foreignobject", "base", "form") == []
        names = {name for _, attributes in outline.elements for name in attributes}
        assert [name for name in names if name == "style" or name.startswith("on")] == []

    def test_the_same_page_is_the_same_bytes(self, everything: str) -> None:
        assert render_page(gallery()) == everything

    def test_every_element_is_closed_where_it_was_opened(self, outline: Outline) -> None:
        assert outline.misnested == []
        assert outline.open == []

    def test_every_name_in_it_is_given_once_and_every_reference_is_to_one(self, outline: Outline) -> None:
        names = [attributes["id"] for _, attributes in outline.elements if "id" in attributes]
        assert len(names) == len(set(names))
        wanted: set[str | None] = set()
        for _, attributes in outline.elements:
            for attribute in ("href", "aria-labelledby"):
                value = attributes.get(attribute) or ""
                if attribute == "aria-labelledby" or value.startswith("#"):
                    wanted |= {value.removeprefix("#")} - {""}
        assert wanted <= set(names)


class TestHostileText:
    @pytest.mark.parametrize("text", HOSTILE, ids=lambda text: repr(text[:12]))
    def test_is_inert_wherever_it_stands(self, text: str) -> None:
        table = Table(caption=text, columns=(Column(text),), rows=((text,), (Badge(text),)))
        figure = Figure(svg=SQUARE, alt=text, caption=text)
        words = (text, KeyValues(((text, text),)), Note(text=text, action=text), Code(text=text, label=text))
        html = page(*words, table, SideBySide((figure,)), title=text)
        tags = {tag for tag, _ in Outline(html).elements}
        assert tags & {"script", "img"} == set()
        assert not any(
            name.startswith("on") for _, attributes in Outline(html).elements for name in attributes
        )
        assert Outline(html).misnested == []
        html.encode()

    @given(st.text(max_size=60))
    def test_no_text_changes_what_stands_around_it(self, text: str) -> None:
        plain, changed = (Outline(page(words, Badge(words))).elements for words in ("x", text))
        assert [tag for tag, _ in changed] == [tag for tag, _ in plain]

    def test_of_any_length_leaves_a_page_that_can_be_opened(self) -> None:
        long = "word " * 1_000_000
        table = Table(caption=long, columns=(Column(long),), rows=((long,),))
        assert len(page(long, table, Note(text=long), Code(text=long, label=long), title=long)) < 60_000

    def test_has_its_direction_overrides_and_controls_spelt_out(self) -> None:
        assert visible("gpj.\u202eexe") == "gpj.\\u202eexe"
        assert visible("a\x1b[31mb\x00") == "a\\x1b[31mb\\x00"
        assert visible("a\nb\tc") == "a b c"
        assert visible("byte \udcff") == "byte \\udcff"

    def test_keeps_the_letters_of_every_language(self) -> None:
        assert visible("Größe 焦距 بؤرة é") == "Größe 焦距 بؤرة é"

    def test_does_not_pile_accents_over_the_lines_around_it(self) -> None:
        assert len(visible("e" + "\u0301" * 500)) == 5

    def test_says_how_long_it_was_when_it_is_cut(self) -> None:
        assert visible("x" * 10_000).endswith("x… (10000 characters)")
        assert len(visible("x" * 10_000)) < LONGEST + 30


class TestBlocks:
    def test_headings_go_down_one_level_at_a_time(self, outline: Outline) -> None:
        levels = [int(tag[1]) for tag, _ in outline.elements if re.fullmatch(r"h[1-6]", tag)]
        assert levels[0] == 1
        assert levels.count(1) == 1
        assert all(below - above <= 1 for above, below in pairwise(levels))

    def test_a_badge_says_its_word_and_has_a_shape_of_its_own(self, everything: str) -> None:
        found = re.findall(r'class="badge (\w+)">(<svg.*?</svg>) (\w+)<', everything)
        shapes = {tone: shape for tone, shape, _ in found}
        assert set(shapes) == {"good", "caution", "bad", "neutral"}
        assert len(set(shapes.values())) == 4

    def test_a_plot_is_an_image_with_a_description(self) -> None:
        html = page(Figure(svg=SQUARE, alt="One square.", caption="A square."))
        assert 'role="img" aria-labelledby="plot-1-alt"' in html
        assert '<desc id="plot-1-alt">One square.</desc>' in html
        assert "<figcaption>A square.</figcaption>" in html

    def test_a_row_is_headed_by_its_first_cell(self) -> None:
        html = page(Table(caption="c", columns=(Column("a"), Column("b", numeric=True)), rows=(("x", "1"),)))
        assert '<th scope="col">a</th><th scope="col" class="number">b</th>' in html
        assert '<th scope="row"><bdi>x</bdi></th><td class="number"><bdi>1</bdi></td>' in html

    def test_a_row_of_another_length_is_refused(self) -> None:
        with pytest.raises(InputError, match="has 2 columns and a row of 1 cells"):
            Table(caption="c", columns=(Column("a"), Column("b")), rows=(("x",),))

    @pytest.mark.parametrize(
        "target",
        [
            "https://example.org",
            "javascript:alert(1)",
            " JavaScript:x",
            "//example.org",
            "\\\\host",
            "a\nb",
            "data:x",
        ],
    )
    def test_a_link_leads_nowhere_but_to_what_lies_beside_the_page(self, target: str) -> None:
        with pytest.raises(InputError, match="relative address"):
            Link("here", target)

    @pytest.mark.parametrize("target", ["#camera-1", "cameras/one.html", "../index.html?x=a:b", "K.npy"])
    def test_a_link_to_a_place_or_a_file_beside_the_page_is_kept(self, target: str) -> None:
        assert f'<a href="{target}"><bdi>here</bdi></a>' in page(Link("here", target))

    def test_line_breaks_are_kept_in_code_only(self) -> None:
        assert "<code>one\ntwo</code>" in page(Code(text="one\ntwo", label="x"))
        assert "<p>one two</p>" in page("one\ntwo")

    def test_no_line_ends_within_a_flag_of_a_command(self) -> None:
        html = page(Note(text="x", action="calibrary registry approve (--from <a--b>) --yes"))
        assert '(<span class="whole">--from</span> &lt;a--b&gt;) <span class="whole">--yes</span>' in html

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("few views", "Few views."),
            ("camera: none.", "Camera: none."),
            ("dji-fc330-4000x3000: zoomed", "dji-fc330-4000x3000: zoomed."),
            ("left08.jpg is blurred", "left08.jpg is blurred."),
        ],
    )
    def test_a_sentence_begins_with_a_capital_unless_with_a_name(self, text: str, said: str) -> None:
        assert sentence(text) == said

    @pytest.mark.parametrize(("titles", "stacks"), [((30, 20), True), ((20, 10), False), ((5,) * 13, False)])
    def test_a_phone_lists_the_rows_that_are_too_wide_for_it(
        self, titles: tuple[int, ...], stacks: bool
    ) -> None:
        columns = tuple(Column("x" * length) for length in titles)
        assert Table(caption="c", columns=columns, rows=(("1",) * len(titles),)).stacks is stacks

    def test_a_list_of_parts_stands_above_three_or_more_unless_the_page_has_its_own(self) -> None:
        def listed(count: int, *, contents: bool = True) -> bool:
            sections = tuple(Section(title=f"Part {n}", blocks=("words",)) for n in range(count))
            page = View(title="t", lead="l", sections=sections, made_by="m", contents=contents)
            return "<nav" in render_page(page)

        assert [listed(count) for count in (2, 3, 9)] == [False, True, True]
        assert not listed(9, contents=False)

    def test_equal_sections_have_anchors_of_their_own(self) -> None:
        sections = tuple(Section(title="Part", anchor="part", blocks=("words",)) for _ in range(3))
        html = render_page(View(title="t", lead="l", sections=sections, made_by="m"))
        assert re.findall(r'<h2 id="([^"]+)"', html) == ["part", "section-1", "section-2"]


def test_every_plot_is_small() -> None:
    sizes = {kind: len(page(figure)) - len(page("")) for kind, figure in plots().items()}
    assert {kind: size for kind, size in sizes.items() if size > 60_000} == {}


def test_the_example_in_the_package_is_a_page() -> None:
    example = textwrap.dedent((pages.__doc__ or "").partition("::\n\n")[2])
    scope: dict[str, object] = {"values": [0.2, 0.7], "names": ["a.jpg", "b.jpg"]}
    exec(example, scope)  # noqa: S102  our own docstring
    html = str(scope["html"])
    assert {"h1", "table", "figure", "dl"} <= {tag for tag, _ in Outline(html).elements}
