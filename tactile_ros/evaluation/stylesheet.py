"""The look of a report: system fonts, two schemes of colour-blind safe colours, phone to desk."""

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #fcfcfa; --card: #ffffff; --ink: #1b1d21; --soft: #5c626b; --hair: #e2e3e0;
  --c0: #0060a8; --c1: #c34f00; --c2: #007d5f; --c3: #a13d80; --c4: #7a6a00;
  --s0: #e3eef6; --s1: #b4d3e9; --s2: #79b0d8; --s3: #3b87bd; --s4: #125d93; --s5: #c34f00;
  --warn: #8a3b00; --tint: #f3f5f4;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14161a; --card: #1b1e23; --ink: #e9eaec; --soft: #a2a8b1; --hair: #31353c;
    --c0: #62b5f0; --c1: #ff9b57; --c2: #3fcf9f; --c3: #e08ec4; --c4: #d9c64a;
    --s0: #263d50; --s1: #265375; --s2: #2f6f9e; --s3: #4d97cc; --s4: #93c9f0; --s5: #ff9b57;
    --warn: #ffb27d; --tint: #20242a;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans",
    sans-serif;
}
main { max-width: 1180px; margin: 0 auto; padding: 40px 28px 64px; }
h1 { font-size: 30px; line-height: 1.2; letter-spacing: -0.015em; margin: 0 0 8px; }
h2 { font-size: 21px; line-height: 1.3; letter-spacing: -0.01em; margin: 56px 0 4px; }
h3 { font-size: 16px; line-height: 1.35; margin: 0; }
p { margin: 0; max-width: 72ch; }
.lead { color: var(--soft); font-size: 17px; }
.figures { display: grid; gap: 1px; margin: 28px 0 0; background: var(--hair);
  border: 1px solid var(--hair); border-radius: 10px; overflow: hidden;
  grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); }
.figures div { background: var(--card); padding: 16px 18px 14px; }
.figures dd { margin: 0; font-size: 30px; line-height: 1.15; font-weight: 600;
  font-variant-numeric: tabular-nums; letter-spacing: -0.02em; }
.figures dd small { font-size: 16px; font-weight: 400; color: var(--soft); letter-spacing: 0; }
.figures dt { color: var(--soft); font-size: 14px; line-height: 1.35; margin-top: 4px; }
.scroll { overflow-x: auto; margin: 18px 0 0; border: 1px solid var(--hair); border-radius: 10px;
  background: var(--card); }
table { border-collapse: collapse; width: 100%; font-size: 14px;
  font-variant-numeric: tabular-nums; }
th, td { padding: 9px; text-align: right; white-space: nowrap; }
th:first-child { padding-left: 12px; } tr > :last-child { padding-right: 12px; }
thead th { font-weight: 500; color: var(--soft); white-space: normal; vertical-align: bottom;
  line-height: 1.3; border-bottom: 1px solid var(--hair); min-width: 58px; }
tbody tr + tr th, tbody tr + tr td { border-top: 1px solid var(--hair); }
th.words, td.words { text-align: left; }
td.words { white-space: normal; min-width: 10em; }
tbody th { font-weight: 600; position: sticky; left: 0; background: var(--card); }
td.best { font-weight: 700; color: var(--c0); }
th.what { text-align: left; white-space: normal; min-width: 12em; max-width: 30em;
  font-weight: 500; }
th.under { padding-left: 28px; font-weight: 400; }
th small { color: var(--soft); font-weight: 400; }
td.ours { font-weight: 700; } td.held { color: var(--c2); }
td.missed { color: var(--warn); font-weight: 700; }
nav { display: flex; flex-wrap: wrap; gap: 6px 18px; margin: 18px 0 0; font-size: 15px; }
a { color: var(--c0); } code { font: 0.88em ui-monospace, Menlo, Consolas, "DejaVu Sans Mono",
  monospace; overflow-wrap: anywhere; }
details { margin: 14px 0 0; } summary { cursor: pointer; color: var(--c0); font-size: 15px; }
figure img { display: block; width: 100%; height: auto; margin-top: 8px; }
.grid { display: grid; gap: 20px; margin: 22px 0 0;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 350px), 1fr)); align-items: stretch; }
figure { margin: 0; padding: 16px 16px 14px; background: var(--card); min-width: 0;
  border: 1px solid var(--hair); border-radius: 10px; }
