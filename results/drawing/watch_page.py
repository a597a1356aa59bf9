"""Self-contained page of `toppling watch`, which requests the run's state every two seconds and draws it."""

import json

from matplotlib.colors import to_hex

from toppling.results.drawing.style import COLOURS, THIN_ALPHA

PAGE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>toppling</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; max-width: 60em; margin: 1em auto; padding: 0 1em; color: #222; }
h1 { font-size: 1.3em; margin: 0; } h2 { font-size: 1.05em; margin: 1.4em 0 .4em; }
progress { width: 100%; height: 1.1em; }
table { border-collapse: collapse; font-size: 90%; display: block; overflow-x: auto; }
th, td { padding: .2em .7em .2em 0; text-align: left; border-bottom: 1px solid #ddd; }
td.wide { min-width: 15em; } .number { text-align: right; }
button { font: inherit; cursor: pointer; }
svg { max-width: 100%; height: auto; } svg text { font-size: 12px; fill: #333; }
iframe { width: 100%; height: 80vh; border: 1px solid #ccc; }
.quiet { color: #666; } .error { color: #a00; }
</style>
</head>
<body>
<h1 id="name"></h1>
<p id="state" role="status">reading the run ...</p>
<progress id="progress" value="0" max="1"></progress>
<p id="counts"></p>
<section id="failed" hidden><h2>Failures by reason</h2><table id="failures"></table></section>
<h2>Toppling probability so far</h2>
<div id="maps"></div>
<p class="quiet">Share of the jobs that toppled; pale: few records. Point at a cell for its numbers.</p>
<section id="toppled" hidden><h2>Latest topplings</h2><table id="latest"></table></section>
<section id="replayed" hidden><h2 id="replaying"></h2><iframe id="replay" title="replay"></iframe></section>
<script nonce="NONCE">
"use strict";
const at = (id) => document.getElementById(id);
const svg = (name, attributes, text) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  if (text !== undefined) made.textContent = text;
  return made;
};
const row = (cells, head) => {
  const made = document.createElement("tr");
  for (const cell of cells) {
    const place = document.createElement(head ? "th" : "td");
    if (cell instanceof Node) place.append(cell); else place.textContent = cell;
    if (typeof cell === "string" && cell.length > 60) place.className = "wide";
    made.append(place);
  }
  return made;
};
const colours = COLOURS;  // of the maps, at even steps
const shade = (share) => colours[Math.round(share * (colours.length - 1))];
const map = (state) => {
  const columns = state.columns, rows = state.rows, wide = 34, high = 22, left = 60, top = 50;
  const width = Math.max(left + columns.length * wide + 10, 300), height = top + rows.length * high + 44;
  const drawn = svg("svg", {viewBox: `0 0 ${width} ${height}`, width, height, role: "img"});
  drawn.append(svg("title", {}, state.name));
  [0, 0.25, 0.5, 0.75, 1].forEach((share, index) => {  // the scale of colours
    const x = left + 36 * index;
    drawn.append(svg("rect", {x, y: 2, width: 36, height: 12, stroke: "#999", fill: shade(share)}));
    drawn.append(svg("text", {x: x + 18, y: 27, "text-anchor": "middle"}, share));
  });
  for (const cell of state.cells) {
    const x = left + cell.column * wide, y = top + (rows.length - 1 - cell.row) * high;
    const box = svg("rect", {x, y, width: wide, height: high, opacity: cell.thin ? THIN : 1, stroke: "#fff",
      class: "cell", fill: cell.probability === null ? "none" : shade(cell.probability)});
    const numbers = `PGA ${rows[cell.row]} m/s², PGV/PGA ${columns[cell.column]} s: `;
    box.append(svg("title", {}, numbers + `${cell.toppled} of ${cell.jobs} toppled`));
    drawn.append(box);
  }
  rows.forEach((name, index) => drawn.append(svg("text", {x: left - 6, "text-anchor": "end",
    y: top + (rows.length - 1 - index) * high + high / 2 + 4}, name)));
  columns.forEach((name, index) => {
    if (columns.length > 12 && index % 2) return;
    drawn.append(svg("text", {x: left + index * wide + wide / 2, "text-anchor": "middle",
      y: top + rows.length * high + 16}, name.split(" ")[0]));
  });
  const bottom = top + rows.length * high + 36;
  drawn.append(svg("text", {x: left, y: bottom}, "PGV/PGA (s), each column from"));
  const middle = top + rows.length * high / 2;
  drawn.append(svg("text", {x: 14, y: middle, "text-anchor": "middle", transform: `rotate(-90 14 ${middle})`},
    "PGA (m/s²)"));
  return drawn;
};
const replay = (job) => {
  at("replayed").hidden = false;
  at("replaying").textContent = `Job ${job.job_id}: ${job.record_id} at ${job.level_pga_m_s2} m/s²`;
  at("replay").src = `replay/${job.job_id}`;
  at("replayed").scrollIntoView();
};
const show = (state) => {
  document.title = `${Math.floor(100 * state.stored / Math.max(state.jobs, 1))} % ${state.name}`;
  at("name").textContent = state.name;
  at("state").textContent = state.sentence;
  at("state").className = "";
  at("progress").max = Math.max(state.jobs, 1);
  at("progress").value = state.stored;
  at("counts").textContent = state.counts;
  at("failed").hidden = !state.failures.length;
  at("failures").replaceChildren(row(["jobs", "status", "message", "such as"], true),
    ...state.failures.map((one) => row([one.jobs, one.status, one.message ?? "", one.job_id])));
  at("maps").replaceChildren(...state.maps.flatMap((one) => {
    const name = document.createElement("p");
    name.textContent = one.says || (state.maps.length > 1 ? one.name : "");
    return [name, map(one)];
  }));
  at("toppled").hidden = !state.latest.length;
  at("latest").replaceChildren(row(["record", "PGA (m/s²)", "azimuth (°)", "falls toward (°)", "after (s)", ""],
    true),
    ...state.latest.map((one) => {
      const button = document.createElement("button");
      button.textContent = "replay";
      button.onclick = () => replay(one);
      return row([one.record_id, one.level_pga_m_s2, one.azimuth_deg, one.falls_toward_deg, one.topple_time_s,
        button]);
    }));
};
let before = "";
const ask = async () => {
  try {
    const answer = await fetch("state.json", {cache: "no-store"});
    const text = await answer.text(), state = JSON.parse(text);
    if (state.error) throw new Error(state.error);
    if (text !== before) show(state);
    before = text;
  } catch (error) {
    at("state").textContent = error instanceof TypeError ? "'toppling watch' has ended" : error.message;
    at("state").className = "error";
    before = "";
  }
  setTimeout(ask, 2000);
};
ask();
</script>
</body>
</html>
""".replace("COLOURS", json.dumps([to_hex(COLOURS(step / 40)) for step in range(41)])).replace(
    "THIN", str(THIN_ALPHA)
)
"""Page with a placeholder NONCE for the content security policy of its script."""

WAITING = """\
<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" content="1">
<p style="font: 15px system-ui, sans-serif">TOLD</p></html>
"""
