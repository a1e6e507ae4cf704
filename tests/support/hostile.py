"""Texts that try to leave their place, in every field of a result that others write, for every export and rendering."""

from __future__ import annotations

from dataclasses import replace

from vibrident.result import Result, ResultWarning

ESC, RLO = "\x1b", "\u202e"
#: Each is text and nothing else, whatever it is written to.
STRINGS = (
    "*\\",
    "*/ int stolen; /*",
    "??/\n*/ int stolen; /*??/",
    "*\\\n/ int stolen;",
    "@BODY@ @GUARD@ @MODEL_SOS@",
    '"""\nimport os; os.system("true")\n"""',
    "{0} {name} %s %(x)s %{x} %{customdata}",
    "]]> <!-- --> <![CDATA[ &stolen; &#0; <x a='b'>",
    "<script>alert(1)</script><img src=x onerror=alert(1)>",
    '<a href="javascript:alert(1)">here</a>',
    '#eval("1+1") #{panic()} $x^2$ \\ `code` @label',
    "| a | b | [here](http://stolen.example) ![x](y) **bold** _it_ ~~no~~ www.stolen.example",
    "# heading\n- item\n1. one\n\n---\n```\ncode",
    '=HYPERLINK("http://stolen.example","x")',
    "+1+1|cmd' /C calc'!A0",
    "-2+3",
    "@SUM(1)",
    "\t=1+1",
    "[red]alarm[/red] [link=http://stolen.example]here[/link]",
    f"{ESC}[31mred{ESC}[0m{ESC}]0;title\x07{ESC}]8;;http://stolen.example{ESC}\\x\x9b31m",
    f"{RLO}gnp.exe",
    "nul\x00bell\x07form\x0cvertical\x0bdelete\x7f next\x85 line\u2028 paragraph\u2029",
    "lone \ud800 surrogate, \ufffe and \uffff",
    "../../etc/passwd",
    "..\\..\\windows",
    "CON",
    "NUL.csv",
    "a" * 400,
    "\u212b \u1e9b\u0323 \u0627\u0644 \u632f\u52a8 \U0001f600 zero\u200bwidth",
    "$\\frac{1}{0}$ $$ \\alpha",
    "",
    " ",
)


def with_text(result: Result, text: str, unit: str | None = None) -> Result:
    """The result with this text wherever a file that others wrote may put one.

    Args:
        result: any.
        text: for all texts.
        unit: for units; None: the text too.
    """
    unit = text if unit is None else unit
    sensor = dict.fromkeys(("manufacturer", "type", "serial_number", "remark"), text) | {text or "key": text}
    stated = ("number", "laboratory", "laboratory_address", "accreditation", "customer", "customer_address")
    stated += ("order_number", "place", "condition", "mounting", "direction", "amplitude", "conditioning")
    stated += ("procedure", "traceability", "operator", "approved_by", "further")
    instrument = dict.fromkeys(("name", "manufacturer", "type", "serial_number", "certificate"), text)
    more = {"remarks": [text, text], "instruments": [instrument], "date_of_calibration": "2025-03-31"}
    measured = replace(result.measured, record=(text,) * len(result.measured.frequency_hz))
    return replace(
        result,
        sensor=sensor,
        certificate=dict.fromkeys(stated, text) | more,
        response_unit=unit,
        reference={**result.reference, "unit": unit},
        sensitivity_per={**result.sensitivity_per, "unit": unit},
        parameters={name: replace(p, unit=p.unit.replace("V", unit)) for name, p in result.parameters.items()},
        measured=measured,
        signals=tuple(replace(signal, record=text, unit=unit) for signal in result.signals),
        warnings=(ResultWarning("clipped", text), ResultWarning("lack_of_fit", text)),
        settings={**result.settings, "uncertainty_covers": text, "note": text, "nested": {text or "key": [text]}},
        provenance={**result.provenance, "files": [{"file": text, "sha256": text, "history": [text]}], "by": text},
    )
