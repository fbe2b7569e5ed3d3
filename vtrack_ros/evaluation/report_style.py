"""The style sheet of the report."""

STYLE = """
:root { color-scheme: light dark; --ink: #1c2128; --quiet: #66707c; --paper: #fbfbfa;
  --card: #fff; --rule: #dfe3e8; --best: #e4f3e6; --shade: #9aa4b033; --warn: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e3e6ea; --quiet: #98a2ae; --paper: #14171b;
  --card: #1c2026; --rule: #343b44; --best: #1f3a27; --shade: #9aa4b044; --warn: #ff8a80; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
main { max-width: 1040px; margin: 0 auto; padding: 24px 20px 60px; }
h1 { font-size: 26px; margin: 0; } h2 { font-size: 19px; margin: 0 0 10px; }
h3 { font-size: 14px; margin: 12px 0 2px; color: var(--quiet); }
header p { margin: 4px 0; }
.quiet { color: var(--quiet); font-size: 13px; font-weight: normal; }
section { background: var(--card); border: 1px solid var(--rule); border-radius: 8px;
  padding: 16px 18px; margin-top: 18px; }
.problems { border-color: var(--warn); } .problems h2 { color: var(--warn); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 4px 9px; text-align: right; border-bottom: 1px solid var(--rule);
  white-space: nowrap; }
tr > th:first-child { text-align: left; position: sticky; left: 0; background: var(--card); }
tbody th { font-weight: 600; } thead th { color: var(--quiet); font-weight: 600; }
td small { color: var(--quiet); } .best { background: var(--best); font-weight: 600; }
i { display: inline-block; width: 11px; height: 11px; border-radius: 3px; margin-right: 6px; }
.legend { margin: 0 0 8px; font-size: 13px; }
.legend span { display: inline-block; margin-right: 16px; }
.row { display: flex; flex-wrap: wrap; gap: 14px; }
figure { margin: 6px 0; } figcaption { color: var(--quiet); font-size: 13px; }
svg { max-width: 100%; height: auto; display: block; }
svg text { fill: var(--quiet); font: 12px system-ui, sans-serif; }
svg text.small { font-size: 10px; }
.grid { stroke: var(--rule); fill: none; } .axis { stroke: var(--quiet); fill: none; }
.line { fill: none; stroke-width: 1.8; stroke-linejoin: round; }
.whisker { stroke: var(--ink); stroke-width: 1.2; fill: none; }
.shade { fill: var(--shade); }
.row figure svg { border-radius: 6px; }
details { border-top: 1px solid var(--rule); padding: 10px 0; }
summary { cursor: pointer; font-weight: 600; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 2px 14px; font-size: 13px; }
dt { font-weight: 600; } dd { margin: 0; color: var(--quiet); }
"""
