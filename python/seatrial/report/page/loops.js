// Bode and Nyquist of the loops, each opened alone, and their margins; they follow the factors of the gains.

// Response of a loop with factors on its own gains: real and imaginary parts by frequency.
function responseOf(parts, factors, count) {
  const re = new Float64Array(count), im = new Float64Array(count);
  for (const [key, [size, angle]] of Object.entries(parts)) {
    const factor = factors[key] ?? 1, log = unpacked(size), turn = unpacked(angle);
    for (let k = 0; k < count; k++) {
      const long = factor * Math.exp(log[k]);
      re[k] += long * Math.cos(turn[k]);
      im[k] += long * Math.sin(turn[k]);
    }
  }
  return { re, im };
}

// Margins where |L| = 1 and the negative real axis are crossed, placed between two frequencies by the logarithm of L
// (the engine of the core's front does the same).
function marginsOf({ re, im }, omega) {
  const found = { phase: 180, delay: Infinity, gain: Infinity, reduction: Infinity, sensitivity: 1, crossover: NaN, turnover: NaN };
  const size = (k) => Math.log(Math.hypot(re[k], im[k])), above = (k) => Math.atan2(-im[k], -re[k]);
  const wrapped = (x) => x - 2 * Math.PI * Math.round(x / (2 * Math.PI));
  for (let k = 0; k < omega.length; k++) {
    found.sensitivity = Math.max(found.sensitivity, 1 / Math.hypot(1 + re[k], im[k]));
    if (k + 1 === omega.length) break;
    const s = size(k), ds = size(k + 1) - s, a = above(k), da = wrapped(above(k + 1) - a);
    const at = (share) => omega[k] * (omega[k + 1] / omega[k]) ** share;
    if ((s >= 0) !== (s + ds >= 0)) {
      const share = -s / ds, over = wrapped(a + share * da), w = at(share);
      if (Math.abs(over) / DEGREE < found.phase) { found.phase = Math.abs(over) / DEGREE; found.crossover = w; }
      found.delay = Math.min(found.delay, ((over + 2 * Math.PI) % (2 * Math.PI)) / w);
    }
    if ((a < 0) !== (a + da < 0) && Math.abs(a) < Math.PI / 2) {
      const share = -a / da, log = s + share * ds;
      if (log < 0 && Math.exp(-log) < found.gain) { found.gain = Math.exp(-log); found.turnover = at(share); }
      if (log >= 0) found.reduction = Math.min(found.reduction, Math.exp(log));
    }
  }
  return found;
}

