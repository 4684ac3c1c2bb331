// Panels over time with linked zoom, and a track from above or in space; SVG, so that theme, print and screen readers
// treat them as the rest of the page.
"use strict";
const SVG = "http://www.w3.org/2000/svg";

function element(name, attributes = {}, ...children) {
  const svg = ["svg", "g", "path", "line", "rect", "circle", "text", "polyline", "polygon", "title", "clipPath", "defs"].includes(name);
  const made = svg ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return made;
}

// Round marks between two ends, about so many.
function marks(low, high, about) {
  const span = high - low;
  if (!(span > 0) || !isFinite(span)) return [low];
  const power = 10 ** Math.floor(Math.log10(span / about));
  const step = [1, 2, 5, 10].map((x) => x * power).find((x) => span / x <= about) || 10 * power;
  const found = [];
  for (let x = Math.ceil(low / step - 1e-9) * step; x <= high + 1e-9 * span; x += step) found.push(Math.abs(x) < 1e-9 * step ? 0 : x);
  return found;
}

const shown = (x) => (Number.isFinite(x) ? (Math.abs(x) < 1e-9 ? 0 : Number(x.toPrecision(4))).toString().replace("-", "−") : "–");

// A table of a caption, heads and rows whose first cell is a head.
function tableOf(caption, heads, rows) {
  return element("table", {}, element("caption", {}, caption),
    element("thead", {}, element("tr", {}, ...heads.map((text, k) => element("th", { scope: "col", class: k ? "right" : "left" }, text)))),
    element("tbody", {}, ...rows.map(([name, ...cells]) => element("tr", {}, element("th", { scope: "row" }, name), ...cells.map((cell) => element("td", { class: "right" }, cell))))));
}

// Index of the first time that is not below x.
function place(times, x) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < x) low = middle + 1; else high = middle;
  }
  return low;
}

// The path of a line between two times: of each pixel the first, least, largest and last sample.
function pathOf(times, values, [from, to], x, y, pixels) {
  const first = Math.max(0, place(times, from) - 1), last = Math.min(times.length - 1, place(times, to) + 1);
  const bucket = Math.max(1, Math.floor((last - first) / (2 * pixels)));
  let path = "", pen = false;
  const put = (k) => {
    if (!Number.isFinite(values[k])) { pen = false; return; }
    path += `${pen ? "L" : "M"}${x(times[k]).toFixed(1)} ${y(values[k]).toFixed(1)}`;
    pen = true;
  };
  for (let k = first; k <= last; k += bucket) {
    if (bucket === 1) { put(k); continue; }
    let least = -1, most = -1, broken = false, known = -1;
    for (let j = k; j < Math.min(k + bucket, last + 1); j++) {
      if (!Number.isFinite(values[j])) { broken = true; continue; }
      known = j;
      if (least < 0 || values[j] < values[least]) least = j;
      if (most < 0 || values[j] > values[most]) most = j;
    }
    // Where a line breaks, it goes on behind the gap.
    if (broken) { pen = false; if (known === Math.min(k + bucket, last + 1) - 1) put(known); continue; }
    for (const j of [...new Set([least, most])].sort((a, b) => a - b)) put(j);
  }
  return path;
}

