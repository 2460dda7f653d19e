"""Names of cameras as parts of paths: any text a camera writes, on any file system, and no two by one name.

Two texts are one name when their match keys are equal; their slugs are equal exactly then. A slug that loses
nothing holds ``a-z 0-9 . - _`` only (``_`` is a blank). Whatever cannot be written so, or would mean something
to a file system or to git, ends in ``~`` and ten digits of a hash, and ``~`` is in no other slug.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from functools import lru_cache
from typing import Final

__all__ = ["match_key", "scripts", "slug"]

LONGEST_TEXT: Final = 1000
"""Characters that are looked at; an EXIF string has some tens."""
LONGEST_SLUG: Final = 48
LONGEST_STEM: Final = 32
ROUNDS: Final = 4

_LOSSLESS = re.compile(r"[a-z0-9. -]+")
_DEVICES = r"con|prn|aux|nul|conin\$|conout\$|com[0-9]|lpt[0-9]"
_SPECIAL = re.compile(
    # What Windows, git or a shell take for something else: devices, options, hidden files, git's own names.
    rf"(?:{_DEVICES})(?:[. ].*)?|[-. ].*|.*[. ]|.*\.\..*|\.?git|.*\.(?:lock|yaml)",
    re.DOTALL,
)


@lru_cache(maxsize=1 << 14)
def match_key(text: str) -> str:
    """What of a name counts: letters and digits, not their case, width, padding or invisible company.

    The text is cut at its first NUL; control and format characters (writing direction, zero-width joiners) are
    dropped, blanks are folded, compatibility forms and letter case undone, and × is x, as in "zoom 2×".
    """
    key = text[:LONGEST_TEXT].partition("\0")[0]
    for _ in range(ROUNDS):
        folded = _folded(key)
        if folded == key:
            break
        key = folded
    return key


@lru_cache(maxsize=1 << 14)
def slug(text: str) -> str:
    """A match key as one part of a path: lower-case ASCII, at most 48 characters."""
    key = match_key(text)
    if _LOSSLESS.fullmatch(key) and len(key) <= LONGEST_SLUG and not _SPECIAL.fullmatch(key):
        return key.replace(" ", "_")
    digits = hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    return f"{_stem(key)}~{digits}"


def scripts(text: str) -> frozenset[str]:
    """The scripts of its letters ("LATIN", "CYRILLIC", …); more than one in a name is most likely a mistake."""
    return frozenset(unicodedata.name(c, "UNKNOWN").partition(" ")[0] for c in text if c.isalpha())


def _folded(text: str) -> str:
    kept = "".join(" " if c.isspace() else c for c in text if c.isspace() or not _is_invisible(c))
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", kept).casefold())
    return " ".join(folded.replace("×", "x").split())


def _is_invisible(character: str) -> bool:
    return unicodedata.category(character) in {"Cc", "Cf"}


def _stem(key: str) -> str:
    """What of a key can be shown, for people; the hash behind it tells it from others."""
    shown = re.sub(r"[^a-z0-9. -]", "", key).replace(" ", "_")
    shown = re.sub(r"\.{2,}", ".", shown).lstrip("-._")[:LONGEST_STEM].rstrip("._-")
    if not shown or _SPECIAL.fullmatch(shown.replace("_", " ")):
        return f"x{shown}"
    return shown
