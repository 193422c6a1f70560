"""The style sheet of the page: light and dark, narrow and wide, screen and paper; local fonts only."""

from __future__ import annotations

_COLOURS = """
:root{color-scheme:light dark;
--paper:#fff;--wash:#f6f7f8;--ink:#15191e;--soft:#57606b;--rule:#dfe3e7;--accent:#1d5a86;--tint:#cfe0ec;--track:#e9edf0;
--yes:#176a3c;--nearly:#855300;--no:#a8231c;--unknown:#57606b;--warm:#b65200;--cool:#0a5fb4}
@media (prefers-color-scheme:dark){:root{
--paper:#121518;--wash:#1a1f24;--ink:#e8ebee;--soft:#a1abb6;--rule:#2d343b;--accent:#7db8e3;--tint:#2b4a61;--track:#262d34;
--yes:#6fce97;--nearly:#e3b25c;--no:#ff8f86;--unknown:#a1abb6;--warm:#f0a35e;--cool:#6db3f2}}
"""

_TEXT = """
*{box-sizing:border-box}
html{-webkit-text-size-adjust:100%}
body{margin:0;background:var(--paper);color:var(--ink);overflow-wrap:anywhere;font-variant-numeric:tabular-nums;
font:16px/1.55 Inter,"Segoe UI",system-ui,-apple-system,"Helvetica Neue",Arial,sans-serif}
h1,h2,h3,p,dl,dd,ul,figure,table{margin:0;padding:0}
h1{font-size:2.1rem;line-height:1.15;font-weight:650;letter-spacing:-.022em}
h2{font-size:1.2rem;line-height:1.3;font-weight:650;letter-spacing:-.012em}
h3{font-size:.95rem;font-weight:600}
a{color:var(--accent);text-underline-offset:.18em;text-decoration-thickness:1px}
:focus-visible{outline:2px solid var(--accent);outline-offset:3px;border-radius:2px}
.page{max-width:71rem;margin:0 auto;padding:2.6rem 2rem 4rem}
.skip{position:absolute;left:-99rem}
.skip:focus{left:1rem;top:1rem;background:var(--paper);padding:.5rem .8rem}
.hidden{position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%);white-space:nowrap}
.defs{position:absolute}
.eyebrow{font-size:.8rem;font-weight:600;color:var(--accent);margin-bottom:.55rem}
.subtitle{color:var(--soft);margin-top:.55rem}
footer{margin-top:3rem;padding-top:1.2rem;border-top:1px solid var(--rule);color:var(--soft);font-size:.85rem}
"""

_VERDICT = """
.summary{font-size:1.3rem;line-height:1.45;letter-spacing:-.01em;margin-top:1.7rem}
.verdicts{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));margin-top:1.8rem;
border-block:1px solid var(--rule)}
.verdict{padding:1.6rem 1.6rem 1.5rem}
.verdict:first-child{padding-left:0}.verdict:last-child{padding-right:0}
.verdict+.verdict{border-left:1px solid var(--rule)}
.status{display:flex;gap:.5rem;align-items:baseline;font-weight:600;margin-top:.15rem}
.status i{font-style:normal;font-weight:700}
.yes{color:var(--yes)}.nearly{color:var(--nearly)}.no{color:var(--no)}.unknown{color:var(--unknown)}.modelled{color:var(--soft)}
.figure{font-size:2.35rem;line-height:1.1;font-weight:600;letter-spacing:-.03em;margin-top:1.15rem}
.figure-label{color:var(--soft);font-size:.9rem;margin-top:.2rem}
.verdict dl{margin-top:1.2rem;font-size:.875rem;line-height:1.45}
.verdict dl div{padding:.45rem 0;border-top:1px solid var(--rule)}
.verdict dt{color:var(--soft)}
.notice{margin-top:1.6rem;padding:1rem 1.2rem;background:var(--wash);border-left:4px solid var(--nearly)}
.notice strong{display:block}
.notice ul{padding-left:1.1rem;margin-top:.35rem}
nav{margin-top:1.5rem;font-size:.875rem}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:.35rem 1.3rem}
"""