// Panels one below the other over one time axis.
// panels: [{name, unit, lines: [{name, look, t, y}]}]; shade: [[from, to]]; windows: [{label, from, to}].
class Panels {
  constructor(host, { label, panels, shade = [], shadeLabel = "", windows = [], height = 104 }) {
    Object.assign(this, { host, label, shade, shadeLabel, windows, height });
    this.at = null;
    this.hairs = [];
    this.texts = [];
    this.legend = element("div", { class: "legend" });
    this.tools = element("div", { class: "tools", role: "group", "aria-label": `Time axis of ${label}` },
      ...[["−", "Zoom out", () => this.zoom(2)], ["+", "Zoom in", () => this.zoom(0.5)], ["◀", "Earlier", () => this.pan(-0.4)],
        ["▶", "Later", () => this.pan(0.4)], ["All", "Show all", () => this.look(this.full)]].map(([sign, words, act]) =>
        element("button", { type: "button", class: "quiet", title: words, "aria-label": words, onclick: act }, sign)),
      windows.length ? element("label", {}, "Manoeuvre ", element("select", { onchange: (event) => {
        const one = windows[event.target.selectedIndex - 1], air = one ? 0.05 * (one.to - one.from) : 0;
        this.look(one ? [one.from - air, one.to + air] : this.full);
      } }, element("option", {}, "whole trial"), ...windows.map((one) => element("option", {}, one.label)))) : "");
    this.drawing = element("div", { class: "drawing", tabindex: "0", role: "img", "aria-label": `${label}; arrow keys pan, plus and minus zoom, 0 shows all` });
    this.readout = element("p", { class: "readout", "aria-live": "off" });
    host.append(this.tools, this.legend, this.drawing, this.readout);
    this.drawing.addEventListener("keydown", (event) => {
      const act = { ArrowLeft: () => this.pan(-0.2), ArrowRight: () => this.pan(0.2), "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), 0: () => this.look(this.full) }[event.key];
      if (act) { act(); event.preventDefault(); }
    });
    this.drawing.addEventListener("dblclick", () => this.look(this.full));
    this.drawing.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey) return; // the page scrolls
      this.zoom(event.deltaY + event.deltaX > 0 ? 1.25 : 0.8, this.time(event));
      event.preventDefault();
    }, { passive: false });
    this.drawing.addEventListener("pointerdown", (event) => { this.held = { x: event.clientX, view: this.view }; this.drawing.setPointerCapture(event.pointerId); });
    this.drawing.addEventListener("pointermove", (event) => this.moved(event));
    this.drawing.addEventListener("pointerup", () => { this.held = null; });
    this.drawing.addEventListener("pointerleave", () => { this.at = null; this.cursor(); });
    new ResizeObserver(() => this.draw()).observe(host);
    // What nobody sees is drawn when it comes into view, so that a drag stays quick.
    new IntersectionObserver(([entry]) => { this.seen = entry.isIntersecting; if (this.seen && this.late) this.draw(); }, { rootMargin: "300px" }).observe(host);
    this.show(panels);
  }

  show(panels, shade = this.shade) {
    const before = this.full;
    Object.assign(this, { panels, shade });
    const ends = panels.flatMap((panel) => panel.lines).filter((line) => line.t.length).map((line) => [line.t[0], line.t[line.t.length - 1]]);
    this.full = ends.length ? [Math.min(...ends.map(([from]) => from)), Math.max(...ends.map(([, to]) => to))] : [0, 1];
    const all = !this.view || (before && this.view[0] === before[0] && this.view[1] === before[1]);
    this.view = all ? this.full : this.view;
    const looks = new Map(panels.flatMap((panel) => panel.lines).map((line) => [line.name, line.look]));
    this.legend.replaceChildren(...[...looks].map(([name, look]) => element("span", {}, element("i", { class: `key ${look}` }), name)),
      ...(this.shade.length ? [element("span", {}, element("i", { class: "key shade" }), this.shadeLabel)] : []));
    this.draw();
  }

  look([from, to]) {
    const least = (this.full[1] - this.full[0]) / 2000;
    if (to - from < least) return;
    const span = Math.min(to - from, this.full[1] - this.full[0]);
    const begin = Math.min(Math.max(from, this.full[0]), this.full[1] - span);
    this.view = [begin, begin + span];
    this.draw();
  }
  zoom(by, about = (this.view[0] + this.view[1]) / 2) { this.look([about + (this.view[0] - about) * by, about + (this.view[1] - about) * by]); }
  pan(by) { const step = by * (this.view[1] - this.view[0]); this.look([this.view[0] + step, this.view[1] + step]); }
  time(event) {
    const box = this.drawing.getBoundingClientRect();
    return this.view[0] + ((event.clientX - box.left - this.left) / this.inner) * (this.view[1] - this.view[0]);
  }
  moved(event) {
    if (this.held && event.buttons) {
      const shift = ((this.held.x - event.clientX) / this.inner) * (this.held.view[1] - this.held.view[0]);
      this.look([this.held.view[0] + shift, this.held.view[1] + shift]);
      return;
    }
    this.at = this.time(event);
    this.cursor();
  }
  cursor() {
    const inside = this.at !== null && this.at >= this.view[0] && this.at <= this.view[1];
    for (const line of this.hairs) {
      line.setAttribute("visibility", inside ? "visible" : "hidden");
      if (inside) { line.setAttribute("x1", this.x(this.at)); line.setAttribute("x2", this.x(this.at)); }
    }
    const values = (panel) => panel.lines.filter((line) => line.t.length).map((line) => `${line.name} ${shown(Number(line.y[Math.min(place(line.t, this.at), line.t.length - 1)].toPrecision(4)))}`).join(", ");
    this.panels.forEach((panel, k) => { if (this.texts[k]) this.texts[k].textContent = inside ? `${values(panel)} ${panel.unit}` : ""; });
    this.readout.textContent = inside ? `at ${shown(Number(this.at.toPrecision(5)))} s` : "";
  }

  draw() {
    this.late = this.seen === false;
    if (this.late) return;
    const width = Math.max(this.host.clientWidth, 240), left = (this.left = 58), right = 10;
    const inner = (this.inner = width - left - right), height = this.height, gap = 22;
    const [from, to] = this.view;
    const x = (this.x = (t) => left + ((t - from) / (to - from)) * inner);
    const total = this.panels.length * (height + gap) + 34;
    const svg = element("svg", { width, height: total, viewBox: `0 0 ${width} ${total}`, "aria-hidden": "true" });
    this.hairs = [];
    this.texts = [];
    const clip = `clip-${(Panels.count = (Panels.count || 0) + 1)}`;
    svg.append(element("defs", {}, element("clipPath", { id: clip }, element("rect", { x: left, y: 0, width: inner, height: total }))));
    this.panels.forEach((panel, number) => {
      const top = number * (height + gap) + gap;
      let low = Infinity, high = -Infinity;
      for (const line of panel.lines) {
        for (let k = Math.max(0, place(line.t, from) - 1); k < line.t.length && line.t[k] <= to; k++) {
          const value = line.y[k];
          if (value < low) low = value;
          if (value > high) high = value;
        }
      }
      if (!(high >= low)) { low = 0; high = 1; }
      const room = high > low ? 0.06 * (high - low) : Math.max(0.1 * Math.abs(high), 1);
      low -= room; high += room;
      const y = (value) => top + height - ((value - low) / (high - low)) * height;
      const frame = element("g", {});
      for (const [begin, end] of this.shade) {
        const a = Math.max(begin, from), b = Math.min(end, to);
        if (b > a) frame.append(element("rect", { class: "shaded", x: x(a), y: top, width: x(b) - x(a), height }));
      }
      for (const mark of marks(low, high, Math.max(4, height / 26))) frame.append(element("line", { class: "grid", x1: left, x2: left + inner, y1: y(mark), y2: y(mark) }), element("text", { x: left - 6, y: y(mark) + 4, "text-anchor": "end" }, shown(mark)));
      for (const mark of marks(from, to, Math.max(2, inner / 90))) {
        frame.append(element("line", { class: "grid", x1: x(mark), x2: x(mark), y1: top, y2: top + height }));
        if (number === this.panels.length - 1) frame.append(element("text", { x: x(mark), y: top + height + 15, "text-anchor": "middle" }, shown(mark)));
      }
      frame.append(element("text", { x: left, y: top - 6, class: "name" }, `${panel.name}, ${panel.unit}`));
      const inside = element("g", { "clip-path": `url(#${clip})` });
      for (const line of panel.lines) inside.append(element("path", { class: `line ${line.look}`, d: pathOf(line.t, line.y, this.view, x, y, inner) }));
      const hair = element("line", { class: "hair", y1: top, y2: top + height, visibility: "hidden" });
      const text = element("text", { class: "value", x: left + inner, y: top - 6, "text-anchor": "end" });
      this.hairs.push(hair);
      this.texts.push(text);
      svg.append(frame, inside, hair, text);
    });
    svg.append(element("text", { x: left + inner, y: total - 1, "text-anchor": "end" }, "time, s"));
    this.drawing.replaceChildren(svg);
  }
}

