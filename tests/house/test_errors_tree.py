"""The tree drawn in the docstring of calibrary.errors is the tree of its classes."""

from __future__ import annotations

import inspect
import re

import pytest

from calibrary import errors

BRANCH = re.compile(r"^ {4}(?P<indent>[│ ]*)(?:[├└]── )?(?P<name>[A-Z]\w+)(?: \((?P<also>\w+)\))?(?: .*)?$")

CLASSES = {
    name: item
    for name, item in inspect.getmembers(errors, inspect.isclass)
    if item.__module__ == errors.__name__ and not getattr(item, "_is_protocol", False)
}


def drawn() -> dict[str, tuple[str, ...]]:
    """The bases of each class as the docstring draws them."""
    text = (errors.__doc__ or "").partition("::\n\n")[2].partition("\n\n")[0]
    tree: dict[str, tuple[str, ...]] = {}
    ancestors: list[str] = []
    for line in text.splitlines():
        match = BRANCH.match(line)
        assert match, f"not a branch of the tree: {line!r}"
        depth = len(match["indent"]) // 4 + ("── " in line)
        ancestors[depth:] = [match["name"]]
        bases = [ancestors[depth - 1] if depth else "Exception", match["also"]]
        tree[match["name"]] = tuple(base for base in bases if base)
    return tree


def test_the_drawn_tree_is_the_tree_of_the_classes() -> None:
    assert drawn() == {
        name: tuple(base.__name__ for base in item.__bases__) for name, item in CLASSES.items()
    }


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_every_error_descends_from_the_one_root(name: str) -> None:
    assert issubclass(CLASSES[name], errors.CalibraryError)


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_every_error_says_what_it_means(name: str) -> None:
    assert (inspect.getdoc(CLASSES[name]) or "").splitlines()[0].endswith(".")
