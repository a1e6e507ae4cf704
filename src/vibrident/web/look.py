"""Colours, type and widths of the page: readable contrast, one column on a phone, a visible focus.

Quasar's own important rules stand in layers, and of these the first wins: the outline of the focus is in it.
Quasar uses short class names (``row``, ``column``) and ``main`` itself; they are avoided here.
"""

from __future__ import annotations

from pathlib import Path

SCRIPT = (Path(__file__).parent / "page.js").read_text(encoding="utf-8")

STYLE = """
@layer theme { :focus-visible:not(h2) { outline: 3px solid #d55e00 !important; outline-offset: 2px; } }
body { background: #f3f5f7; color: #1a1a1a; font-family: system-ui, sans-serif; }
.nicegui-content { padding: 0 !important; gap: 0 !important; max-width: none !important;
  align-items: stretch !important; }
.skip { position: absolute; left: -999px; } .skip:focus { left: 8px;
  top: 8px; background: #fff; padding: 8px; z-index: 9; }
.top { background: #0a4b78; color: #fff; padding: 14px max(16px, calc(50vw - 560px)); width: 100%; }
.top h1 { font-size: 1.5rem; line-height: 1.2; font-weight: 700; margin: 0; } .top p { margin: 0; opacity: .95; }
.steps { width: 100%; max-width: 1152px; margin: 0 auto; padding: 16px;
  display: flex; flex-direction: column; gap: 16px; }
.step { background: #fff; border: 1px solid #cfd6dc; border-radius: 8px;
  padding: 16px 20px; width: 100%; min-width: 0; }
.step h2 { font-size: 1.2rem; line-height: 1.4; font-weight: 650; margin: 0 0 10px; }
.step h2 span { display: inline-grid; place-items: center; width: 1.7em; height: 1.7em; border-radius: 50%;
  background: #0a4b78; color: #fff; font-size: .85em; margin-right: .6em; }
.step h3 { font-size: 1rem; line-height: 1.4; font-weight: 650; margin: 14px 0 4px; }
.actions { display: flex; flex-wrap: wrap; gap: 12px; align-items: center; margin: 8px 0; }
.fields { display: grid; grid-template-columns: repeat(auto-fill, minmax(210px, 1fr)); gap: 10px 16px; margin: 8px 0; }
.fields.wide { grid-template-columns: repeat(auto-fill, minmax(min(280px, 100%), 1fr)); }
.fields > * { min-width: 0; }
.hint { color: #44505a; font-size: .92rem; margin: 4px 0; }
.error { border-left: 5px solid #a1001a; background: #fdeff0; padding: 10px 14px;
  margin: 10px 0; overflow-wrap: anywhere; }
.error .problem { font-weight: 650; white-space: pre-wrap; }
.error p { margin: 2px 0; } .error p div { display: inline; }
.error .label { color: #5c0010; font-weight: 600; }
.verdict { border-left: 5px solid #14632f; background: #eef7f0; padding: 8px 14px; }
.doubt, .warning { border-left: 5px solid #b06a00; background: #fff6e5; padding: 8px 14px; margin: 8px 0; }
.warning h3 { margin-top: 0; } .warning p { margin: 4px 0; }
.scroll { overflow-x: auto; max-width: 100%; background: /* a shadow where a table goes on beyond the edge */
  linear-gradient(90deg, #fff 30%, #fff0) 0 0 / 36px 100% no-repeat local,
  linear-gradient(270deg, #fff 30%, #fff0) 100% 0 / 36px 100% no-repeat local,
  linear-gradient(90deg, #0004, #0000) 0 0 / 12px 100% no-repeat scroll,
  linear-gradient(270deg, #0004, #0000) 100% 0 / 12px 100% no-repeat scroll; }
table { border-collapse: collapse; font-size: .92rem; margin: 8px 0; } th, td { padding: 4px 10px; text-align: left;
  border-bottom: 1px solid #dde2e6; white-space: nowrap; } th { border-bottom: 2px solid #44505a; }
td.n, th.n, .right { text-align: right; font-variant-numeric: tabular-nums; }
pre { background: #f3f5f7; padding: 10px; overflow-x: auto; font-size: .85rem; margin: 6px 0; }
.code { position: relative; background: #f3f5f7; margin: 6px 0; }
.code .plain { font: .85rem/1.45 ui-monospace, monospace; white-space: pre-wrap; overflow-wrap: anywhere;
  padding: 10px 44px 10px 10px; max-height: 26rem; overflow-y: auto; }
.code .copy { position: absolute; top: 4px; right: 4px; color: #44505a !important; }
.named { display: flex; flex-wrap: wrap; gap: 6px; }
.named .file { display: inline-flex; align-items: center; gap: 4px; background: #eaf2f8; border-radius: 14px;
  padding: 1px 4px 1px 12px; font-size: .9rem; max-width: 100%; overflow-wrap: anywhere; }
.named .q-btn { min-height: 0; color: #44505a; }
.step h2:focus { outline: none; }
.q-btn-toggle { display: inline-flex; margin: 4px 0 10px; }
.uploader { width: 100%; margin-top: 10px; max-height: 320px;
  border: 2px dashed #5c7f99 !important; border-radius: 8px; }
.uploader .q-uploader__header { background: #eaf2f8; color: #0a4b78; }
.uploader .q-uploader__title { font-size: 1rem; white-space: normal; }
.uploader .q-uploader__subtitle { display: none; }
.q-chip .q-icon { opacity: 1 !important; color: #44505a; }
.uploader .q-uploader__list { max-height: 140px; min-height: 0; padding: 0 8px; }
.chart { width: 100%; min-width: 0; }
.q-field__label, .q-field__bottom { color: #44505a !important; } .q-btn { text-transform: none; min-height: 40px; }
@media (max-width: 600px) { .steps { padding: 8px; } .step { padding: 12px; border-radius: 4px; } }
"""
