// Draws the charts of a report with Observable Plot. Their data is JSON in the page (chart.rs).
"use strict";

const charts = JSON.parse(document.getElementById("charts").textContent);

// Space between the marks and the frame of their panel [px].
const INSET = 14;
const LETTERS = 12;
// Distances of a label from its mark [px]: beyond the first, a line joins them.
const REACH = [9, 22, 38, 56, 78, 104, 134];

const number = (value) => {
  const power = Math.floor(Math.log10(Math.abs(value)));
  if (value === 0) return "exactly 0";
  if (power >= -3 && power < 5) return String(+value.toPrecision(3));
  const raised = [...String(power)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
  const factor = +(value / 10 ** power).toPrecision(3);
  return factor === 1 ? `10${raised}` : `${factor}·10${raised}`;
};

// Returns a logarithmic axis that holds all values. What is 0 has a place of its own before the
// smallest other one.
const axis = (values, most) => {
  const [least, largest] = d3.extent(values.filter((value) => value > 0));
  let [lo, hi] = [least ?? 1, largest ?? 1];
  if (lo === hi) [lo, hi] = [lo / 1.5, hi * 1.5];
  const zero = values.some((value) => value <= 0) ? lo / Math.max((hi / lo) ** 0.2, 1.1) : null;
  const decades = Math.log10(hi / lo);
  const steps = decades < 0.7 ? [1, 1.5, 2, 3, 5, 7] : decades < 2.2 ? [1, 2, 5] : [1];
  const powers = d3.range(Math.floor(Math.log10(lo)), Math.ceil(Math.log10(hi)) + 1);
  const round = powers.flatMap((power) => steps.map((step) => +`${step}e${power}`));
  const inside = round.filter((tick) => tick >= lo * 0.999 && tick <= hi * 1.001);
  const stride = Math.ceil(inside.length / most);
  const ticks = inside.filter((_, i) => i % stride === 0);
  return {
    domain: [zero ?? lo, hi],
    at: (value) => (value > 0 ? value : zero),
    ticks: zero === null ? ticks : [zero, ...ticks],
    // Where the place of 0 ends.
    border: zero === null ? [] : [Math.sqrt(zero * lo)],
    name: (words) => (tick) => (tick === zero ? words : number(tick)),
  };
};

const axes = (panels, [columns, rows]) => {
  const marks = panels.flatMap((panel) => panel.marks);
  return [axis(marks.flatMap((mark) => mark.x), columns), axis(marks.map((mark) => mark.y), rows)];
};

const apart = (a, b) => a.x1 <= b.x0 || b.x1 <= a.x0 || a.y1 <= b.y0 || b.y1 <= a.y0;

// Writes names beside their marks, where neither another name nor a mark is. One that has no room
// is left out, and shown when it is pointed at; those that are needed may lie on marks.
const label = (svg, wanted, dots, frame) => {
  const placed = [];
  const layer = d3.select(svg).append("g").attr("font-size", LETTERS).attr("text-anchor", "start");
  for (const { name, x, y, color, needed } of wanted) {
    const text = layer.append("text").attr("class", "label").attr("fill", color).text(name);
    const [width, half] = [text.node().getComputedTextLength(), LETTERS * 0.65];
    const near = needed ? REACH : REACH.slice(0, 2);
    const places = near.flatMap((reach) =>
      [[1, 0], [-1, 0], [0, -1], [0, 1], [0.7, -0.7], [-0.7, -0.7], [0.7, 0.7], [-0.7, 0.7]].map(([dx, dy]) => {
        const x0 = x + dx * reach - (dx < 0 ? width : dx > 0 ? 0 : width / 2);
        const middle = y + dy * (reach + half);
        return { x0, x1: x0 + width, y0: middle - half, y1: middle + half, far: reach > REACH[0] };
      }));
    const inside = ({ x0, x1, y0, y1 }) =>
      x0 >= frame.x0 + 2 && x1 <= frame.x1 - 2 && y0 >= frame.y0 + 2 && y1 <= frame.y1 - 2;
    const free = places.filter((own) => inside(own) && placed.every((other) => apart(own, other)));
    const place = free.find((own) => dots.every((dot) => apart(own, dot))) ?? (needed ? free[0] : undefined);
    if (!place) {
      text.remove();
      continue;
    }
    placed.push(place);
    text.attr("x", place.x0).attr("y", place.y1 - LETTERS * 0.4);
    if (place.far) {
      const nearest = (lo, hi, at) => Math.min(Math.max(at, lo), hi);
      layer.insert("line", ":first-child").attr("stroke", color).attr("stroke-opacity", 0.6)
        .attr("x1", x).attr("y1", y)
        .attr("x2", nearest(place.x0, place.x1, x)).attr("y2", nearest(place.y0, place.y1, y));
    }
  }
};

const draw = (chart, panel, [x, y], [width, height]) => {
  const margin = { left: 74, right: 14, top: 22, bottom: 42 };
  const marks = panel.marks;
  const front = d3.sort(marks.filter((mark) => mark.front), (mark) => mark.x[1]);
  const at = { x: (mark) => x.at(mark.x[1]), y: (mark) => y.at(mark.y) };
  const color = (mark) => (mark.front ? "var(--front)" : "var(--soft)");
  const said = (mark) =>
    `${mark.label}\n${chart.axes[1]}: ${number(mark.y)}\n${number(mark.x[1])} ${chart.unit} (${number(mark.x[0])} to ${number(mark.x[2])})`;
  const svg = Plot.plot({
    width, height, inset: INSET,
    marginLeft: margin.left, marginRight: margin.right, marginTop: margin.top, marginBottom: margin.bottom,
    x: { type: "log", domain: x.domain, axis: null },
    y: { type: "log", domain: y.domain, axis: null },
    ariaLabel: `${chart.title}, ${panel.title}. ${chart.conclusion}`,
    marks: [
      Plot.gridX(x.ticks, { stroke: "var(--line)", strokeOpacity: 1 }),
      Plot.gridY(y.ticks, { stroke: "var(--line)", strokeOpacity: 1 }),
      Plot.ruleX(x.border, { stroke: "var(--soft)", strokeDasharray: "2,4" }),
      Plot.ruleY(y.border, { stroke: "var(--soft)", strokeDasharray: "2,4" }),
      Plot.axisX(x.ticks, { text: x.name("none"), label: null, tickSize: 0, fill: "var(--soft)" }),
      Plot.axisY(y.ticks, { text: y.name("exactly 0"), label: null, tickSize: 0, fill: "var(--soft)" }),
      Plot.frame({ stroke: "var(--line)" }),
      Plot.line(front, { ...at, curve: "step-after", stroke: "var(--front)", strokeOpacity: 0.5, strokeWidth: 2 }),
      Plot.ruleY(marks, { y: at.y, x1: (mark) => x.at(mark.x[0]), x2: (mark) => x.at(mark.x[2]), stroke: color, strokeOpacity: 0.6 }),
      Plot.dot(marks, { ...at, r: 4, fill: (mark) => (mark.front ? "var(--front)" : "var(--paper)"), stroke: color, strokeWidth: 1.5 }),
      Plot.dot(marks.filter((mark) => mark.auto), { ...at, r: 8, stroke: "var(--auto)", strokeWidth: 2 }),
      Plot.tip(marks, Plot.pointer({ ...at, title: said })),
    ],
  });
  const [across, down] = ["x", "y"].map((name) => svg.scale(name).apply);
  const place = (mark) => [across(at.x(mark)), down(at.y(mark))];
  // What is longer than the chart is wide is written smaller.
  const fit = (text) => {
    const [long, room] = [text.node().getComputedTextLength(), width - margin.right];
    if (long > room) text.attr("font-size", (LETTERS * room) / long);
  };
  const texts = d3.select(svg).append("g").attr("fill", "var(--ink)").attr("font-size", LETTERS);
  const named = [];
  named[0] = texts.append("text").attr("text-anchor", "start").attr("y", 13).text(`↑ ${chart.axes[1]}`);
  named[1] = texts.append("text").attr("text-anchor", "end").attr("x", width - margin.right).attr("y", height - 6)
    .text(`${chart.axes[0]} →`);
  // A few names: what is automatic, what comes nearest to it, and some along the front.
  const stride = Math.ceil(front.length / (width < 500 ? 3 : 7));
  const rank = (mark) => (mark.auto ? 0 : mark.label === chart.alternative ? 1 : front.indexOf(mark) % stride === 0 ? 2 : 3);
  const wanted = d3.sort(marks.filter((mark) => rank(mark) < (mark.front ? 3 : 2)), rank);
  return [svg, () => named.forEach(fit) ?? label(
    svg,
    wanted.map((mark) => ({
      name: mark.label, x: place(mark)[0], y: place(mark)[1],
      color: mark.auto ? "var(--auto)" : mark.front ? "var(--ink)" : "var(--soft)",
      needed: rank(mark) < 2,
    })),
    marks.map((mark) => {
      const [[cx, cy], r] = [place(mark), mark.auto ? 9 : 5];
      return { x0: cx - r, x1: cx + r, y0: cy - r, y1: cy + r };
    }),
    { x0: margin.left, x1: width - margin.right, y0: margin.top, y1: height - margin.bottom })];
};

const show = (place, width) => {
  const chart = charts[place.dataset.chart];
  const is_pooled = place.dataset.panel === undefined;
  const panel = is_pooled ? chart.pooled : chart.apart[place.dataset.panel];
  // Panels of a figure share their axes.
  const scales = axes(is_pooled ? [panel] : chart.apart, [Math.floor(width / 70), is_pooled ? 8 : 6]);
  const height = is_pooled ? Math.min(420, Math.max(300, width / 2)) : 250;
  const [svg, name] = draw(chart, panel, scales, [width, height]);
  place.replaceChildren(svg);
  name();
};

// Draws what has become visible or changed its width.
const update = () => {
  for (const place of document.querySelectorAll(".panel > div")) {
    const width = place.clientWidth;
    if (width === 0 || place.drawn === width) continue;
    place.drawn = width;
    show(place, width);
  }
};
addEventListener("resize", update);
document.querySelectorAll("details").forEach((details) => details.addEventListener("toggle", update));
update();
