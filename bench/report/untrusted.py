"""Markdown that may be from someone else as HTML without scripts: tags in it are text, and links lead to web pages."""

from __future__ import annotations

import re
from typing import Any
from xml.etree.ElementTree import Element

from markdown import Extension, Markdown
from markdown.treeprocessors import Treeprocessor

_SAFE_LINK = re.compile("https?://|#")


def to_html(source: str) -> str:
    """The Markdown as HTML, with tables that scroll."""
    body = Markdown(extensions=["tables", "sane_lists", "fenced_code", _Untrusted()]).convert(source)
    return body.replace("<table>", '<div class="scroll"><table>').replace("</table>", "</table></div>")


class _Untrusted(Extension):
    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802 (a name of the package)
        md.preprocessors.deregister("html_block")
        md.inlinePatterns.deregister("html")
        md.treeprocessors.register(_SafeLinks(md), "safe_links", 5)  # after "inline", which makes the links


class _SafeLinks(Treeprocessor):
    """Leave the words of pictures and of other links, which could name scripts or load what is not in the page."""

    def run(self, root: Element) -> Any:
        for element in root.iter():
            if element.tag == "img":
                element.text = element.get("alt")
            elif element.tag != "a" or _SAFE_LINK.match(element.get("href", "")):
                continue
            element.tag = "span"
            element.attrib.clear()
