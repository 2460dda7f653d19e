"""Sphinx's settings for the manual: Markdown in, no network, the generated pages written before anything is read."""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import TYPE_CHECKING, Any

DOCS = Path(__file__).parent
# Sphinx runs this file without its folder on the path.
sys.path.insert(0, str(DOCS))

if TYPE_CHECKING:
    from sphinx.application import Sphinx

    from docs.contents import toctrees
    from docs.make_reference import man_pages as manual_pages
    from docs.make_reference import write_pages
else:
    from contents import toctrees
    from make_reference import man_pages as manual_pages
    from make_reference import write_pages

project = "calibrary"
author = "the authors of calibrary"
project_copyright = "the authors of calibrary, Apache-2.0"
release = version = version_of("calibrary")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_static"]
nitpicky = True
# Annotations name types of numpy, msgspec and of modules that the manual does not document; every other kind of
# reference, and every link in a page, has to lead somewhere.
nitpick_ignore_regex = [("py:.*", ".*")]

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 4
highlight_language = "none"

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": False}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# Prose keeps its two hyphens: they are flags.
smartquotes = False

html_theme = "furo"
html_title = f"calibrary {version}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_js_files = ["filter.js"]
html_search_scorer = str(DOCS / "_static" / "scorer.js")
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False

man_pages = manual_pages(author)
man_make_section_directory = False


def _generate(_app: Sphinx) -> None:
    write_pages(DOCS)


def _place(_app: Sphinx, page: str, source: list[str]) -> None:
    """The pages of an index are those that it links to."""
    source[0] += toctrees(DOCS).get(page, "")


def _keep_bars(
    _app: Sphinx, _what: str, _name: str, _value: object, _options: object, lines: list[str]
) -> None:
    """Of |fx − fy| reStructuredText would look for a substitution."""
    lines[:] = [line.replace("|", r"\|") if line.count("|") > 1 else line for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the generated pages when a build begins."""
    app.connect("builder-inited", _generate)
    app.connect("source-read", _place)
    app.connect("autodoc-process-docstring", _keep_bars)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
