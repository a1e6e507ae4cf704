"""Links of the written pages: they work on GitHub, and stay within the site where it is built.

Made pages and copies of the studies are no files of the repository. So a written page names a made
page without a link, ``*the commands*<!-- commands.md -->``, and a study by its file. While mkdocs
builds the site, both become links to pages of it, which mkdocs checks.
"""

from __future__ import annotations

import posixpath
import re
from typing import Any

MADE_LINK = re.compile(r"\*([^*]+)\*<!-- (\S+) -->")
_STUDY_LINK = re.compile(r"\]\((?:\.\./)+(studies/[a-z-]+\.md)")


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page's Markdown with its links turned to where they lead on the site."""
    return linked(markdown, posixpath.dirname(page.file.src_uri))


def linked(markdown: str, folder: str) -> str:
    """Return Markdown with links to made pages and to the site's copies of studies.

    Args:
        markdown: text of a page.
        folder: of the page, relative to that of all pages; empty for the top.
    """

    def path(target: str) -> str:
        return posixpath.relpath(target, folder or ".")

    with_pages = MADE_LINK.sub(lambda match: f"[{match[1]}]({path(match[2])})", markdown)
    return _STUDY_LINK.sub(lambda match: f"]({path(match[1])}", with_pages)