// Tracks from above (north up) or in space. scene: {tracks: [{look, points: [[n, e, d]]}], waypoints, obstacles, fence, marker, current}.
class Scene {
  constructor(host, { onmove }) {
    this.onmove = onmove;
    this.space = false;
    this.turn = [0.6, 0.5];
    this.size = 1;
    this.host = host;
    this.drawing = element("div", { class: "drawing", role: "group", "aria-label": "Track; in space the arrow keys turn it" });
    host.append(this.drawing);
    this.drawing.addEventListener("keydown", (event) => {
      if (!this.space) return;
      const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
      if (by) { this.rotate(by); event.preventDefault(); }
    });
    this.drawing.addEventListener("pointerdown", (event) => { if (this.space) { this.held = [event.clientX, event.clientY]; this.drawing.setPointerCapture(event.pointerId); } });
    this.drawing.addEventListener("pointermove", (event) => {
      if (!this.held || !event.buttons) return;
      this.rotate([(event.clientX - this.held[0]) / 150, (event.clientY - this.held[1]) / 150]);
      this.held = [event.clientX, event.clientY];
    });
    this.drawing.addEventListener("pointerup", () => { this.held = null; });
    new ResizeObserver(() => this.draw()).observe(host);
  }
  rotate([about, over]) {
    this.turn = [this.turn[0] + about, Math.min(1.5, Math.max(0.05, this.turn[1] + over))];
    this.draw();
  }
  show(scene) { this.scene = scene; this.fit = null; this.draw(); }