// A plot with given ends and marks; lines are [look, [[x, y]]], extras are elements of its group.
function plot({ width, height, x: [x0, x1], y: [y0, y1], marksX, marksY, name, foot, lines, extras = () => [] }) {
  const left = 46, right = 8, top = 20, under = 32;
  const x = (v) => left + ((v - x0) / (x1 - x0)) * (width - left - right), y = (v) => top + ((y1 - v) / (y1 - y0)) * (height - top - under);
  const clip = `clip-${(Panels.count = (Panels.count || 0) + 1)}`;
  const svg = element("svg", { width, height, viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true" },
    element("defs", {}, element("clipPath", { id: clip }, element("rect", { x: left, y: top, width: width - left - right, height: height - top - under }))));
  for (const [at, text] of marksX) svg.append(element("line", { class: "grid", x1: x(at), x2: x(at), y1: top, y2: height - under }), element("text", { x: x(at), y: height - under + 14, "text-anchor": x(at) < left + 8 ? "start" : "middle" }, text));
  for (const [at, text] of marksY) svg.append(element("line", { class: "grid", x1: left, x2: width - right, y1: y(at), y2: y(at) }), element("text", { x: left - 5, y: y(at) + 4, "text-anchor": "end" }, text));
  svg.append(element("text", { class: "name", x: left, y: 12 }, name), element("text", { x: width - right, y: height - 3, "text-anchor": "end" }, foot));
  const inside = element("g", { "clip-path": `url(#${clip})` }, ...extras(x, y));
  for (const [look, points] of lines) inside.append(element("path", { class: `line ${look}`, d: points.map(([a, b], k) => `${k ? "L" : "M"}${Math.max(-4000, Math.min(4000, x(a))).toFixed(1)} ${Math.max(-4000, Math.min(4000, y(b))).toFixed(1)}`).join("") }));
  svg.append(inside);
  return svg;
}

// Margins of an autopilot's loops: choice of loop and point, Bode, Nyquist and a table.
class Margins {
  constructor(host) {
    this.host = host;
    this.loop = element("select", { "data-control": "loop", onchange: () => this.choose() });
    this.point = element("select", { "data-control": "point", onchange: () => this.draw() });
    this.drawing = element("div", { class: "drawing plots", role: "img" });
    this.table = element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Margins of the loop" });
    this.said = element("p", { class: "note" });
    this.tools = element("div", { class: "tools" }, element("label", {}, "Loop ", this.loop), element("label", {}, "at ", this.point));
    host.replaceChildren(this.tools, this.drawing, this.table, this.said);
    new ResizeObserver(() => this.draw()).observe(host);
  }

  // data: as `open_loops` makes it; factors(loop): what multiplies K_P, K_I and K_D.
  show(data, factors) {
    const other = data !== this.data;
    Object.assign(this, { data, factors });
    this.tools.hidden = this.drawing.hidden = this.table.hidden = !data.points.length;
    if (!data.points.length) { this.said.textContent = data.said; return; }
    if (other) {
      const loops = [...new Set(data.points.flatMap((point) => point.loops.map((one) => one.loop)))], before = this.loop.value;
      const [from, to, count] = data.omega;
      this.omega = Float64Array.from({ length: count }, (_, k) => from * (to / from) ** (k / (count - 1)));
      this.loop.replaceChildren(...loops.map((name) => element("option", { value: name }, name)));
      this.loop.value = loops.includes(before) ? before : loops.includes("heading") ? "heading" : loops[0];
      this.choose();
    } else this.draw();
  }

  choose() {
    const points = this.data.points.map((point, k) => [point, k]).filter(([point]) => point.loops.some((one) => one.loop === this.loop.value));
    this.point.replaceChildren(...points.map(([point, k]) => element("option", { value: k }, `${point.mode}, ${shown(point.speed)} m/s${point.stable ? "" : ", unstable"}`)));
    // The middle one of those ahead where nothing grows.
    const sound = points.filter(([point]) => point.stable && point.speed > 0), among = sound.length ? sound : points;
    this.point.value = among[among.length >> 1][1];
    this.draw();
  }

  draw() {
    if (!this.data || !this.data.points.length || !this.host.clientWidth) return;
    const point = this.data.points[Number(this.point.value)], one = point.loops.find(({ loop }) => loop === this.loop.value);
    const factors = this.factors(one.loop), count = this.omega.length;
    const first = responseOf(one.parts, {}, count), second = responseOf(one.parts, factors, count);
    const a = marginsOf(first, this.omega), b = marginsOf(second, this.omega);
    this.found = { original: a, changed: b };
    const wide = Math.min(this.host.clientWidth, 1100), side = wide < 640 ? wide : Math.floor(wide * 0.6);
    this.drawing.replaceChildren(element("div", {}, ...this.bode(side, first, second)), this.nyquist(wide < 640 ? wide : wide - side - 12, first, second));
    const decibel = (x) => (Number.isFinite(x) ? 20 * Math.log10(x) : NaN), s = (x) => (Number.isFinite(x) ? x : NaN);
    const rows = [["phase margin, deg", a.phase, b.phase], ["crossover of |L| = 1, rad/s", a.crossover, b.crossover], ["gain margin upwards, dB", decibel(a.gain), decibel(b.gain)],
      ["gain margin downwards, dB", decibel(a.reduction), decibel(b.reduction)], ["delay margin, s", s(a.delay), s(b.delay)], ["largest sensitivity |1/(1+L)|", a.sensitivity, b.sensitivity]];
    const round = (x) => (Number.isFinite(x) ? shown(Number(x.toPrecision(3))) : "none");
    this.table.replaceChildren(tableOf(`Margins of the ${one.loop} loop, ${point.mode} at ${shown(point.speed)} m/s`, ["margin", "original", "changed"], rows.map(([name, x, y]) => [name, round(x), round(y)])));
    this.drawing.setAttribute("aria-label", `Bode and Nyquist of the ${one.loop} loop: phase margin ${round(a.phase)} degrees, changed ${round(b.phase)}; gain margin ${round(decibel(a.gain))} dB, changed ${round(decibel(b.gain))}`);
    this.said.textContent = `${point.stable ? "" : "With the gains of the file this point is unstable: its margins show how far it is from stability. "}Linear motion about straight level flight of the vehicle of this report, opened at this loop, the others closed, perfect sensors. The curves follow this loop's own gains; gains of other loops, coefficients and water do not change them.`;
  }

  bode(width, first, second) {
    const log = Array.from(this.omega, (w) => Math.log10(w)), low = Math.max(log[0], -2), high = log[log.length - 1];
    const decades = [];
    for (let x = Math.ceil(low); x <= high; x++) decades.push([x, String(10 ** x)]);
    const size = ({ re, im }) => log.map((x, k) => [x, 20 * Math.log10(Math.max(1e-12, Math.hypot(re[k], im[k])))]);
    const phase = ({ re, im }) => {
      let turns = null, before = 0;
      return log.map((x, k) => {
        const raw = Math.atan2(im[k], re[k]) / DEGREE;
        if (turns === null) turns = raw > 1 ? -360 : 0;
        else if (raw - before > 180) turns -= 360;
        else if (raw - before < -180) turns += 360;
        before = raw;
        return [x, raw + turns];
      });
    };
    const seen = (rows) => rows.flat().filter(([x]) => x >= low).map(([, y]) => y);
    const plots = [["size of L, dB", [size(first), size(second)], [-40, 40], 20, 0], ["phase of L, degrees", [phase(first), phase(second)], [-270, -90], 90, -180]];
    return plots.map(([name, [one, two], [least, most], step, edge], k) => {
      const values = seen([one, two]), bottom = Math.max(-720, Math.min(least, step * Math.floor(Math.min(...values) / step))), top = Math.max(most, step * Math.ceil(Math.max(...values) / step));
      const lowest = k ? bottom : Math.max(bottom, -80), marksY = [], every = (top - lowest) / step > 8 ? 2 * step : step;
      for (let y = Math.ceil(lowest / every) * every; y <= top; y += every) marksY.push([y, shown(y)]);
      return plot({ width, height: 190, x: [low, high], y: [lowest, top], marksX: decades, marksY, name, foot: "frequency, rad/s",
        lines: [["first", one], ["second", two]], extras: (x, y) => [element("line", { class: "edge", x1: x(low), x2: x(high), y1: y(edge), y2: y(edge) })] });
    });
  }

  nyquist(width, first, second) {
    const points = ({ re, im }) => Array.from(re, (x, k) => [x, im[k]]), height = Math.min(380, width), half = 2.4, tall = (half * (height - 52)) / (width - 54);
    const marksX = [-3, -2, -1, 0, 1].map((x) => [x, shown(x)]), marksY = [-2, -1, 0, 1, 2].filter((y) => Math.abs(y) < tall).map((y) => [y, shown(y)]);
    return plot({ width, height, x: [-3.4, 1.4], y: [-tall, tall], marksX, marksY, name: "Nyquist: L in the plane", foot: "real part",
      lines: [["first", points(first)], ["second", points(second)]],
      extras: (x, y) => [
        element("circle", { class: "forbidden", cx: x(-1), cy: y(0), r: Math.abs(x(-0.5) - x(-1)) }, element("title", {}, "sensitivity above 2")),
        element("circle", { class: "unit", cx: x(0), cy: y(0), r: Math.abs(x(1) - x(0)) }),
        element("path", { class: "edge", d: `M${x(-1) - 6} ${y(0)}h12M${x(-1)} ${y(0) - 6}v12` }),
      ] });
  }
}
