"""A certificate against the schema that the user supplies. Schemas beside it serve what it imports."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

from vibrident.errors import InputError
from vibrident.export.missing import library


def validate(text: bytes, schema: Path) -> None:
    """Validate XML against an XSD; what it imports is taken from files of the same name beside it, if there are any.

    Raises:
        InputError: the schema cannot be read, or refuses the text; or a library is missing.
    """
    xmlschema = library("xmlschema", "dcc")
    etree = library("lxml.etree", "dcc")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an import that is missing and used is an error a moment later
            rules = xmlschema.XMLSchema(str(schema), locations=_beside(schema, etree), allow="local")
    except (OSError, xmlschema.XMLSchemaException, etree.XMLSyntaxError, SyntaxError) as error:
        raise InputError(
            "The schema cannot be used.",
            expected="an XSD, such as PTB's dcc.xsd, with the schemas it imports beside it",
            found=" ".join(str(error).split())[:300],
            where=str(schema),
            remedy="put SI_Format.xsd and xmldsig-core-schema.xsd into the schema's folder",
        ) from error
    fault = next(rules.iter_errors(io.BytesIO(text)), None)
    if fault is not None:
        raise InputError(
            "The schema refuses the certificate.",
            expected=f"a document valid under {schema.name}",
            found=" ".join((fault.reason or str(fault)).split()),
            where=str(fault.path),
            remedy="correct what the calibration file states there, or give the schema of this DCC's version",
        )


def _beside(schema: Path, etree: object) -> dict[str, str]:
    """Namespace → file beside the schema, for each of its imports whose file is there."""
    space = "{http://www.w3.org/2001/XMLSchema}import"
    found = {}
    for node in etree.parse(str(schema)).iter(space):  # type: ignore[attr-defined]
        place, name = node.get("schemaLocation", ""), node.get("namespace")
        file = schema.parent / place.rsplit("/", 1)[-1]
        if name and place and file.is_file():
            found[name] = str(file)
    return found
