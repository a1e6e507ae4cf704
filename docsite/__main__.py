"""Write the made pages into docs/, where mkdocs finds them; git ignores them.

``python -m docsite NAME…`` runs the tutorials of these names alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

from docsite import executed, gallery, schemas, studies, walkthrough, warnings
from docsite.made import PAGE_MAKERS

DOCS = Path(__file__).resolve().parents[1] / "docs"


def main() -> None:
    """Write made pages and schemas, then pages with pictures: gallery, tutorials, warnings."""
    if names := sys.argv[1:]:
        executed.write(DOCS, names)
        return
    for name, content in PAGE_MAKERS.items():
        (DOCS / name).write_text(content(), encoding="utf-8")
    for name, schema in schemas.SCHEMAS.items():
        (DOCS / name).parent.mkdir(exist_ok=True)
        (DOCS / name).write_text(schemas.text(schema()), encoding="utf-8")
    gallery.write(DOCS / "gallery")
    walkthrough.write(DOCS)
    executed.write(DOCS)
    warnings.write(DOCS)
    studies.write(DOCS)


main()
