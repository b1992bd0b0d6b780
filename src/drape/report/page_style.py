"""How the page of results looks: light or dark as the reader's system is, from a phone to a wide screen."""

STYLE = """
:root {
  color-scheme: light dark;
  --page: #f6f7f9; --card: #ffffff; --ink: #1c2128; --soft: #5b6470; --line: #dde2e8; --accent: #2563a8;
  --stage: linear-gradient(#eef1f5, #dfe4ea); --mark: #eaf1fb;
  --shadow: 0 1px 2px rgb(20 30 45 / .06), 0 4px 16px rgb(20 30 45 / .05);
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #12161c; --card: #1a2028; --ink: #e4e9ef; --soft: #9aa5b1; --line: #2c3540; --accent: #7ab4f0;
    --stage: linear-gradient(#2a323d, #1f262f); --mark: #1f2c3d; --shadow: none;
  }
}
* { box-sizing: border-box; }
html { scroll-behavior: smooth; scroll-padding-top: 4rem; }
body {
  margin: 0; background: var(--page); color: var(--ink); line-height: 1.55;
  font-family: system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
}
header, main, footer { max-width: 84rem; margin: 0 auto; padding: 0 1.25rem; }
header { padding-top: 2.75rem; padding-bottom: .5rem; }
h1 { font-size: clamp(1.7rem, 4vw, 2.4rem); line-height: 1.15; letter-spacing: -.02em; margin: 0 0 .6rem; }
h2 { font-size: 1.45rem; letter-spacing: -.01em; margin: 3rem 0 .4rem; }
h3 { font-size: 1.08rem; margin: 2rem 0 .3rem; }
p { margin: .4rem 0; max-width: 62rem; }
.lead { font-size: 1.08rem; color: var(--soft); }
.note, figcaption, footer { color: var(--soft); font-size: .875rem; }
a { color: var(--accent); text-decoration-thickness: 1px; text-underline-offset: 2px; }
nav { position: sticky; top: 0; z-index: 5; background: color-mix(in srgb, var(--page) 88%, transparent);
  backdrop-filter: blur(8px); border-bottom: 1px solid var(--line); }
nav ul { max-width: 84rem; margin: 0 auto; padding: .55rem 1.25rem; display: flex; gap: 1.4rem; list-style: none;
  overflow-x: auto; white-space: nowrap; font-size: .92rem; }
nav a { text-decoration: none; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .8rem; margin: 1.4rem 0; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: .7rem; padding: .8rem 1rem;
  box-shadow: var(--shadow); }
.tile b { display: block; font-size: 1.5rem; line-height: 1.2; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: .875rem; }
.table { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: .7rem;
  box-shadow: var(--shadow); margin: .8rem 0; }
table { border-collapse: collapse; width: 100%; font-size: .8rem; font-variant-numeric: tabular-nums; }
th, td { padding: .4rem .42rem; text-align: right; white-space: nowrap; vertical-align: baseline; }
td small { display: block; color: var(--soft); font-size: .74rem; font-weight: 400; line-height: 1.2; }
th:first-child { text-align: left; position: sticky; left: 0; background: var(--card); }
thead th { border-bottom: 1px solid var(--line); color: var(--soft); font-weight: 600; }
tbody th { font-weight: 600; }
tbody tr + tr > * { border-top: 1px solid color-mix(in srgb, var(--line) 55%, transparent); }
tbody tr.paper > *, tbody tr.paper th { color: var(--soft); font-weight: 400; font-style: italic; }
tbody tr.paper th { padding-left: 1.6rem; }
tbody tr.floor > * { color: var(--soft); }
td.best { font-weight: 700; background: var(--mark); }
details { margin: .6rem 0; } summary { cursor: pointer; color: var(--accent); font-size: .9rem; }
.notes { font-size: .82rem; color: var(--soft); padding-left: 1.1rem; overflow-wrap: anywhere; }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); gap: 1rem; }
figure { margin: 0; }
.chart { background: var(--card); border: 1px solid var(--line); border-radius: .7rem; padding: .9rem;
  box-shadow: var(--shadow); }
.chart img { width: 100%; height: auto; display: block; }
.white img { background: #fff; border-radius: .3rem; }
.lanes { display: grid; grid-template-columns: repeat(auto-fill, minmax(11rem, 1fr)); gap: .8rem; margin: .8rem 0; }
.lane { background: var(--card); border: 1px solid var(--line); border-radius: .7rem; overflow: hidden;
  box-shadow: var(--shadow); display: flex; flex-direction: column; }
.lane.recorded { border-color: var(--accent); }
.lane img { width: 100%; height: auto; aspect-ratio: 3 / 4; display: block; background: var(--stage); }
.lane .gone { aspect-ratio: 3 / 4; padding: .8rem; font-size: .78rem; color: var(--soft); background: var(--stage);
  overflow: auto; overflow-wrap: anywhere; }
.lane figcaption { padding: .5rem .7rem .6rem; line-height: 1.35; }
.lane figcaption b { display: block; color: var(--ink); overflow-wrap: anywhere; }
.lane figcaption span { display: inline-block; white-space: nowrap; margin-right: .5rem; }
.lane.recorded figcaption span { white-space: normal; }
.scale { display: inline-block; width: 9rem; height: .7rem; border-radius: .35rem; vertical-align: middle;
  margin: 0 .4rem; border: 1px solid var(--line); }
footer { padding-top: 2.5rem; padding-bottom: 3rem; }
@media (max-width: 34rem) {
  h2 { margin-top: 2.2rem; } .lanes { grid-template-columns: repeat(2, minmax(0, 1fr)); gap: .55rem; }
  th, td { padding: .38rem .55rem; } table { font-size: .8rem; }
  tbody th, thead th:first-child { white-space: normal; min-width: 6.5rem; }
}
@media print { nav { display: none; } .lane, .table, .chart { break-inside: avoid; } }
"""
"""CSS of the whole page; it needs no other file."""
