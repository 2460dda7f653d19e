"""The document of the distortion models, in Markdown from their docstrings."""

from __future__ import annotations

from calibrary.distortion import MODELS
from calibrary.distortion.described import document, marked_down


def test_every_model_has_a_section_with_its_parameters_in_order() -> None:
    text = document("Written by a test.")
    assert text.startswith("# Distortion models\n\nWritten by a test.\n\n")
    for name, kind in MODELS.items():
        section = text.partition(f"## {name}\n")[2].partition("\n## ")[0]
        assert ", ".join(f"`{one}`" for one in kind.names()) in section


def test_a_literal_block_is_a_fence_and_what_follows_is_text_again() -> None:
    assert marked_down("See::\n\n    a = b\n\n    c = d\n\nand ``k1`` of :class:`~x.y.Lens`.") == (
        "See:\n\n```text\n    a = b\n\n    c = d\n```\n\nand `k1` of `Lens`."
    )


def test_a_literal_block_at_the_end_is_closed() -> None:
    assert marked_down("See::\n\n    a = b\n") == "See:\n\n```text\n    a = b\n```"
