"""Style and behaviour of every page: light and dark, sorting and filtering of tables, no request to anywhere."""

from __future__ import annotations

STYLE = """
:root {
  color-scheme: light dark;
  --ground: #fbfbfa; --panel: #fff; --line: #dcdee2; --text: #1c1f24; --dim: #636a75;
  --accent: #b26a00; --good: #13794a; --good-ground: #e2f4ea;
  --s0: #0072b2; --s1: #d55e00; --s2: #009e73; --s3: #aa4499; --s4: #8a6d00; --s5: #555b66;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ground: #16181b; --panel: #1d2023; --line: #343840; --text: #e2e4e8; --dim: #969da8;
    --accent: #ffb833; --good: #6fd69a; --good-ground: #1c3a2a;
    --s0: #56b4e9; --s1: #ff8a4c; --s2: #3fd0a4; --s3: #e48ad0; --s4: #f0e442; --s5: #a5abb5;
  }
}
* { box-sizing: border-box }
body { margin: 0; background: var(--ground); color: var(--text); font: 15px/1.5 system-ui, sans-serif }
main { max-width: 1500px; margin: 0 auto; padding: 28px 24px 80px }
h1 { font-size: 25px; margin: 0 0 4px; overflow-wrap: anywhere }
h2 { font-size: 19px; margin: 44px 0 10px }
h3 { font-size: 15px; margin: 24px 0 8px }
p { margin: 6px 0; max-width: 88ch; overflow-wrap: anywhere }
.dim { color: var(--dim) }
.small { font-size: 13px }
.warning { border-left: 3px solid var(--accent); padding: 4px 12px; background: var(--panel) }
.cards { display: flex; flex-wrap: wrap; gap: 10px; margin: 18px 0 }
.card { background: var(--panel); border: 1px solid var(--line); border-radius: 8px; padding: 10px 16px;
  min-width: 132px }
.card b { display: block; font-size: 22px; font-weight: 600 }
.card span { color: var(--dim); font-size: 13px }
.scroll { overflow-x: auto; max-height: 80vh }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 14px }
th, td { padding: 5px 16px 5px 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: middle }
td { overflow-wrap: anywhere }
thead th { position: sticky; top: 0; background: var(--ground); color: var(--dim); font-weight: 500;
  white-space: nowrap }
th.number, td.number { text-align: right; white-space: nowrap }
.facts td:first-child { color: var(--dim); white-space: nowrap }
table.sortable thead th { cursor: pointer }
thead th[data-order]::after { content: " \\2193" }
thead th[data-order="up"]::after { content: " \\2191" }
.best { color: var(--good); background: var(--good-ground); font-weight: 600 }
.delta { color: var(--dim); font-size: 12px; font-weight: 400; display: block }
.views { display: grid; grid-template-columns: repeat(auto-fill, minmax(250px, 1fr)); gap: 8px }
figure { margin: 0 }
figcaption { color: var(--dim); font-size: 12.5px; line-height: 1.35; margin-top: 3px; overflow-wrap: anywhere }
.views img { width: 100%; height: auto; border-radius: 4px; background: #000 }
.views img:not(.bijective) { display: block }
img.cutout { display: block; max-width: none; border-radius: 3px }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: 13px; margin: 8px 0 }
.swatch { display: inline-block; width: 13px; height: 13px; border-radius: 3px; margin-right: 6px;
  vertical-align: -2px; border: 1px solid var(--line) }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(430px, 100%), 1fr)); gap: 24px }
svg { width: 100%; height: auto; display: block }
svg text { fill: var(--dim); font: 11px system-ui, sans-serif }
svg text.title { fill: var(--text); font-size: 13px }
svg line { stroke: var(--line); stroke-width: 1 }
svg path { fill: none; stroke-width: 1.8 }
svg path.raw { stroke-width: .8; opacity: .35 }
#bijective { position: absolute; opacity: 0 }
.bijective, #bijective:checked ~ main .views .matched { display: none }
#bijective:checked ~ main .views .bijective { display: block }
label.switch, input.filter { border: 1px solid var(--line); border-radius: 6px; padding: 4px 12px;
  background: var(--panel); color: var(--text); font: inherit; font-size: 13px; display: inline-block; margin: 6px 0 }
label.switch { cursor: pointer }
#bijective:checked ~ main label.switch { border-color: var(--accent); color: var(--accent) }
#bijective:focus-visible ~ main label.switch { outline: 2px solid var(--accent) }
"""

SCRIPT = """
for (const table of document.querySelectorAll('table.sortable')) {
  const heads = table.tHead.querySelectorAll('th');
  heads.forEach((head, column) => head.addEventListener('click', () => {
    const order = head.dataset.order === 'down' ? 'up' : 'down';
    heads.forEach(other => delete other.dataset.order);
    head.dataset.order = order;
    const value = row => row.cells[column].dataset.value ?? row.cells[column].textContent;
    const compared = (a, b) => {
      const x = value(a), y = value(b), gap = Number(x) - Number(y);
      return x === '' || y === '' || Number.isNaN(gap) ? x.localeCompare(y) : gap;
    };
    const rows = [...table.tBodies[0].rows].sort(compared);
    table.tBodies[0].append(...(order === 'up' ? rows : rows.reverse()));
  }));
}
for (const field of document.querySelectorAll('input.filter')) {
  field.addEventListener('input', () => {
    const wanted = field.value.toLowerCase();
    for (const row of document.getElementById(field.dataset.table).tBodies[0].rows)
      row.hidden = !row.textContent.toLowerCase().includes(wanted);
  });
}
"""