  // Page coordinates of a place, before scaling: east right, north up; in space turned, depth down.
  flat([north, east, depth]) {
    if (!this.space) return [east, -north];
    const [about, over] = this.turn, deep = depth * this.scene.stretch;
    const across = east * Math.cos(about) - north * Math.sin(about), away = east * Math.sin(about) + north * Math.cos(about);
    return [across, -away * Math.sin(over) + deep * Math.cos(over)];
  }

  draw() {
    if (!this.scene) return;
    const scene = this.scene, width = Math.max(this.host.clientWidth, 240), height = scene.plain ? Math.min(520, Math.max(300, width * 0.72)) : Math.min(Math.max(260, Math.min(width * 0.72, innerHeight - 400)), 900);
    const places = [...scene.tracks.flatMap((track) => track.points), ...scene.waypoints.map((one) => one.place)];
    const norths = places.map((one) => one[0]), easts = places.map((one) => one[1]), depths = places.map((one) => one[2]);
    const least = (list) => list.reduce((a, b) => Math.min(a, b), Infinity), most = (list) => list.reduce((a, b) => Math.max(a, b), -Infinity);
    scene.stretch = scene.plain ? 1 : Math.min(8, Math.max(1, Math.round((0.3 * Math.max(most(norths) - least(norths), most(easts) - least(easts), 1)) / Math.max(most(depths), 1))));
    const box = [[least(norths), least(easts)], [least(norths), most(easts)], [most(norths), most(easts)], [most(norths), least(easts)]];
    const flat = [...places, ...box.map(([n, e]) => [n, e, 0])].map((one) => this.flat(one));
    const ends = this.dragging && this.fit ? this.fit : (this.fit = [least(flat.map((p) => p[0])), most(flat.map((p) => p[0])), least(flat.map((p) => p[1])), most(flat.map((p) => p[1]))]);
    const scale = Math.min((width - 80) / Math.max(ends[1] - ends[0], 0.1), (height - 60) / Math.max(ends[3] - ends[2], 0.1));
    const x = (p) => width / 2 + (p[0] - (ends[0] + ends[1]) / 2) * scale, y = (p) => height / 2 + (p[1] - (ends[2] + ends[3]) / 2) * scale;
    const at = (place) => { const p = this.flat(place); return [x(p), y(p)]; };
    const poly = (points, close) => points.map((one, k) => `${k ? "L" : "M"}${at(one).map((v) => v.toFixed(1)).join(" ")}`).join("") + (close ? "Z" : "");
    const svg = element("svg", { width, height, viewBox: `0 0 ${width} ${height}` });
    // From above a grid in metres, so that a place can be read.
    if (!this.space && !scene.plain) {
      const lines = (low, high, pixels) => marks(low, high, Math.max(3, pixels / 70));
      const east = (p) => (p - width / 2) / scale + (ends[0] + ends[1]) / 2, south = (p) => (p - height / 2) / scale + (ends[2] + ends[3]) / 2;
      for (const e of lines(east(0), east(width), width)) svg.append(element("line", { class: "grid", x1: x([e, 0]), x2: x([e, 0]), y1: 0, y2: height }), element("text", { class: "mark", x: x([e, 0]) + 3, y: 11 }, `${shown(e)} E`));
      for (const n of lines(-south(height), -south(0), height)) svg.append(element("line", { class: "grid", x1: 0, x2: width, y1: y([0, -n]), y2: y([0, -n]) }), element("text", { class: "mark", x: 3, y: y([0, -n]) - 3 }, `${shown(n)} N`));
    }
    if (this.space && !scene.plain) {
      svg.append(element("path", { class: "surface", d: poly(box.map(([n, e]) => [n, e, 0]), true) }, element("title", {}, "surface")));
      if (scene.bottom) svg.append(element("path", { class: "bottom", d: poly(box.map(([n, e]) => [n, e, scene.bottom[0] + n * scene.bottom[1] + e * scene.bottom[2]]), true) }, element("title", {}, "bottom")));
    }
    if (scene.fence.length) svg.append(element("path", { class: "fence", d: poly(scene.fence.map(([n, e]) => [n, e, 0]), true) }, element("title", {}, "fence")));
    for (const one of scene.obstacles) {
      const ring = one.corners_m || Array.from({ length: 48 }, (_, k) => [one.north_m + one.radius_m * Math.cos((k * Math.PI) / 24), one.east_m + one.radius_m * Math.sin((k * Math.PI) / 24)]);
      svg.append(element("path", { class: "obstacle", d: poly(ring.map(([n, e]) => [n, e, 0]), true) }, element("title", {}, "obstacle")));
      if (this.space) {
        const deep = most(depths);
        svg.append(element("path", { class: "obstacle", d: poly(ring.map(([n, e]) => [n, e, deep]), true) }));
        for (let k = 0; k < ring.length; k += Math.ceil(ring.length / 8)) svg.append(element("path", { class: "obstacle", d: poly([[...ring[k], 0], [...ring[k], deep]]) }));
      }
    }
    for (const track of scene.tracks) svg.append(element("path", { class: `line ${track.look}`, d: poly(track.points) }));
    scene.waypoints.forEach((one, number) => svg.append(this.waypoint(one, number, at(one.place), scale)));
    if (scene.marker) svg.append(element("circle", { class: "marker", cx: at(scene.marker)[0], cy: at(scene.marker)[1], r: 7 }, element("title", {}, "vehicle")));
    // Names keep off one another: each goes down until nothing is below it.
    const taken = [];
    for (const { place, name, look } of scene.marks || []) {
      const [cx, cy] = at(place);
      if (look) { svg.append(element("circle", { class: look, cx, cy, r: 5 }, element("title", {}, name))); continue; }
      const long = 6.6 * name.length, ending = cx + 5 + long > width, left = ending ? cx - 5 - long : cx + 5;
      let foot = cy - 5;
      while (taken.some(([a, b, y]) => a < left + long && left < b && Math.abs(y - foot) < 13)) foot += 13;
      taken.push([left, left + long, foot]);
      if (foot > cy + 8) svg.append(element("line", { class: "lead", x1: cx, y1: cy, x2: ending ? left + long : left, y2: foot - 4 }));
      svg.append(element("text", { x: left, y: foot }, name));
    }
    if (!scene.plain) this.rose(svg, scene, scale, width, height);
    const focused = document.activeElement && this.drawing.contains(document.activeElement) ? document.activeElement.dataset.number : null;
    this.drawing.replaceChildren(svg);
    if (this.space) this.drawing.setAttribute("tabindex", "0"); else this.drawing.removeAttribute("tabindex");
    if (focused !== null && focused !== undefined) this.drawing.querySelector(`[data-number="${focused}"]`)?.focus();
  }

