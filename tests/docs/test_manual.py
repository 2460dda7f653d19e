"""The manual is whole: every page has its place, every link leads somewhere, every rule and command is described."""

from __future__ import annotations

import ast
import itertools
import re
import runpy
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from calibrary.cli.main import build_parser, leaves
from calibrary.policy import FLEET
from calibrary.records import fields_json
from tests.house.project import ROOT

DOCS = ROOT / "docs"
MADE = re.findall(r"(?m)^docs/(reference/\S+)$", (ROOT / ".gitignore").read_text(encoding="utf-8"))
PAGES = sorted(
    path
    for path in DOCS.rglob("*.md")
    if not any(path.relative_to(DOCS).as_posix().startswith(name) for name in MADE)
)
PAPERS = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "DESIGN.md")]
RULES_IN = (
    "src/calibrary/validation.py",
    "registry/checks.py",
    "registry/entry_checks.py",
    "calib/verdict_rules.py",
    "calib/rig/verdict.py",
)


@cache
def made() -> dict[str, str]:
    pages: dict[str, str] = runpy.run_path(str(DOCS / "make_reference.py"))["documents"]()
    return pages


def text_of(path: Path) -> str:
    """A page, whether it is in git or made from the code."""
    name = path.relative_to(ROOT / "docs").as_posix() if path.is_relative_to(DOCS) else ""
    return made()[name] if name in made() else path.read_text(encoding="utf-8")


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them, and those it names itself."""
    text = re.sub(r"(?ms)^```.*?^```$", "", text)
    found: dict[str, int] = {}
    names = set(re.findall(r"(?m)^\(([\w-]+)\)=$", text))
    for heading in re.findall(r"(?m)^#+ (.+)$", text):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("\\", "").lower()
        slug = re.sub(r"[^\w\- ]", "", plain).strip().replace(" ", "-")
        names.add(f"{slug}-{found[slug]}" if slug in found else slug)
        found[slug] = found.get(slug, 0) + 1
    return names


def links(path: Path) -> Iterator[tuple[str, str]]:
    """The file and the anchor of each link within the repository."""
    text = re.sub(r"(?ms)^```.*?^```$", "", text_of(path))
    for target in re.findall(r"\]\(<?([^)\s>]+)>?\)", re.sub(r"``[^`]*``|`[^`\n]*`", "`", text)):
        if "://" not in target and not target.startswith("mailto:"):
            file, _, anchor = target.partition("#")
            yield file, anchor


@pytest.mark.parametrize("page", [*PAPERS, *PAGES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    broken = []
    for file, anchor in links(page):
        target = (page.parent / file).resolve() if file else page
        name = target.relative_to(DOCS).as_posix() if target.is_relative_to(DOCS) else ""
        there = target.exists() or name in made()
        if not there or (anchor and anchor not in anchors(text_of(target))):
            broken.append(f"{file}#{anchor}")
    assert broken == []


@pytest.mark.parametrize("page", [*PAPERS, *PAGES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_page_is_whole_on_a_code_host(page: Path) -> None:
    """Nothing that only a build makes of a page, and no link to a page that only a build makes."""
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"(?m)^```\{toctree\}", text) == []
    assert re.findall(r"\{[a-z]+\}`", re.sub(r"(?ms)^```.*?^```$", "", text)) == []
    from_the_code = {DOCS / name for name in made()}
    assert [file for file, _ in links(page) if (page.parent / file).resolve() in from_the_code] == []


def test_links_are_found() -> None:
    assert sum(len([*links(page)]) for page in PAGES) > 40


def test_every_page_has_its_place_in_the_manual() -> None:
    appended = runpy.run_path(str(DOCS / "contents.py"))["toctrees"](DOCS)
    listed = {DOCS / "index.md"}
    for page in [*PAGES, *(DOCS / name for name in made())]:
        text = text_of(page) + appended.get(page.relative_to(DOCS).with_suffix("").as_posix(), "")
        for block in re.findall(r"(?ms)^```\{toctree\}\n(.*?)^```$", text):
            entries = [line for line in block.splitlines() if line and not line.startswith(":")]
            listed |= {
                (DOCS / f"{entry[1:]}.md" if entry[0] == "/" else page.parent / f"{entry}.md").resolve()
                for entry in entries
            }
    orphans = {DOCS / name for name, text in made().items() if text.startswith("---\norphan: true")}
    every = {*PAGES, *(DOCS / name for name in made())}
    assert every - listed - orphans == set()
    assert listed - every == set()


def test_every_command_has_a_page_with_its_flags() -> None:
    for leaf in leaves(build_parser()):
        text = made()[f"reference/commands/{leaf.prog.replace(' ', '-')}.md"]
        for action in leaf._actions:
            assert all(f"{flag}" in text for flag in action.option_strings)


def test_every_limit_of_a_policy_is_described() -> None:
    page = made()["reference/policies.md"]
    rows = dict(re.findall(r"(?m)^\| `(\w+)` \|.*\| ([^|]*) \|$", page.replace(r"\|", "")))
    assert set(rows) == set(fields_json(FLEET)) - {"name", "schema"}
    assert [limit for limit, said in rows.items() if len(said) <= 10] == []


def rules(path: Path) -> set[str]:
    """The names of the rules that a module or package reports: keywords, and the words its helpers are called with."""
    found = set()
    files = sorted(path.glob("*.py")) if path.is_dir() else [path]
    for node in itertools.chain.from_iterable(ast.walk(ast.parse(file.read_text("utf-8"))) for file in files):
        if isinstance(node, ast.Call):
            named = [k.value for k in node.keywords if k.arg == "rule"]
            name = getattr(node.func, "id", "")
            given = node.args[:2] if name.startswith("_") or name == "finding_of" else []
            found |= {
                a.value for a in (*named, *given) if isinstance(a, ast.Constant) and isinstance(a.value, str)
            }
    return {rule for rule in found if re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", rule)}


@pytest.mark.parametrize("module", RULES_IN)
def test_every_rule_is_on_the_page_of_rules(module: str) -> None:
    named = set(re.findall(r"`([a-z0-9-]+)`", (DOCS / "reference/rules.md").read_text(encoding="utf-8")))
    reported = rules(ROOT / module)
    assert reported
    assert reported - named == set()
