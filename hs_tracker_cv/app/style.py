"""How the page looks, light and dark, wide and narrow; and the keys that must not scroll it."""

from __future__ import annotations

__all__ = ["ACCENT", "CSS", "KEYS", "LET_GO"]

ACCENT = "#1b8fa0"
"""Of filled buttons and sliders, on light and on dark ground."""

CSS = """
:root { --ink: #1c2326; --dim: #64727a; --line: #d5dde1; --plate: #ffffff; --ground: #f1f4f5; --accent: #16808f; }
.body--dark { --ink: #e8ecee; --dim: #93a1a8; --line: #333c42; --plate: #1d2327; --ground: #14181b;
  --accent: #5abed2; }
body { background: var(--ground) !important; color: var(--ink); }
.nicegui-content { padding: 12px; gap: 12px; max-width: 1560px; margin: 0 auto; align-items: stretch; width: 100%; }
.q-page { min-height: 0 !important; }
.hs-grow { flex: 1 1 160px; min-width: 0; }
.hs-header { display: flex; flex-wrap: wrap; align-items: center; gap: 10px; }
.hs-title { font-size: 20px; font-weight: 600; letter-spacing: .01em; }
.hs-main { display: grid; grid-template-columns: minmax(0, 1fr) 330px; gap: 12px; align-items: start; }
.hs-view, .hs-card, .hs-panel { background: var(--plate); border: 1px solid var(--line); border-radius: 8px; }
.hs-view { padding: 10px; display: flex; flex-direction: column; gap: 6px; min-width: 0; }
.hs-frame { width: 100%; max-width: calc((100vh - 330px) * var(--shape, 1.34)); min-width: min(100%, 320px);
  min-height: 120px; margin: 0 auto; background: #101315; border-radius: 4px; overflow: hidden; cursor: crosshair; }
.hs-hint { color: var(--dim); font-size: 13px; min-height: 18px; }
.hs-transport { display: flex; align-items: center; gap: 8px; }
/* A thumb that glides to each frame's place would have the page laid out at every refresh of the screen. */
.hs-transport .q-slider * { transition: none !important; }
.hs-facts { color: var(--dim); font-size: 12px; font-variant-numeric: tabular-nums; }
.hs-strip { display: flex; cursor: pointer; border-top: 1px solid var(--line); min-height: 20px; width: 100%; }
.hs-strip > div { flex: 0 0 104px; font-size: 11px; line-height: 13px; color: var(--dim); cursor: default; }
.hs-strip > div > div { padding-top: 3px; border-bottom: 1px solid var(--line); box-sizing: border-box; }
.hs-strip i { display: block; opacity: .75; font-style: normal; }
.hs-strip svg { flex: 1 1 0; min-width: 0; display: block; border-left: 1px solid var(--line); }
.hs-strip .curve { fill: none; stroke-width: 1.6; vector-effect: non-scaling-stroke; }
.hs-strip .rule { stroke: var(--line); vector-effect: non-scaling-stroke; }
.hs-strip .now { stroke: var(--accent); stroke-width: 1.5; vector-effect: non-scaling-stroke; }
.hs-table { overflow-x: auto; font-size: 12.5px; font-variant-numeric: tabular-nums; }
.hs-table table { border-collapse: collapse; width: 100%; }
.hs-table th { text-align: left; font-weight: 500; color: var(--dim); }
.hs-table td, .hs-table th { padding: 2px 10px 2px 0; white-space: nowrap; }
.hs-table b { display: inline-block; width: 10px; height: 10px; border-radius: 3px; margin-right: 6px; }
/* For text the brand colour differs too little from either ground. */
:is(.q-btn--outline, .q-btn--flat, .q-item, .q-field) { --q-primary: var(--accent); }
.hs-row .q-btn, .hs-header .q-btn--rectangle { padding: 2px 8px; }
.hs-side { display: flex; flex-direction: column; gap: 12px; min-width: 0; }
.hs-card { padding: 10px 12px; display: flex; flex-direction: column; gap: 6px; min-width: 0; }
.hs-heading { font-weight: 600; font-size: 14px; }
.hs-row { display: flex; flex-wrap: wrap; align-items: center; gap: 4px 8px; }
.hs-knob { display: grid; grid-template-columns: 108px minmax(0, 1fr) 44px; align-items: center; gap: 8px;
  font-size: 13px; }
.hs-knob :last-child { text-align: right; font-variant-numeric: tabular-nums; }
.hs-panels-head { display: flex; flex-wrap: wrap; align-items: center; gap: 8px 16px; }
.hs-panels { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 300px), 1fr)); gap: 10px; }
.hs-panel { padding: 8px; font-size: 13px; display: flex; flex-direction: column; gap: 4px; min-width: 0; }
.hs-panel span { color: var(--accent); font-size: 12px; margin-left: 4px; }
.hs-panel .q-img, .hs-panel img { width: 100%; border-radius: 3px; }
.hs-panel > :last-child { color: var(--dim); font-size: 11.5px; min-height: 16px; overflow-wrap: anywhere; }
@media (max-width: 900px) {
  .hs-main { grid-template-columns: minmax(0, 1fr); }
  .nicegui-content { padding: 8px; }
  .hs-frame { max-width: 100%; }
}
@media (max-width: 520px) {
  /* Its icon alone: the text has no element of its own. */
  .hs-header .q-btn__content { font-size: 0; }
  .hs-header .q-btn .q-icon { font-size: 24px; }
  .hs-panels-head .hs-grow { flex-basis: 100%; }
  .hs-header .q-icon.on-left { margin-right: 0; }
  .hs-strip > div { flex-basis: 78px; font-size: 10px; }
}
"""

LET_GO = "() => setTimeout(() => document.activeElement?.blur())"
"""Handler in the browser, for lists that close: the next key is the video's again."""

KEYS = """
<script>
  // Space and arrows belong to the video; a button or slider that was clicked must not take them too.
  addEventListener("keydown", (event) => {
    const typing = event.target.closest && event.target.closest("input, textarea, select, [role=listbox]");
    if (!typing && [" ", "ArrowLeft", "ArrowRight"].includes(event.key)) event.preventDefault();
  });
  addEventListener("pointerup", () => setTimeout(() => {
    const focus = document.activeElement;
    if (focus && !focus.closest("input, textarea, select, [role=combobox]")) focus.blur();
  }));
</script>
"""