  waypoint(one, number, [cx, cy], scale) {
    const fixed = this.space || !this.onmove;
    const made = element("circle", { class: `waypoint${fixed ? "" : " free"}`, cx, cy, r: fixed ? 3.5 : 6, "data-number": number, tabindex: fixed ? null : "0", role: fixed ? null : "button", "aria-label": fixed ? null : `Waypoint ${number + 1}, ${one.label}: arrow keys move it by a metre` },
      element("title", {}, `${number + 1} ${one.label}: ${shown(one.place[0])} m north, ${shown(one.place[1])} m east, ${shown(one.place[2])} m`));
    if (fixed) return made;
    made.addEventListener("keydown", (event) => {
      const by = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1] }[event.key];
      if (!by) return;
      const far = event.shiftKey ? 5 : 1;
      this.onmove(number, [one.place[0] + far * by[0], one.place[1] + far * by[1]]);
      event.preventDefault();
    });
    made.addEventListener("pointerdown", (event) => {
      const begin = [event.clientX, event.clientY], from = one.place;
      this.dragging = true;
      const follow = (moved) => this.onmove(number, [from[0] - (moved.clientY - begin[1]) / scale, from[1] + (moved.clientX - begin[0]) / scale]);
      const end = () => { this.dragging = false; removeEventListener("pointermove", follow); removeEventListener("pointerup", end); this.draw(); };
      addEventListener("pointermove", follow);
      addEventListener("pointerup", end);
      event.preventDefault();
    });
    return made;
  }

  // North, the scale and where the current goes.
  rose(svg, scene, scale, width, height) {
    const length = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((m) => m * scale > 60) || 10000;
    const foot = height - 14;
    svg.append(element("line", { class: "rule", x1: 14, x2: 14 + length * scale, y1: foot, y2: foot }), element("text", { x: 14, y: foot - 6 }, `${length} m`));
    const arrow = (north, east, long, name, from, look) => {
      const a = this.flat([0, 0, 0]), b = this.flat([north, east, 0]), far = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
      const dx = ((b[0] - a[0]) / far) * long, dy = ((b[1] - a[1]) / far) * long;
      svg.append(element("path", { class: look, d: `M${from[0]} ${from[1]}l${dx} ${dy}m${-0.3 * dx - 0.2 * dy} ${-0.3 * dy + 0.2 * dx}l${0.3 * dx + 0.2 * dy} ${0.3 * dy - 0.2 * dx}l${-0.3 * dx + 0.2 * dy} ${-0.3 * dy - 0.2 * dx}` }), element("text", { x: from[0] + dx + (dx < 0 ? -4 : 4), y: from[1] + dy, "text-anchor": dx < 0 ? "end" : "start" }, name));
    };
    arrow(1, 0, 26, "N", [52, 58], "rule");
    const speed = Math.hypot(...scene.current.slice(0, 2));
    if (speed > 0) arrow(scene.current[0], scene.current[1], 30, `current ${shown(speed)} m/s`, [width - 150, 44], "flow");
    if (this.space && scene.stretch > 1) svg.append(element("text", { x: width - 10, y: foot, "text-anchor": "end" }, `depth drawn ${scene.stretch} times as deep`));
  }
}

