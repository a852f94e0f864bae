# SPDX-License-Identifier: LGPL-3.0-or-later
"""Docstrings, written to be read as they stand, as reStructuredText.

In them one pair of backticks is code, a paragraph set off by a blank line and an indent is a
formula, and `|x|`, `a * b` or a trailing underscore mean nothing but themselves.
"""

import re

_BACKTICKS = re.compile(r"(`+)")
_STRONG = re.compile(r"\*\*\S(?:[^*]*\S)?\*\*")
# What may stand before and after code without a separator.
_BEFORE, _AFTER = " \t'\"([{<-/:", " \t'\")]}>-/\\:.,;!?"
_ITEM = re.compile(r"^(?:[-*]|\d+\.)\s+")


def _escaped(text: str) -> str:
    """Prose without markup but bold face."""
    parts, last = [], 0
    for bold in _STRONG.finditer(text):
        parts += [_plain(text[last : bold.start()]), bold.group()]
        last = bold.end()
    return "".join([*parts, _plain(text[last:])])


def _plain(text: str) -> str:
    """Text in which no character is markup."""
    text = re.sub(r"([\\*|])", r"\\\1", text)
    return re.sub(r"(?<=\w)_(?!\w)", r"\\_", text)


def _marked(line: str, in_code: bool) -> tuple[str, bool]:
    """A line of prose with its code in double backticks; code may run on in the next line."""
    text = ""
    for part in _BACKTICKS.split(line):
        if part.startswith("`"):
            in_code = not in_code
            text += r"\ ``" if in_code and text and text[-1] not in _BEFORE else "``"
        elif in_code:
            text += part
        else:
            close = text.endswith("``") and part and part[0] not in _AFTER
            text += (r"\ " if close else "") + _escaped(part)
    return text, in_code


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def as_restructured_text(app, what, name, thing, options, lines: list[str]) -> None:
    """Rewrite the lines of a docstring in place; a listener of autodoc.

    Args:
        what: kind of what is documented.
        lines: of the docstring, without common indent.
    """
    written: list[str] = []
    outer = 0  # indent of the paragraph that a formula follows
    literal = in_code = False
    blank = True
    for line in lines:
        if not line.strip():
            blank, in_code = True, False
            written.append("")
            continue
        indent, text = _indent(line), line.strip()
        if literal and blank and indent <= outer:
            literal = False
        if not literal and blank and indent > outer and written and any(written):
            written += [" " * outer + "::", ""]
            literal = True
        if literal:
            written.append(line)
        else:
            item = _ITEM.match(text)
            mark = item.group() if item else ""
            outer = indent + len(mark)
            prose, in_code = _marked(text[len(mark) :], in_code)
            written.append(" " * indent + mark + prose)
        blank = False
    if what in ("attribute", "data", "property"):
        written.insert(0, "")  # else napoleon takes what stands before a colon for a type
    lines[:] = written
