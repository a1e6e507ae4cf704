"""A certificate against the schema that the user supplies. Schemas in its folder serve what it imports.

PTB's schemas import by addresses in the web; nothing is fetched from there. W3C's schema of XML signatures comes with
xmlschema where the user has none.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from vibrident.errors import InputError
from vibrident.export.missing import library

_XSD = "{http://www.w3.org/2001/XMLSchema}"
#: xmlschema brings what the W3C defines.
_BROUGHT = "http://www.w3.org/"


def validate(text: bytes, schema: Path) -> None:
    """Validate XML against an XSD; what it imports is taken from the files of the same name around it.

    Raises:
        InputError: the schema cannot be read, or refuses the text; or a library is missing.
    """
    xmlschema = library("xmlschema", "dcc")
    etree = library("lxml.etree", "dcc")
    missing: list[str] = []
    try:
        found, missing = _imports(schema, etree)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an import that is missing and used is an error a moment later
            rules = xmlschema.XMLSchema(str(schema), locations=found, allow="local")
    except (OSError, xmlschema.XMLSchemaException, etree.XMLSyntaxError, SyntaxError) as error:
        absent = " and ".join(missing)
        raise InputError(
            "The schema cannot be used.",
            expected="an XSD, such as PTB's dcc.xsd, with the schemas it imports in the same folder or below",
            found=f"no {absent}" if absent else " ".join(str(error).split())[:300],
            where=str(schema),
            remedy="put that file beside it, or into a folder there, as in its address"
            if absent
            else "give another --schema",
        ) from error
    faults = list(rules.iter_errors(io.BytesIO(text), use_location_hints=False))
    if faults:
        first = faults[0]
        more = f" (the first of {len(faults)} faults)" if len(faults) > 1 else ""
        raise InputError(
            "The schema refuses the certificate.",
            expected=f"a document valid under {schema.name}",
            found=" ".join((first.reason or str(first)).split()) + more,
            where=str(first.path),
            remedy="correct what the calibration file states there, or give the schema of this DCC's version",
        )


def _imports(schema: Path, etree: Any) -> tuple[dict[str, str], list[str]]:
    """Namespace → file, for what a schema imports and what these import; and what has no file."""
    found: dict[str, str] = {}
    missing: dict[str, None] = {}
    seen, todo = {schema}, [schema]
    while todo:
        file = todo.pop()
        for node in etree.parse(str(file)).iter(f"{_XSD}import", f"{_XSD}include"):
            place, name = node.get("schemaLocation", ""), node.get("namespace", "")
            if not place or name in found:
                continue
            local = next((path for path in _places(place, file.parent, schema.parent) if path.is_file()), None)
            if local is None:
                missing.update({} if name.startswith(_BROUGHT) else {f"{place} ({name or 'included'})": None})
                continue
            if name:
                found[name] = str(local)
            if local not in seen:
                seen.add(local)
                todo.append(local)
    return found, list(missing)


def _places(place: str, *folders: Path) -> Iterator[Path]:
    """Where the file of an address may lie: at the address, by ever less of its end, then one folder below."""
    parts = [part for part in urlsplit(place).path.split("/") if part not in ("", ".", "..")]
    for folder in folders:
        if "://" not in place:
            yield folder / place
        yield from (folder.joinpath(*parts[k:]) for k in range(len(parts)))
    for folder in folders:
        yield from sorted(below / parts[-1] for below in folder.iterdir() if parts and below.is_dir())