// The hull as rings and lines, actuators with arrows of positive force, fins as squares of their area; body axes.
function modelOf({ size, box, actuators, gravity, buoyancy }) {
  const [length, breadth, height] = size.map((x) => 0.5 * x), tracks = [], reach = Math.max(length, breadth, height, 0.1);
  const ring = (x, y, z, count = 32) => Array.from({ length: count + 1 }, (_, k) => [x, y * Math.cos((2 * Math.PI * k) / count), z * Math.sin((2 * Math.PI * k) / count)]);
  if (box) {
    const corners = [[-1, -1], [-1, 1], [1, 1], [1, -1], [-1, -1]];
    for (const x of [-length, length]) tracks.push({ look: "hull", points: corners.map(([y, z]) => [x, y * breadth, z * height]) });
    for (const [y, z] of corners.slice(0, 4)) tracks.push({ look: "hull", points: [[-length, y * breadth, z * height], [length, y * breadth, z * height]] });
  } else if (length > 0) {
    // A nose of 35 % and a tail of 55 % of the half length, as in the three views.
    const share = (x) => Math.sqrt(Math.max(0, 1 - Math.max(0, (x - 0.65) / 0.35) ** 2)) * (1 - 0.85 * Math.max(0, (-0.45 - x) / 0.55) ** 2);
    const stations = Array.from({ length: 41 }, (_, k) => Math.sin(-Math.PI / 2 + (Math.PI * k) / 40));
    for (const x of stations.filter((_, k) => k % 4 === 0)) tracks.push({ look: "hull", points: ring(x * length, share(x) * breadth, share(x) * height) });
    for (let k = 0; k < 8; k++) tracks.push({ look: "hull", points: stations.map((x) => [x * length, share(x) * breadth * Math.cos((k * Math.PI) / 4), share(x) * height * Math.sin((k * Math.PI) / 4)]) });
  }
  const marks = [{ place: gravity, name: "centre of gravity", look: "gravity" }, { place: buoyancy, name: "centre of buoyancy", look: "buoyancy" }];
  const along = (place, by, direction) => place.map((x, k) => x + by * direction[k]);
  for (const { name, place, force, chord, side } of actuators) {
    const tip = along(place, 0.3 * reach, force), other = Math.abs(force[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    tracks.push({ look: "force", points: [place, tip, along(along(tip, -0.06 * reach, force), 0.03 * reach, other), tip, along(along(tip, -0.06 * reach, force), -0.03 * reach, other)] });
    marks.push({ place: tip, name: name.replaceAll("_", " ") });
    if (!chord) continue;
    const span = [chord[1] * force[2] - chord[2] * force[1], chord[2] * force[0] - chord[0] * force[2], chord[0] * force[1] - chord[1] * force[0]];
    tracks.push({ look: "fin", points: [[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]].map(([a, b]) => along(along(place, (0.5 * a) * side, chord), 0.5 * b * side, span)) });
  }
  return { tracks, marks, waypoints: [], obstacles: [], fence: [], current: [0, 0, 0], bottom: null, marker: null, plain: true };
}
