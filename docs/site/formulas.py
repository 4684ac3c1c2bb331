"""Formulas as MathML, written when the site is built: no script, no font and no network to read them.

A formula that does not convert fails the build. `mathml` mends what browsers do not draw of the converter's
output: they know no ``mathvariant`` but the upright one, and no row inside an operator.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util import logging

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

__all__ = ["FormulaError", "mathml", "setup"]

_SPACE = "{http://www.w3.org/1998/Math/MathML}"
# First letter of the styled alphabets of Unicode: capitals, small letters, digits.
_ALPHABETS = {
    "bold": (0x1D400, 0x1D41A, 0x1D7CE),
    "bold-italic": (0x1D468, 0x1D482, 0x1D7CE),
    "double-struck": (0x1D538, 0x1D552, 0x1D7D8),
    "script": (0x1D49C, 0x1D4B6, None),
    "monospace": (0x1D670, 0x1D68A, 0x1D7F6),
}
# Letters that Unicode had before it had the alphabets.
_EARLIER = {
    "double-struck": {"C": "ℂ", "N": "ℕ", "R": "ℝ", "Z": "ℤ"},
    "script": dict(zip("BEFHILMRego", "ℬℰℱℋℐℒℳℛℯℊℴ", strict=True)),
}
# Functions that the converter does not know.
_FUNCTIONS = re.compile(r"\\(arg|sinc|argmin|argmax)(?![A-Za-z])")
_GREEK = {"bold": (0x1D6A8, 0x1D6C2), "bold-italic": (0x1D71C, 0x1D736)}


class FormulaError(ValueError):
    """A formula that is not converted whole."""


def mathml(latex: str, *, display: bool = False) -> str:
    """A formula in LaTeX as a ``math`` element.

    Raises
    ------
    FormulaError
        Where the converter refuses the formula, or leaves a command of it as text.
    """
    _refuse_what_is_open(latex)
    try:
        known = _FUNCTIONS.sub(r"\\operatorname{\1}", latex)
        root = ET.fromstring(convert(known, display="block" if display else "inline"))
    except Exception as error:  # the converter has errors of many kinds, none of them a base of its own
        raise FormulaError(f"${latex}$: {type(error).__name__} {error}") from error
    for element in root.iter():
        variant = element.get("mathvariant")
        if element.text and element.tag == f"{_SPACE}mtext":
            element.text = element.text.replace("\\_", "_").replace("\\ ", " ")
        if variant and variant != "normal":
            element.text = "".join(_styled(letter, variant) for letter in element.text or "")
            del element.attrib["mathvariant"]
        if element.tag == f"{_SPACE}mo" and len(element):
            element.text = "".join(element.itertext())
            del element[:]
    if left := re.search(r"\\\w*", "".join(root.itertext())):
        raise FormulaError(f"${latex}$: the command {left[0]} is not known to the converter")
    ET.register_namespace("", _SPACE[1:-1])
    return ET.tostring(root, encoding="unicode")


def _refuse_what_is_open(latex: str) -> None:
    """Raise where braces or pairs of commands do not match: the converter would guess an end."""
    bare = re.sub(r"\\[{}\\]", "", latex)
    pairs = (("{", "}"), ("\\left", "\\right"), ("\\begin", "\\end"))
    for first, last in pairs:
        opened, closed = (
            len(re.findall(re.escape(word) + "(?![A-Za-z])" * word.startswith("\\"), bare))
            for word in (first, last)
        )
        if opened != closed:
            raise FormulaError(f"${latex}$: {opened} {first} beside {closed} {last}")


def _styled(letter: str, variant: str) -> str:
    """A letter in a style, by its own code point; what has none stays as it is."""
    if variant not in _ALPHABETS:
        raise FormulaError(f"no letters are known for the style {variant}")
    if letter in _EARLIER.get(variant, {}):
        return _EARLIER[variant][letter]
    capitals, small, digits = _ALPHABETS[variant]
    if "A" <= letter <= "Z":
        return chr(capitals + ord(letter) - ord("A"))
    if "a" <= letter <= "z":
        return chr(small + ord(letter) - ord("a"))
    if digits is not None and letter.isdecimal():
        return chr(digits + int(letter))
    if variant in _GREEK and ("Α" <= letter <= "Ω" or "α" <= letter <= "ω"):
        upper, lower = _GREEK[variant]
        return chr(upper + ord(letter) - ord("Α")) if letter <= "Ω" else chr(lower + ord(letter) - ord("α"))
    return letter


def _converted(node: nodes.math | nodes.math_block, *, display: bool) -> str:
    """The formula of a node; a warning with its place, which fails the build, where it does not convert."""
    try:
        return mathml(node.astext(), display=display)
    except FormulaError as error:
        logging.getLogger(__name__).warning(str(error), location=node)
        return ""


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_converted(node, display=False))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(f'<div class="formula">{_converted(node, display=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer with Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
