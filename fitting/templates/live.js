"use strict";
(() => {
  const data = JSON.parse(document.getElementById("live-data").textContent);
  const find = (id) => document.getElementById(id);
  const space = "http://www.w3.org/2000/svg";
  const colour = (k, n) => `hsl(${250 - (230 * k) / Math.max(n - 1, 1)} 65% 42%)`;

  function draw(parent, kind, attributes, text) {
    const made = document.createElementNS(space, kind);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  }

  // The two sliders step through the lengths and pressures of the table: every number is the model's.
  const chosen = { length: 0, pressure: 0 };
  for (const name of ["length", "pressure"]) {
    const slider = find(name), last = data[name].length - 1;
    Object.assign(slider, { min: 0, max: last, step: 1 });
    slider.value = chosen[name] = Math.round(0.6 * last);
    slider.addEventListener("input", () => { chosen[name] = Number(slider.value); show(); });
  }

  // --- the muscle, to scale

  const widest = Math.max(...data.radius.flat().filter(Number.isFinite), data.rest_radius);
  const longest = Math.max(...data.length.map(Number), data.rest);
  const scale = Math.min(560 / longest, 46 / widest);

  function outline(length, radius) {
    const [L, R, E] = [length * scale, radius * scale, data.rest_radius * scale];
    const shoulder = Math.min(0.25 * L, 1.2 * Math.abs(R - E) + 4), x = 40, y = 55;
    const side = (s) => `C ${x + shoulder / 2} ${y + s * E} ${x + shoulder / 2} ${y + s * R} ${x + shoulder} ${y + s * R}`
      + ` L ${x + L - shoulder} ${y + s * R}`
      + ` C ${x + L - shoulder / 2} ${y + s * R} ${x + L - shoulder / 2} ${y + s * E} ${x + L} ${y + s * E}`;
    return [`M ${x} ${y - E} ${side(-1)}`, `M ${x} ${y + E} ${side(1)}`, { x, y, L, R, E }];
  }

  function muscle(i, j) {
    const svg = find("drawn");
    svg.replaceChildren();
    const R = data.radius[i][j] ?? data.rest_radius;
    const [top, bottom, at] = outline(Number(data.length[i]), R);
    const step = 2 * at.R / Math.max(Math.tan(data.angle[i][j] ?? 1), 0.2);
    const clip = draw(svg, "clipPath", { id: "inside" });
    draw(clip, "rect", { x: at.x, y: at.y - at.R, width: at.L, height: 2 * at.R });
    const threads = draw(svg, "g", { "clip-path": "url(#inside)", stroke: "#9aa3ad", "stroke-width": 0.7 });
    const rise = 2 * at.R * Math.tan(data.angle[i][j] ?? 1);
    for (let x = at.x - rise; x < at.x + at.L + rise; x += Math.max(step / 2, 5)) {
      draw(threads, "line", { x1: x, y1: at.y - at.R, x2: x + rise, y2: at.y + at.R });
      draw(threads, "line", { x1: x, y1: at.y + at.R, x2: x + rise, y2: at.y - at.R });
    }
    for (const path of [top, bottom]) draw(svg, "path", { d: path, fill: "none", stroke: "#1d1f22", "stroke-width": 2 });
    for (const path of outline(data.rest, data.rest_radius).slice(0, 2))
      draw(svg, "path", { d: path, fill: "none", stroke: "#5b6168", "stroke-dasharray": "4 4" });
    for (const x of [at.x - 16, at.x + at.L])
      draw(svg, "rect", { x, y: at.y - at.E, width: 16, height: 2 * at.E, fill: "#5b6168" });
  }

  // --- force against length

  const frame = { left: 58, right: 620, top: 12, bottom: 290 };
  const lengths = data.length.map(Number);
  const [low, high] = [Math.min(...lengths), Math.max(...lengths)];
  const most = 1.05 * Math.max(...data.force.flat().map(Number).filter(Number.isFinite), ...data.points.map((p) => p[2]));
  const X = (length) => frame.left + (frame.right - frame.left) * (length - low) / (high - low);
  const Y = (force) => frame.bottom - (frame.bottom - frame.top) * force / most;

  function ticks(from, to) {
    const rough = (to - from) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
    const found = [];
    for (let at = Math.ceil(from / step) * step; at <= to; at += step) found.push(Number(at.toPrecision(6)));
    return found;
  }

  const curves = find("curves");
  for (const at of ticks(low, high))
    draw(curves, "text", { x: X(at), y: frame.bottom + 16, "text-anchor": "middle", "font-size": 11 }, at);
  for (const at of ticks(0, most)) {
    draw(curves, "line", { x1: frame.left, x2: frame.right, y1: Y(at), y2: Y(at), stroke: "#d9dce0" });
    draw(curves, "text", { x: frame.left - 6, y: Y(at) + 4, "text-anchor": "end", "font-size": 11 }, at);
  }
  draw(curves, "text", { x: (frame.left + frame.right) / 2, y: frame.bottom + 34, "text-anchor": "middle", "font-size": 12 },
    `length, ${data.units.length}`);
  draw(curves, "text", { x: 14, y: 150, "text-anchor": "middle", "font-size": 12, transform: "rotate(-90 14 150)" },
    `force, ${data.units.force}`);
  data.shown.forEach((j, k) => {
    const points = lengths.map((length, i) => [length, Number(data.force[i][j])]).filter((p) => Number.isFinite(p[1]));
    draw(curves, "polyline", { points: points.map(([l, f]) => `${X(l)},${Y(f)}`).join(" "), fill: "none",
      stroke: colour(k, data.shown.length), "stroke-width": 1.3 });
  });
  for (const [length, pressure, force] of data.points) {
    const near = data.shown.map((j) => Math.abs(Number(data.pressure[j]) - pressure));
    draw(curves, "circle", { cx: X(length), cy: Y(force), r: 2.6, fill: "none",
      stroke: colour(near.indexOf(Math.min(...near)), data.shown.length) });
  }
  const band = draw(curves, "line", { stroke: "#d55e00", "stroke-width": 5, "stroke-opacity": 0.35 });
  const dot = draw(curves, "circle", { r: 5, fill: "#d55e00" });
  const told = draw(curves, "text", { "font-size": 12, "text-anchor": "middle", "font-weight": 600 });
  curves.addEventListener("pointermove", (event) => {
    const box = curves.getBoundingClientRect();
    const x = 640 * (event.clientX - box.left) / box.width, y = 330 * (event.clientY - box.top) / box.height;
    const away = (list, at) => list.map((one) => Math.abs(one - at));
    const nearest = (list) => list.indexOf(Math.min(...list));
    const i = nearest(away(lengths.map(X), x));
    const off = away(data.shown.map((j) => Y(Number(data.force[i][j]))), y).map((one) => (Number.isFinite(one) ? one : 1e9));
    const j = data.shown[nearest(off)];
    const inside = x > frame.left && x < frame.right && y < frame.bottom && Math.min(...off) < 30;
    told.textContent = inside ? `${data.pressure[j]} ${data.units.pressure}, ${data.length[i]} ${data.units.length}: `
      + `${data.force[i][j]} ${data.units.force}` : "";
    told.setAttribute("x", Math.min(Math.max(x, 180), 480));
    told.setAttribute("y", Math.max(y - 12, 14));
  });

  // --- the state of the sliders

  function show() {
    const { length: i, pressure: j } = chosen, force = data.force[i][j];
    find("at-length").value = data.length[i];
    find("at-pressure").value = data.pressure[j];
    const known = force !== null, ends = [data.low[i][j], data.high[i][j]];
    find("answer").textContent = !known ? "The model's force is undefined at this state."
      : `Force ${force} ${data.units.force}` + (ends[0] === null ? "" : `, 95 % band ${ends[0]} to ${ends[1]} ${data.units.force}`);
    const at = { cx: X(Number(data.length[i])), cy: Y(Number(force ?? 0)) };
    for (const [name, value] of Object.entries(at)) dot.setAttribute(name, value);
    const [bottom, top] = ends.map((end) => Y(Number(end ?? force ?? 0)));
    for (const [name, value] of Object.entries({ x1: at.cx, x2: at.cx, y1: bottom, y2: top })) band.setAttribute(name, value);
    muscle(i, j);
  }
  show();
})();
