"""Validation of a certificate against the user's schema, with the schemas in its folder for imports.

PTB's schemas import web addresses; nothing is fetched. Without a local file, W3C's schema of XML signatures is
xmlschema's.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from vibrident.base.errors import InputError
from vibrident.export.form import library

_XSD = "{http://www.w3.org/2001/XMLSchema}"
#: W3C namespaces that xmlschema contains.
_BROUGHT = "http://www.w3.org/"


def validate(text: bytes, schema: Path) -> None:
    """Validate XML against an XSD; imports are files of the same name near it.

    Raises:
        InputError: the schema cannot be read, the text is invalid, or a library is missing.
    """
    xmlschema = library("xmlschema", "dcc")
    etree = library("lxml.etree", "dcc")
    missing: list[str] = []
    try:
        found, missing = _imports(schema, etree)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a missing import that is used is an error below
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
            "The certificate is not valid under the schema.",
            expected=f"a document valid under {schema.name}",
            found=" ".join((first.reason or str(first)).split()) + more,
            where=str(first.path),
            remedy="correct what the calibration file states there, or give the schema of this DCC's version",
        )


def _imports(schema: Path, etree: Any) -> tuple[dict[str, str], list[str]]:
    """Namespace → file of all direct and indirect imports; and imports without a file."""
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
    """Candidate paths for an address: its ever shorter ends, then one folder below."""
    parts = [part for part in urlsplit(place).path.split("/") if part not in ("", ".", "..")]
    for folder in folders:
        if "://" not in place:
            yield folder / place
        yield from (folder.joinpath(*parts[k:]) for k in range(len(parts)))
    for folder in folders:
        yield from sorted(below / parts[-1] for below in folder.iterdir() if parts and below.is_dir())
