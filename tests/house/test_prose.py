"""Nothing decides by reading a sentence: what was found is a value of its own, and words may change."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.house.project import CORE, ROOT, files_of

SENTENCES = frozenset({"message", "remedy", "why", "next", "advice", "sentence"})
NAMED = re.compile(rf"\.({'|'.join(SENTENCES)})\b")
READS = frozenset(
    {"startswith", "endswith", "partition", "rpartition", "split", "removeprefix", "removesuffix", "replace"}
)
NO_SENTENCE = frozenset(
    # The message of a commit is text of a user: git's stream cannot hold a NUL.
    {("registry/git/writing.py", "step.message.replace('\\x00', '')")}
)


def is_sentence(node: ast.expr) -> bool:
    """Whether it is a sentence for a reader, or made of one."""
    return any(isinstance(one, ast.Attribute) and one.attr in SENTENCES for one in ast.walk(node))


def readings(tree: ast.Module) -> Iterator[ast.expr]:
    """The expressions of a module that read a sentence."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in READS and is_sentence(node.func.value):
                yield node
        elif isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            for operator, left, right in zip(node.ops, sides, sides[1:], strict=False):
                held = isinstance(operator, ast.In | ast.NotIn) and is_sentence(right)
                equal = isinstance(operator, ast.Eq | ast.NotEq) and any(
                    isinstance(one, ast.Attribute) and one.attr in SENTENCES for one in (left, right)
                )
                if held or equal:
                    yield node


def test_nothing_decides_by_a_sentence() -> None:
    found = {
        (path.relative_to(ROOT).as_posix(), ast.unparse(node))
        for folder in (CORE, *(ROOT / room for room in ("registry", "calib", "parsers")))
        for path in files_of(folder)
        if path.suffix == ".py" and NAMED.search(text := path.read_text(encoding="utf-8"))
        for node in readings(ast.parse(text))
    }
    assert found == NO_SENTENCE


def test_a_decision_is_found_however_it_is_written() -> None:
    decisions = (
        "error.message.partition('; give')",
        "one.remedy.startswith('register')",
        "'--size' in error.message",
        "found.why == 'no valid K'",
    )
    for decision in decisions:
        assert [ast.unparse(node) for node in readings(ast.parse(decision))] == [decision]
