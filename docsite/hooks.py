"""Links of the written pages: they lead somewhere on GitHub, and stay within the site where it is built.

A written page names a made page by the address of the site, and a study by its file. While mkdocs builds the site, the
first becomes a link to the page, which mkdocs checks, and the second the address of the file in the repository.
"""

from __future__ import annotations

import posixpath
import re
from typing import Any

_STUDY = re.compile(r"\]\((?:\.\./)+(studies/[a-z-]+\.md)")


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """Return a page's Markdown with its links turned to where they lead from the site."""
    folder = posixpath.dirname(page.file.src_uri)
    return turned(markdown, folder, str(config.site_url), str(config.extra["repository"]))


def turned(markdown: str, folder: str, site: str, repository: str) -> str:
    """Return Markdown with addresses of the site as relative paths, and paths of studies as addresses.

    Args:
        markdown: text of a page.
        folder: of the page, relative to that of all pages; empty for the top.
        site: address of the site, with a stroke at its end.
        repository: address of the repository, without one.
    """

    def page(match: re.Match[str]) -> str:
        return f"]({posixpath.relpath(f'{match[1]}.md', folder or '.')}"

    within = re.sub(rf"\]\({re.escape(site)}([a-z_/-]+)\.html", page, markdown)
    return _STUDY.sub(rf"]({repository}/blob/main/\1", within)