figure.wide { grid-column: 1 / -1; }
figcaption { color: var(--soft); font-size: 14px; line-height: 1.45; margin-top: 8px; }
.key { display: flex; flex-wrap: wrap; gap: 2px 14px; margin: 6px 0 0; padding: 0;
  list-style: none; font-size: 13px; color: var(--soft); }
.key i { display: inline-block; width: 12px; height: 12px; border-radius: 3px; margin-right: 6px;
  vertical-align: -1px; background: currentColor; }
svg.plot { display: block; width: 100%; height: auto; margin-top: 8px; overflow: visible; }
svg.plot + svg.plot { margin-top: 2px; }
svg.strip { display: block; width: 96px; height: 12px; margin: 3px 0 0 auto; overflow: visible; }
.only-narrow { display: none; }
svg text { font: 12px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans",
  sans-serif; fill: var(--soft); font-variant-numeric: tabular-nums; }
svg text.name { fill: var(--ink); }
svg text.note { fill: var(--ink); paint-order: stroke; stroke: var(--card); stroke-width: 4px;
  stroke-linejoin: round; }
svg text.chip { font-size: 18px; font-weight: 600; stroke-width: 3px; }
svg text.note.key { fill: currentColor; }
svg path { fill: none; stroke-linejoin: round; }
svg .grid, svg path.axis, svg path.tick { stroke: var(--hair); stroke-width: 1; display: inline; }
svg path.axis, svg path.tick { stroke: var(--soft); }
svg path.rule { stroke: var(--ink); stroke-width: 1; stroke-dasharray: 3 3; opacity: 0.75; }
svg path.line { stroke-width: 1.7; stroke: currentColor; }
svg path.dots { stroke: currentColor; stroke-width: 3.2; stroke-linecap: round; opacity: 0.45; }
svg.strip path.dots { stroke-width: 5; opacity: 1; } svg.strip path.line { stroke-width: 1.2; }
svg.strip path.rule { stroke-dasharray: none; stroke-width: 1.5; }
svg .band { fill: currentColor; opacity: 0.2; }
svg .fill { fill: currentColor; }
.c0 { color: var(--c0); } .c1 { color: var(--c1); } .c2 { color: var(--c2); }
.c3 { color: var(--c3); } .c4 { color: var(--c4); } .ink { color: var(--ink); }
svg .line.ink { stroke-width: 1.3; }
.s0 { fill: var(--s0); color: var(--s0); } .s1 { fill: var(--s1); color: var(--s1); }
.s2 { fill: var(--s2); color: var(--s2); } .s3 { fill: var(--s3); color: var(--s3); }
.s4 { fill: var(--s4); color: var(--s4); } .s5 { fill: var(--s5); color: var(--s5); }
.good::before { content: "\\2713\\00a0"; color: var(--c2); font-weight: 700; }
.problems { margin: 12px 0 0; padding: 10px 16px 10px 34px; border-left: 3px solid var(--warn);
  background: var(--tint); border-radius: 0 8px 8px 0; font-size: 15px; }
.problems li + li { margin-top: 4px; }
.agreement { margin-top: 10px; font-size: 15px; }
pre { margin: 12px 0 0; padding: 14px 16px; background: var(--tint); border-radius: 8px;
  overflow-x: auto; font: 13.5px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono",
  monospace; user-select: all; white-space: pre-wrap; overflow-wrap: anywhere; }
dl.facts { display: grid; grid-template-columns: max-content 1fr; gap: 4px 20px; margin: 14px 0 0;
  font-size: 14.5px; }
dl.facts dt { color: var(--soft); } dl.facts dd { margin: 0; overflow-wrap: anywhere; }
.notes { margin: 12px 0 0; padding-left: 20px; color: var(--soft); font-size: 15px; }
@media (max-width: 640px) {
  main { padding: 24px 16px 48px; }
  h1 { font-size: 25px; } h2 { margin-top: 44px; }
  .figures { grid-template-columns: repeat(2, 1fr); }
  .figures dd { font-size: 26px; }
  .figures div:last-child:nth-child(odd) { grid-column: span 2; }
  figure { padding: 14px 12px 12px; }
  th.what { min-width: 8.2em; max-width: 11em; }
  th, td { padding: 8px 5px; } th.under { padding-left: 18px; }
  thead th { min-width: 0; font-size: 12.5px; } svg.strip { width: 80px; }
  .only-wide { display: none; } .only-narrow { display: block; }
  dl.facts { grid-template-columns: 1fr; gap: 0; } dl.facts dd { margin-bottom: 8px; }
}
@media print { body { background: #fff; } figure { break-inside: avoid; } }
"""