_SECTION = """
.section{display:grid;grid-template-columns:15.5rem minmax(0,1fr);gap:0 3rem;
padding:2.6rem 0;border-top:1px solid var(--rule)}
nav+.section{margin-top:1.6rem}
.lead{color:var(--soft);font-size:.875rem;line-height:1.5;margin-top:.6rem}
.blocks>*+*{margin-top:1.7rem}
.blocks>p+p{margin-top:.7rem}
.blocks>p{max-width:44rem}
table{width:100%;border-collapse:collapse;font-size:.9rem}
.scroll{overflow-x:auto}
caption{text-align:left;font-weight:600;padding-bottom:.45rem}
th,td{padding:.5rem 0 .5rem 1.1rem;text-align:right;vertical-align:baseline;font-weight:400;
border-top:1px solid var(--rule)}
th:first-child{text-align:left;padding-left:0}
thead th{color:var(--soft);font-size:.8rem;line-height:1.3;border-top:0;vertical-align:bottom;padding-top:.2rem}
tbody th{overflow-wrap:anywhere;min-width:8.5rem}
thead th{overflow-wrap:normal}
td{white-space:nowrap}
.words{white-space:normal;text-align:left;min-width:11rem}
.wide{font-size:.82rem}
.wide th:not(:first-child),.wide td{padding-left:.7rem}
.wide thead th{font-size:.75rem}
.barred th:first-child{width:14.5rem}
.barred th:not(:first-child):not(.drawn),.barred td:not(.drawn){width:1%;white-space:nowrap}
.drawn{min-width:6rem;vertical-align:middle}
.total th,.total td{border-top:1px solid var(--ink);font-weight:600}
.facts div{display:grid;grid-template-columns:10rem minmax(0,1fr);gap:1rem;padding:.45rem 0;font-size:.9rem;
border-top:1px solid var(--rule)}
.facts dt,.stats dt{color:var(--soft)}
.bullets ul{padding-left:1.1rem;margin-top:.35rem;font-size:.9rem}
.bullets li{padding:.12rem 0}
figcaption{font-weight:600;font-size:.9rem;margin-bottom:.5rem}
.stats{display:grid;grid-template-columns:repeat(4,minmax(0,1fr));gap:1rem;margin-top:.5rem}
.stats dt{font-size:.8rem;display:flex;align-items:center;gap:.3rem}
.stats dd{font-size:1.2rem;font-weight:600;letter-spacing:-.015em}
summary{cursor:pointer;font-weight:600;font-size:.9rem;padding:.3rem 0}
svg{display:block;overflow:visible}
.ink,.mean{fill:var(--accent)}.tint{fill:var(--tint)}.paper{fill:var(--paper)}.track{fill:var(--track)}
.line{stroke:var(--accent);stroke-width:1.4;fill:none}
.part{stroke:var(--accent);stroke-width:1}
.axis{stroke:var(--soft);stroke-width:1}.band{stroke:var(--tint);stroke-width:10}
.end{stroke:var(--accent);stroke-width:2}.median{stroke:var(--ink);stroke-width:2}
.mean{stroke:var(--paper);stroke-width:2}
.grid{stroke:var(--rule);stroke-width:1}.tick{fill:var(--soft);font-size:11px;paint-order:stroke;stroke:var(--paper);stroke-width:3px}
.curve{fill:none;stroke-width:2}.c0{stroke:var(--accent)}.c1{stroke:var(--ink);stroke-dasharray:5 4}
.c2{stroke:var(--soft);stroke-dasharray:1.5 3}.c3{stroke:var(--accent);stroke-dasharray:10 3 2 3}
.curves div{display:flex;gap:.6rem;align-items:center;font-size:.85rem}.curves dd{color:var(--soft)}
"""

_PICTURES = """
.marked{stroke:var(--ink);stroke-width:1;stroke-dasharray:3 3}
.ring{fill:none;stroke:var(--ink);stroke-width:1.5}
.ground{fill:var(--wash)}
.stroke{fill:none;stroke-width:1.1}.equal{stroke:var(--soft)}.event{stroke:var(--ink)}
.reference{stroke:var(--warm);stroke-width:3.2}.chip{stroke:var(--cool);stroke-width:3.2}
.tile{fill:none;stroke:var(--rule);stroke-width:1}
.core{fill:var(--paper);stroke:var(--accent);stroke-width:1}.fill{fill:var(--tint)}
.value{fill:var(--ink);font-size:11px;font-weight:600}
.said{color:var(--soft);font-size:.85rem;margin-top:.5rem}
dl.curves{display:flex;flex-wrap:wrap;gap:.1rem 1.6rem;margin-top:.3rem}
"""

_NARROW = """
@media (max-width:60rem){
.section{grid-template-columns:minmax(0,1fr);gap:1.4rem}.lead{max-width:44rem}
}
@media screen and (max-width:60rem){
.verdicts{grid-template-columns:minmax(0,1fr)}
.verdict,.verdict:first-child,.verdict:last-child{padding:1.4rem 0}
.verdict+.verdict{border-left:0;border-top:1px solid var(--rule)}
}
@media screen and (max-width:46rem){
.page{padding:1.8rem 1.15rem 3rem}
h1{font-size:1.6rem}.summary{font-size:1.1rem}.summary p+p{margin-top:.5rem}
.facts div{grid-template-columns:minmax(0,1fr);gap:0}
.stats{grid-template-columns:repeat(2,minmax(0,1fr))}
.drawn{min-width:3.5rem}.value{font-size:8px}
.plain,.barred{font-size:.82rem}
th,td{padding:.4rem 0 .4rem .7rem}
tbody th{min-width:6.2rem;max-width:9.5rem}
thead th{overflow-wrap:break-word;font-size:.72rem}
.barred th:first-child{width:auto}
caption span{display:block;position:sticky;left:0;width:max-content;max-width:calc(100vw - 2.4rem)}
.scroll>table th:first-child{position:sticky;left:0;background:var(--paper)}
}
"""

_PAPER = """
@media print{
@page{margin:16mm 14mm}
:root{color-scheme:light;--paper:#fff;--wash:#fff;--ink:#000;--soft:#444;--rule:#c4c9ce;--accent:#1d5a86;--tint:#cfe0ec;
--track:#e9edf0;--yes:#176a3c;--nearly:#855300;--no:#a8231c;--unknown:#444;--warm:#b65200;--cool:#0a5fb4}
html{font-size:12px}body{font-size:1rem}
.page{max-width:none;padding:0}
nav,.skip{display:none}
.section{display:block;padding:1.6rem 0}.blocks{margin-top:1.2rem}
h2,.lead,figcaption,caption,thead{break-after:avoid}
.blocks>.scroll,tr,figure,.bullets,.verdict,.notice{break-inside:avoid}
svg{-webkit-print-color-adjust:exact;print-color-adjust:exact}
details::details-content{content-visibility:visible}.ground{stroke:var(--rule)}
th,td,.wide th:not(:first-child),.wide td{padding:.25rem 0 .25rem .5rem}
.scroll{overflow:visible}
th:first-child{padding-left:0}
}
"""

STYLE = "".join((_COLOURS, _TEXT, _VERDICT, _SECTION, _PICTURES, _NARROW, _PAPER))
