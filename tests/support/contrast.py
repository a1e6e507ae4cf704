"""Contrast of all visible text of a page, as WCAG 2.2 computes it (success criterion 1.4.3)."""

from __future__ import annotations

from typing import Any

#: Ratio that text must have, and that large text (24 px, or bold and 18.66 px) must have.
ORDINARY, LARGE = 4.5, 3.0

_TEXTS = """() => {
  const numbers = colour => {
    const found = (colour.match(/[\\d.]+/g) || []).map(Number);
    if (colour.startsWith('color(srgb')) return [255 * found[0], 255 * found[1], 255 * found[2], found[3] ?? 1];
    return [found[0], found[1], found[2], found[3] ?? 1];
  };
  const over = (top, below) => [0, 1, 2].map(i => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const light = colour => {
    const [r, g, b] = colour.slice(0, 3).map(c => c / 255).map(
      c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  // CSS invert(SHARE) hue-rotate(180deg), as Filter Effects 1 defines them
  const turned = (share, colour) => {
    const [r, g, b] = colour.slice(0, 3).map(c => 255 * share + (1 - 2 * share) * c);
    return [[-0.574, 1.43, 0.144], [0.426, 0.43, 0.144], [0.426, 1.43, -0.856]].map(
      row => Math.min(255, Math.max(0, row[0] * r + row[1] * g + row[2] * b)));
  };
  const lineage = element => element ? [...lineage(element.parentElement), element] : [];
  const found = [];
  for (const element of document.body.querySelectorAll('*')) {
    const field = ['INPUT', 'TEXTAREA'].includes(element.tagName) && element.type !== 'file' ? element.value : '';
    const own = [...element.childNodes].filter(n => n.nodeType === 3).map(n => n.data).join('').trim() || field;
    const box = element.getBoundingClientRect(), style = getComputedStyle(element);
    if (!own || box.width < 2 || box.height < 2 || box.right < 0) continue;
    if (!element.checkVisibility({ visibilityProperty: true, opacityProperty: true })) continue;
    if (element.closest('[disabled], .disabled, [aria-disabled=true], [aria-hidden=true] .material-icons')) continue;
    let ground = [255, 255, 255, 1], seen = 1, shown = colour => colour;
    for (const above of lineage(element)) {
      const its = getComputedStyle(above);
      ground = over(numbers(its.backgroundColor), ground);
      seen *= Number(its.opacity);
      const share = its.filter.match(/^invert\\(([\\d.]+)\\) hue-rotate\\(180deg\\)$/)?.[1];
      if (share) shown = colour => turned(Number(share), colour);
    }
    const ink = numbers(element instanceof SVGElement ? style.fill : style.color);
    ink[3] *= seen;
    const [a, b] = [light(shown(over(ink, ground))), light(shown(ground))];
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    found.push({ text: own.slice(0, 60), ratio: (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), large });
  }
  return found;
}"""


def texts(page: Any) -> list[dict[str, Any]]:
    """Every visible text with its contrast."""
    return page.evaluate(_TEXTS)


def too_faint(page: Any) -> list[dict[str, Any]]:
    """Those that are not readable enough."""
    return [text for text in texts(page) if text["ratio"] < (LARGE if text["large"] else ORDINARY)]
