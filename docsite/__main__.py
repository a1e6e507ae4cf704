"""Write the made pages into docs/, where mkdocs finds them beside the written ones; git ignores them."""

from __future__ import annotations

from pathlib import Path

from docsite import executed, gallery, schemas, studies, warnings
from docsite.made import MADE

DOCS = Path(__file__).resolve().parents[1] / "docs"


def main() -> None:
    """Write every made page and schema, then pages with pictures: gallery, notebooks and warnings."""
    for name, content in MADE.items():
        (DOCS / name).write_text(content(), encoding="utf-8")
    for name, schema in schemas.SCHEMAS.items():
        (DOCS / name).parent.mkdir(exist_ok=True)
        (DOCS / name).write_text(schemas.text(schema()), encoding="utf-8")
    gallery.write(DOCS / "gallery")
    executed.write(DOCS)
    warnings.write(DOCS)
    studies.write(DOCS)


main()
