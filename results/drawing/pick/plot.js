// The acceleration that topples a rock, by its azimuth: interval, median, and what they were before the last hint.
const NS = "http://www.w3.org/2000/svg";

export function drawn(name, attributes, text) {
  const made = document.createElementNS(NS, name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  if (text !== undefined) made.textContent = text;
  return made;
}

const SIZE = 260, MIDDLE = SIZE / 2, REACH = 100;

export function polar(table, before) {
  const all = [...table, ...(before || [])];
  const most = Math.max(...all.map(each => each.high_m_s2), 1e-6);
  const step = [0.1, 0.2, 0.5, 1, 2, 5, 10].find(one => most / one <= 5) || 20;
  const outer = step * Math.ceil(most / step);
  const at = (azimuth, value) => {
    const angle = azimuth * Math.PI / 180, reach = REACH * Math.min(value, outer) / outer;
    return [MIDDLE + reach * Math.cos(angle), MIDDLE - reach * Math.sin(angle)];
  };
  const ring = (rows, name) => rows.map(each => at(each.azimuth_deg, each[name]).map(v => v.toFixed(1)).join(" ")).join(" L ");
  const closed = (rows, name) => `M ${ring(rows, name)} Z`;
  const svg = drawn("svg", { viewBox: `0 0 ${SIZE} ${SIZE}`, role: "img", "aria-label": "least constant acceleration of the ground that topples the rock, by azimuth" });
  for (let value = step; value <= outer + 1e-9; value += step) {
    svg.append(drawn("circle", { cx: MIDDLE, cy: MIDDLE, r: REACH * value / outer, fill: "none", stroke: "#dde1e6" }));
    const [x, y] = at(-60, value);  // between the winds
    svg.append(drawn("text", { x: x + 2, y: y + 10 }, `${+value.toFixed(2)}${value + step > outer ? " m/s²" : ""}`));
  }
  for (const [azimuth, name] of [[0, "E"], [90, "N"], [180, "W"], [270, "S"]]) {
    const [x, y] = at(azimuth, outer), [u, v] = [MIDDLE + 1.14 * (x - MIDDLE), MIDDLE + 1.14 * (y - MIDDLE) + 4];
    svg.append(drawn("line", { x1: MIDDLE, y1: MIDDLE, x2: x, y2: y, stroke: "#eef0f3" }));
    svg.append(drawn("text", { x: u, y: v, "text-anchor": "middle", "font-weight": "bold" }, name));
  }
  svg.append(drawn("path", { d: closed(table, "high_m_s2") + " " + closed(table, "low_m_s2"), fill: "#0057b7", "fill-opacity": 0.22, "fill-rule": "evenodd" }));
  for (const name of before ? ["low_m_s2", "high_m_s2"] : [])
    svg.append(drawn("path", { d: closed(before, name), fill: "none", stroke: "#8a5a00", "stroke-dasharray": "4 3" }));
  svg.append(drawn("path", { class: "median", d: closed(table, "median_m_s2"), fill: "none", stroke: "#0057b7", "stroke-width": 2 }));
  return svg;
}

export function width(table) {
  const shares = table.map(each => (each.high_m_s2 - each.low_m_s2) / Math.max(each.median_m_s2, 1e-9)).sort((a, b) => a - b);
  const half = shares.length >> 1;
  return shares.length % 2 ? shares[half] : (shares[half - 1] + shares[half]) / 2;
}
