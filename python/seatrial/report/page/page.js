// What the page does beyond being read: theme, charts of the evidence, and flights.
"use strict";
const inside = (id) => { const found = document.getElementById(id); return found ? JSON.parse(found.textContent) : null; };

function theme() {
  const button = document.getElementById("theme"), root = document.documentElement;
  const dark = () => (root.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const name = () => { button.textContent = dark() ? "Light theme" : "Dark theme"; };
  button.hidden = false;
  button.addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; name(); });
  name();
}

// Requests ---------------------------------------------------------------------------------------------------------

// The name of a gain in words.
const named = (kind) => kind.replace("guidance.", "").replace(/_(m_s|m|rad_s)$/, "").replace(/[._](?!K_|[PID]$)/g, " ").replace(".K_", " K_");

const number = (x) => (Number.isNaN(x) ? "nan" : Object.is(x, -0) ? "-0.0" : x === Infinity ? "inf" : x === -Infinity ? "-inf" : JSON.stringify(x));
const list = (items) => `[${items.join(", ")}]`;
const pairs = (values) => list(Object.entries(values).map(([name, value]) => `[${JSON.stringify(name)}, ${number(value)}]`));

// The core in its worker: one request at a time; of requests that wait under one name only the newest counts.
class Core {
  constructor(bytes, script) {
    this.worker = new Worker(URL.createObjectURL(new Blob([script], { type: "text/javascript" })));
    this.waiting = new Map();
    this.count = 0;
    this.ready = new Promise((resolve, reject) => {
      this.worker.onerror = (event) => reject(new Error(event.message || "the worker did not start"));
      this.worker.onmessage = ({ data }) => { if (data.ready) { this.worker.onmessage = (event) => this.answered(event.data); this.idle = true; resolve(); this.next(); } };
    });
    this.worker.postMessage({ core: bytes }, [bytes]);
  }
  static async begin() {
    const packed = Uint8Array.from(atob(document.getElementById("seatrial-core").textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Core(await new Response(stream).arrayBuffer(), document.getElementById("seatrial-worker").textContent);
  }
  // The answer; null where a newer request under the same name took its place.
  ask(name, call, request, points = 0) {
    return new Promise((resolve, reject) => {
      this.waiting.get(name)?.resolve(null);
      this.waiting.delete(name);
      this.waiting.set(name, { call, request, points, resolve, reject });
      this.next();
    });
  }
  next() {
    if (!this.idle || !this.waiting.size) return;
    // A reader's own change goes before the draws.
    const name = [...this.waiting.keys()].sort((a, b) => (a === "draws") - (b === "draws"))[0];
    this.now = this.waiting.get(name);
    this.waiting.delete(name);
    this.idle = false;
    this.worker.postMessage({ id: ++this.count, call: this.now.call, request: this.now.request, points: this.now.points });
  }
  answered(data) {
    const { resolve, reject } = this.now;
    this.idle = true;
    if (data.error) reject(new Error(data.error)); else resolve(data);
    this.next();
  }
}

// A log by columns.
class Flown {
  constructor({ numbers, text, ms }) {
    const [figures, columns] = text.split("\n").map((line) => line.split(" "));
    this.figures = Object.fromEntries(figures.map((name, k) => [name, numbers[k]]));
    this.columns = columns;
    this.values = numbers.subarray(figures.length);
    this.width = columns.length;
    this.rows = this.values.length / this.width;
    this.ms = ms;
  }
  column(name, scale = 1) {
    const k = this.columns.indexOf(name), found = new Float64Array(this.rows);
    for (let row = 0; row < this.rows; row++) found[row] = scale * this.values[row * this.width + k];
    return found;
  }
  times(period) { return Float64Array.from({ length: this.rows }, (_, row) => row * period); }
  track(points = 1500) {
    const step = Math.max(1, Math.floor(this.rows / points)), found = [];
    const row = (k) => found.push([this.values[k * this.width], this.values[k * this.width + 1], this.values[k * this.width + 2]]);
    for (let k = 0; k < this.rows; k += step) row(k);
    if (this.rows) row(this.rows - 1);
    return found;
  }
}

// How a flight ended, in the words of a run: complete is what reached its waypoints and kept its distances and limits.
function ending(figures, endings, broken) {
  if (!Number.isFinite(figures.duration)) return "diverged";
  const ended = endings[figures.ending];
  if (ended !== "complete") return ended;
  const inside = ([name, low, high]) => figures[name] >= (low ?? -Infinity) && figures[name] <= (high ?? Infinity);
  const faults = broken.filter(([, ranges]) => ranges.some(inside)).map(([words]) => words);
  if (figures.reached < figures.legs) faults.push("waypoints missed");
  return faults.length ? `flown to its end, ${faults.join(" and ")}` : ended;
}
const DEGREE = Math.PI / 180;

// Degrees without jumps where the circle closes.
function unwound(values) {
  let turns = 0;
  return values.map((x, k) => {
    const jump = k ? x - values[k - 1] : 0;
    if (jump > 180) turns -= 360; else if (jump < -180) turns += 360;
    return x + turns;
  });
}

// Degrees from 0 to 360, or from -180 to 180, the line broken where the circle closes.
function aroundCircle(values, from = 0) {
  const turned = values.map((x) => ((((x - from) % 360) + 360) % 360) + from);
  return turned.map((x, k) => (k && Math.abs(x - turned[k - 1]) > 180 ? NaN : x));
}

// Where the circle is opened so that the line breaks least often.
function openedAt(values) {
  const breaks = (from) => aroundCircle(values, from).reduce((count, x) => count + Number.isNaN(x), 0);
  return breaks(0) <= breaks(-180) ? 0 : -180;
}

// The half of an interval of 95 % for a share, after Wilson (1927).
function wilson(failed, count) {
  const z = 1.959964, p = failed / count, n = count;
  const middle = (p + (z * z) / (2 * n)) / (1 + (z * z) / n), half = (z * Math.sqrt((p * (1 - p)) / n + (z * z) / (4 * n * n))) / (1 + (z * z) / n);
  return [Math.max(0, middle - half), Math.min(1, middle + half)];
}

// Uniform numbers by a seed (mulberry32), and normal ones of them (Box and Muller).
function normals(seed) {
  let state = seed >>> 0;
  const uniform = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  return () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
}

// Flying -----------------------------------------------------------------------------------------------------------

class Deck {
  constructor(section, setups, core) {
    // JSON has no infinity: silence without an end.
    for (const setup of setups) setup.outages = setup.outages.map((row) => row.map((x) => x ?? Infinity));
    Object.assign(this, { section, setups, core });
    this.part = (name) => document.querySelector(`[data-part="${name}"]`);
    this.scene = new Scene(this.part("scene"), { onmove: (waypoint, place) => this.move(waypoint, place) });
    this.margins = new Margins(this.part("margins"));
    this.build();
    const flown = setups.findIndex((one) => one.run);
    this.choose(flown < 0 ? setups.length - 1 : flown); // what a run flew; else the vehicle of the last run
  }

  // Controls -------------------------------------------------------------------------------------------------------
  field(label, control, note = "") {
    control.id = control.id || `control-${(Deck.count = (Deck.count || 0) + 1)}`;
    return element("div", { class: "field" }, element("label", { for: control.id }, label), control, note ? element("small", {}, note) : null);
  }
  select(name, options, act) {
    const made = element("select", { "data-control": name, onchange: () => act(made.selectedIndex) }, ...options.map((text) => element("option", {}, text)));
    return made;
  }
  // The step is that of the arrows; any number within the ends counts.
  input(name, value, { min, max, step }, act) {
    const made = element("input", { type: "number", "data-control": name, value, min, max, step, onchange: () => {
      const { rangeUnderflow, rangeOverflow, badInput } = made.validity, wrong = made.value === "" || rangeUnderflow || rangeOverflow || badInput;
      made.setAttribute("aria-invalid", String(wrong));
      if (wrong) this.part("status").textContent = `${made.labels[0].textContent}: expected a number from ${min} to ${max}; what is drawn is the flight before.`;
      else act(Number(made.value));
    } });
    return made;
  }
  // A slider from 0 to 1 and its number beside it, each following the other; `from` and `to` turn one into the other,
  // `told` says the number with its unit, `note` stands behind it.
  slider(name, { label, title, value, unit, from, to, told, note = () => "", act }) {
    const place = (x) => Math.min(1, Math.max(0, to(x)));
    const behind = element("small", {}, unit || note(value));
    const moved = (x, typed) => {
      if (!typed) entry.value = Number(x.toPrecision(4));
      else made.value = place(x);
      made.setAttribute("aria-valuetext", told(x));
      behind.textContent = unit || note(x);
      act(x);
      this.refly();
    };
    const made = element("input", { type: "range", min: 0, max: 1, step: 0.005, value: place(value), title, "data-control": name, "aria-valuetext": told(value), oninput: () => moved(from(Number(made.value)), false) });
    const step = 10 ** (Math.floor(Math.log10(Math.abs(value) || 1)) - 1); // of the arrows; any number counts
    const entry = element("input", { type: "number", step, value: Number(value.toPrecision(4)), title, "aria-label": `${label}, number`, "data-entry": name, onchange: () => {
      const wrong = entry.value === "" || !Number.isFinite(Number(entry.value));
      entry.setAttribute("aria-invalid", String(wrong));
      if (!wrong) moved(Number(entry.value), true);
    } });
    const field = this.field(label, made);
    field.title = title;
    field.append(entry, behind);
    field.classList.add("slider");
    return field;
  }

  build() {
    const act = { reset: () => this.choose(this.setups.indexOf(this.setup)), draws: () => this.draws(), draw: () => this.draw(), step: () => this.step(), space: () => this.turn(), play: () => this.play() };
    for (const button of document.querySelectorAll("button[data-act]")) button.addEventListener("click", act[button.dataset.act] || (() => this.save(button.dataset.act)));
    this.clock = this.part("clock");
    this.clock.addEventListener("input", () => this.mark());
  }

  choose(which) {
    const setup = (this.setup = this.setups[which]);
    clearInterval(this.playing);
    this.state = { autopilot: 0, mission: 0, file: null, sensors: 0, filter: setup.navigation, outages: setup.outages.slice(), current: [...setup.current], waves: [...setup.waves], seed: setup.seed, fault: setup.faults.slice(), gains: {}, coefficients: {} };
    this.first = structuredClone(this.state);
    this.original = this.changed = this.cloud = this.until = null;
    // What the run flew: as long as the original is that, its record counts.
    this.runRequest = setup.run ? this.request() : null;
    this.gone = (this.gone || 0) + 1;
    this.part("cloud").textContent = this.part("stale").textContent = "";
    this.part("steps").replaceChildren();
    this.controls(which);
    return this.fly();
  }

  controls(which) {
    const setup = this.setup, state = this.state, again = () => { this.original = null; this.fly(); };
    const toward = (Math.atan2(state.current[1], state.current[0]) / DEGREE + 360) % 360, speed = Math.hypot(state.current[0], state.current[1]);
    const flow = { speed, toward };
    const water = () => { state.current = [flow.speed * Math.cos(flow.toward * DEGREE), flow.speed * Math.sin(flow.toward * DEGREE), setup.current[2]]; this.refly(); };
    const seen = (make) => (value) => { make(value); this.refly(); };
    const what = [
      this.setups.length > 1 ? this.field("Vehicle", this.select("vehicle", this.setups.map((one) => one.vehicle), (k) => this.choose(k))) : null,
      this.field("Autopilot", this.select("autopilot", setup.autopilots.map((one) => one.label), (k) => { state.autopilot = k; state.gains = {}; this.gains(); this.refly(); })),
      this.field("Mission", this.select("mission", setup.missions.map((one) => one.label), (k) => { state.mission = k; state.file = null; again(); })),
    ];
    if (this.setups.length > 1) what[0].querySelector("select").selectedIndex = which;
    this.part("what").replaceChildren(...what.filter(Boolean));
    const goes = this.select("navigation", ["what the sensors show", "a navigation filter"], (k) => { state.filter = k === 1; this.refly(); });
    goes.selectedIndex = state.filter ? 1 : 0;
    this.part("water").replaceChildren(
      this.field("Current, m/s", this.input("current", Number(speed.toFixed(3)), { min: 0, max: 3, step: 0.05 }, (x) => { flow.speed = x; water(); })),
      this.field("toward, degrees", this.input("toward", Math.round(toward), { min: 0, max: 360, step: 5 }, (x) => { flow.toward = x; water(); })),
      this.field("Wave height, m", this.input("waves", state.waves[0], { min: 0, max: 8, step: 0.1 }, seen((x) => { state.waves[0] = x; }))),
      this.field("peak period, s", this.input("period", state.waves[1], { min: 1, max: 30, step: 0.5 }, seen((x) => { state.waves[1] = x; }))),
      this.field("waves toward, degrees", this.input("wavestoward", Math.round(state.waves[2] / DEGREE), { min: -360, max: 360, step: 5 }, seen((x) => { state.waves[2] = x * DEGREE; }))),
      this.field("Sensors", this.select("sensors", setup.sensors.map((one) => one.label), (k) => { state.sensors = k; this.refly(); })),
      this.field("Autopilot goes by", goes),
      this.field("Seed", this.input("seed", state.seed, { min: 0, max: 1e9, step: 1 }, seen((x) => { state.seed = x; }))),
    );
    const fault = { which: 0, at: 60, how: 0 }, silence = { which: 0, from: 60, until: 90 };
    const fail = () => {
      const [name, , neutral] = setup.actuators[fault.which - 1] || [];
      state.fault = name ? [[name, fault.at, fault.how ? "stuck" : neutral]] : setup.faults.slice();
      state.outages = silence.which ? [[silence.which - 1, silence.from, Math.max(silence.until, silence.from + 0.1)]] : setup.outages.slice();
      this.refly();
    };
    const failed = (many) => (many.length ? "as in the run" : "none");
    this.part("fault").replaceChildren(
      this.field("Failed actuator", this.select("fault", [failed(setup.faults), ...setup.actuators.map(([name]) => name.replaceAll("_", " "))], (k) => { fault.which = k; fail(); })),
      this.field("from, s", this.input("faultat", 60, { min: 0, max: 1e5, step: 10 }, (x) => { fault.at = x; fail(); })),
      this.field("how", this.select("faulthow", ["dead", "stuck where it is"], (k) => { fault.how = k; fail(); })),
      this.field("Silent sensor", this.select("outage", [failed(setup.outages), ...setup.groups], (k) => { silence.which = k; fail(); })),
      this.field("silent from, s", this.input("outagefrom", 60, { min: 0, max: 1e5, step: 10 }, (x) => { silence.from = x; fail(); })),
      this.field("until, s", this.input("outageuntil", 90, { min: 0, max: 1e5, step: 10 }, (x) => { silence.until = x; fail(); })),
    );
    this.gains();
    this.coefficients();
    this.part("interval").textContent = setup.coefficients.length ? `Each slider spans its ${setup.coefficients[0].source.startsWith("95") ? "95 % interval" : "value ±20 %, for no interval is known"}. The autopilot keeps believing in the vehicle as it was identified.` : "";
    this.part("note").textContent = setup.note;
    for (const one of this.section.querySelectorAll("[data-act=draws], [data-act=draw], .legend .drawn")) one.hidden = !setup.covariance;
    this.part("stepof").replaceChildren(...setup.steps.map((one) => element("option", {}, `${one.set_point}, ${shown(one.step / one.one)} ${one.unit}`)));
  }

  // Sliders of the coefficients within their intervals; a drawn one may lie beyond an end, its value is told.
  coefficients() {
    const state = this.state;
    this.part("coefficients").replaceChildren(...this.setup.coefficients.map((one) => this.slider(`coefficient ${one.name}`, {
      label: one.name, title: `${one.about || one.name}; ${one.source}: ${shown(one.lower)} to ${shown(one.upper)} ${one.unit}`,
      value: state.coefficients[one.name] ?? one.value, unit: one.unit,
      from: (share) => one.lower + share * (one.upper - one.lower), to: (x) => (one.upper > one.lower ? (x - one.lower) / (one.upper - one.lower) : 0.5),
      told: (x) => `${shown(x)} ${one.unit}`, act: (x) => { state.coefficients[one.name] = x; },
    })));
  }

  // One vehicle drawn from the covariance, in place of the sliders.
  draw() {
    this.luck = (this.luck || 0) + 1;
    this.state.coefficients = this.drawnBy(normals(7919 * this.luck + this.state.seed));
    this.coefficients();
    this.refly();
  }
  drawnBy(normal) {
    const { factor, names, at } = this.setup.covariance, z = factor[0].map(normal);
    return Object.fromEntries(names.map((name, k) => [name, at[k] + factor[k].reduce((sum, x, j) => sum + x * z[j], 0)]));
  }

  // Sliders of the gains: a factor on all breakpoints of a gain, from a quarter to four times.
  gains() {
    const pilot = this.pilot(), groups = new Map();
    for (const name of Object.keys(pilot.gains)) {
      const kind = name.replace(/\.\d+$/, "");
      const wanted = /\.K_[PID]$/.test(kind) || /^guidance\.(lookahead|integral_gain)/.test(kind) || /\.reference_rad_s$/.test(kind);
      if (wanted && pilot.gains[name] !== 0) groups.set(kind, [...(groups.get(kind) || []), name]);
    }
    const order = (kind) => (kind.startsWith("guidance.lookahead") ? 0 : kind.startsWith("guidance") ? 2 : 1);
    const kinds = [...groups.keys()].sort((a, b) => order(a) - order(b));
    // One number is given as it is; a gain that changes with speed by the factor of all its breakpoints.
    this.part("gains").replaceChildren(...kinds.map((kind) => {
      const names = groups.get(kind), own = names.map((name) => pilot.gains[name]), unit = pilot.units[names[0]] || "", alone = new Set(own).size === 1, by = alone ? own[0] : 1;
      const ends = (factor) => `${shown(Number((factor * Math.min(...own)).toPrecision(3)))} to ${shown(Number((factor * Math.max(...own)).toPrecision(3)))} ${unit}`;
      const words = named(kind);
      return this.slider(`gain ${kind}`, {
        label: alone ? words : `${words} ×`, title: `${words}, a quarter to four times ${alone ? `${shown(by)} ${unit}` : `its values at ${names.length} speeds, ${ends(1)}`}`,
        value: by, unit: alone ? unit : "", from: (at) => by * 4 ** (2 * at - 1), to: (x) => (x / by > 0 ? (Math.log(x / by) / Math.log(4) + 1) / 2 : 0),
        told: (x) => (alone ? `${shown(x)} ${unit}` : `times ${shown(x)}: ${ends(x)}`), note: ends,
        act: (x) => { for (const name of names) this.state.gains[name] = pilot.gains[name] * (x / by); },
      });
    }));
  }

  // Requests ---------------------------------------------------------------------------------------------------------
  pilot() { return this.setup.autopilots[this.state.autopilot]; }
  mission() { return this.setup.missions[this.state.mission]; }
  file() { return this.state.file || this.mission().file; }
  request({ gains = this.state.gains, coefficients = this.state.coefficients, file = this.file(), seed = this.state.seed, pilot = this.pilot(), until = this.until || this.mission().max_time_s, trial = "", lines = this.mission().lines } = {}) {
    const setup = this.setup, state = this.state;
    const faults = state.fault.map(([name, at, value]) => `[${JSON.stringify(name)}, ${number(at)}, ${value === "stuck" ? "nan" : number(value)}]`);
    // A filter takes its model for exact only where that vehicle flies.
    const varied = Object.entries(coefficients).some(([name, value]) => value !== setup.nominal[name]);
    const sensors = setup.sensors[state.sensors], filter = state.filter ? (varied ? sensors.filter_varied : sensors.filter) : "";
    return `vehicle = ${JSON.stringify(setup.vehicle_file)}\nautopilot = ${JSON.stringify(pilot.file)}\nmission = ${JSON.stringify(file)}\n`
      + `coefficients = ${pairs(coefficients)}\ngains = ${pairs(gains)}\n`
      + `current = ${list(state.current.map(number))}\nwaves = ${list(state.waves.map(number))}\nseed = ${seed}\n`
      + `faults = ${list(faults)}\noutages = ${list(state.outages.map((row) => list([row[0], ...row.slice(1).map(number)])))}\n`
      + `max_time = ${number(until)}\n${trial}${lines}${sensors.lines}${filter}${setup.fixed}`;
  }

  async fly() {
    const turn = this.gone, mission = this.mission();
    const own = this.request({ gains: {}, coefficients: {}, file: mission.file, until: mission.max_time_s });
    try {
      const told = await this.core.ask("mission", "mission", `mission = ${JSON.stringify(this.file())}`);
      const flown = told && (await this.core.ask("original", "fly", own));
      if (!flown || turn !== this.gone) return;
      this.waypoints(told);
      this.original = new Flown(flown);
      this.originalPilot = this.pilot();
      this.originalRequest = own;
      await this.refly();
    } catch (error) { this.refused(error); }
  }

  waypoints({ numbers, text }) {
    const labels = text.split("\n");
    this.begin = [...numbers.subarray(0, 4)];
    this.planned = numbers[5];
    this.places = labels.map((label, k) => ({ label, place: [...numbers.subarray(8 + 4 * k, 11 + 4 * k)], acceptance: numbers[11 + 4 * k] }));
    // A longer way takes longer.
    const mission = this.mission(), more = Math.max(1, this.planned / mission.planned_time_s);
    this.until = mission.max_time_s * more;
  }

  async move(waypoint, place) {
    const rounded = place.map((x) => Number(x.toFixed(2)));
    this.places[waypoint].place.splice(0, 2, ...rounded);
    this.paint();
    try {
      const moved = await this.core.ask("move", "moved", `mission = ${JSON.stringify(this.file())}\nwaypoint = ${waypoint}\nplace = ${list(rounded.map(number))}`);
      if (!moved) return;
      this.state.file = moved.text;
      const told = await this.core.ask("mission", "mission", `mission = ${JSON.stringify(moved.text)}`);
      if (told) { this.waypoints(told); await this.refly(); }
    } catch (error) { this.refused(error); }
  }

  async refly() {
    const began = performance.now(), turn = this.gone, asked = this.request();
    try {
      // Nothing is flown twice: as long as nothing is changed, the original is the answer.
      const flown = asked === this.originalRequest ? this.original : await this.core.ask("flight", "fly", asked);
      if (!flown || turn !== this.gone) return;
      this.changed = flown === this.original ? flown : new Flown(flown);
      this.flownRequest = asked;
      this.lately = performance.now() - began;
      this.paint();
    } catch (error) { this.refused(error); }
  }

  refused(error) {
    this.part("status").textContent = `This cannot be flown: ${error.message}`;
  }

  // Pictures ---------------------------------------------------------------------------------------------------------
  untouched() { return this.flownRequest === this.originalRequest; }

  ending(figures) { return ending(figures, this.setup.endings, this.mission().broken); }

  // Where the original is the run's flight: what the run's record says of it, and figures in which this flight differs.
  record() {
    const run = this.originalRequest === this.runRequest ? this.setup.run : null;
    if (!run) return null;
    const same = (x, y) => (Number.isFinite(x) ? x === y : (y ?? null) === null);
    const off = this.setup.rows.filter(([name, , scale]) => name in run.metrics && !same(scale * this.original.figures[name], run.metrics[name])).map(([, label]) => label);
    if (run.ending !== this.ending(this.original.figures)) off.unshift("ending");
    return { ...run, off };
  }

  paint() {
    if (!this.original || !this.changed) return;
    const a = this.original, b = this.changed, period = this.pilot().period_s;
    const run = this.record(), limits = this.mission().limits, same = this.untouched();
    const first = (name, scale) => (run && name in run.metrics ? run.metrics[name] ?? NaN : a.figures[name] * scale);
    const ended = [run ? run.ending : this.ending(a.figures), this.untouched() && run ? run.ending : this.ending(b.figures)];
    const rows = [
      ["ending", "complete", ...ended],
      ...this.setup.rows
        .filter(([name]) => [a, b].some(({ figures }) => Number.isFinite(figures[name]) && (name !== "energy" || figures[name] > 0)))
        .map(([name, label, scale]) => [label, limits[name] ?? "", shown(first(name, scale)), shown(b.figures[name] * scale)]),
    ];
    this.part("figures").replaceChildren(tableOf("This flight beside the original", ["metric", "asked", "original", "changed"], rows));
    this.clock.max = Math.max(a.rows, b.rows) - 1;
    const at = (flown, name, scale) => ({ t: flown.times(period), y: flown.column(name, scale) });
    const both = (name, scale, asked = "", turned = (y) => y) => [
      ...(asked ? [{ name: "asked for", look: "asked", ...at(b, asked, scale) }] : []),
      { name: "original", look: "first", ...at(a, name, scale) }, { name: "changed", look: "second", ...at(b, name, scale) },
    ].map((line) => ({ ...line, y: turned(line.y) }));
    const circle = openedAt(a.column("yaw", 1 / DEGREE));
    const panels = [
      { name: "cross-track error", unit: "m", lines: both("cross_track", 1) },
      { name: "depth", unit: "m", lines: both("z", 1, "desired_depth") },
      { name: "forward speed", unit: "m/s", lines: both("u", 1, "desired_speed") },
      { name: "heading", unit: "deg", lines: both("yaw", 1 / DEGREE, "desired_heading", (y) => aroundCircle(y, circle)) },
      { name: "pitch", unit: "deg", lines: both("pitch", 1 / DEGREE) },
      ...this.setup.actuators.map(([name, unit]) => ({ name: `command ${name.replaceAll("_", " ")}`, unit: unit === "rad" ? "deg" : unit, lines: both(`cmd.${name}`, unit === "rad" ? 1 / DEGREE : 1) })),
    ];
    const shade = this.failures().map(([, from, until]) => [from, Math.min(until, this.until)]);
    if (this.panels) this.panels.show(panels, shade); else this.panels = new Panels(this.part("panels"), { label: "Original and changed flight", panels, shade, shadeLabel: "failure acts" });
    this.part("differs").textContent = same ? "Original and changed are one flight until something is changed." : `Changed: ${this.differs().join("; ") || "the flight's inputs"}.`;
    this.mark();
    const gains = this.state.gains, own = this.pilot().gains;
    this.margins.show(this.setup.loops[this.state.autopilot], (loop) => Object.fromEntries(["K_P", "K_I", "K_D"].map((key) => {
      const name = Object.keys(gains).find((one) => one.startsWith(`${loop}.${key}.`));
      return [key, name && own[name] ? gains[name] / own[name] : 1];
    })));
    this.part("stale").textContent = this.cloud && this.cloud.length && this.drawn !== this.request({ coefficients: {}, seed: 0 }) ? "The drawn vehicles flew before your last change: draw again." : "";
    this.part("status").textContent = `${same ? "Flown" : "Re-flown"} in ${Math.round(b.ms)} ms: ${ended[1]}, true cross-track error ${shown(b.figures.true_cross_track_rms)} m rms${same ? "" : `; original: ${ended[0]}, ${shown(first("true_cross_track_rms", 1))} m rms`}.`
      + (run && run.off.length ? ` This browser does not fly the run's flight to the bit (${run.off.join("; ")}); the column "original" is the run's record.` : run && same ? " This is the flight of the run, to the same numbers." : "");
  }

  // Failures of the changed flight: words, begin and end in s.
  failures() {
    const words = (name) => name.replaceAll("_", " ");
    return [...this.state.fault.map(([name, at, value]) => [`${words(name)} ${value === "stuck" ? "stuck" : "dead"}`, at, Infinity]), ...this.state.outages.map(([group, from, until]) => [`${this.setup.groups[group]} silent`, from, until])];
  }

  // What sets the changed flight off from the original, in words.
  differs() {
    const state = this.state, first = this.first, own = this.pilot(), parts = [], kinds = new Map();
    if (own !== this.originalPilot) parts.push(`autopilot ${own.label}`);
    for (const [name, value] of Object.entries(state.gains)) if (value !== own.gains[name]) kinds.set(name.replace(/\.\d+$/, ""), value / own.gains[name]);
    for (const [kind, factor] of kinds) parts.push(`${named(kind)} × ${shown(factor)}`);
    for (const one of this.setup.coefficients) if (one.name in state.coefficients && state.coefficients[one.name] !== one.value) parts.push(`${one.name} ${shown(one.value)} → ${shown(state.coefficients[one.name])} ${one.unit}`);
    if (state.file) parts.push("waypoints moved");
    const flow = ({ current }) => `${shown(Math.hypot(current[0], current[1]))} m/s toward ${Math.round((Math.atan2(current[1], current[0]) / DEGREE + 360) % 360)}°`;
    if (flow(state) !== flow(first)) parts.push(`current ${flow(first)} → ${flow(state)}`);
    const sea = ({ waves }) => `${shown(waves[0])} m, ${shown(waves[1])} s, toward ${Math.round(waves[2] / DEGREE)}°`;
    if (sea(state) !== sea(first)) parts.push(`waves ${sea(first)} → ${sea(state)}`);
    if (state.sensors !== first.sensors) parts.push(`sensors ${this.setup.sensors[state.sensors].label}`);
    if (state.filter !== first.filter) parts.push(state.filter ? "by a navigation filter" : "by what the sensors show");
    if (state.seed !== first.seed) parts.push(`seed ${first.seed} → ${state.seed}`);
    const same = (key) => JSON.stringify(state[key]) === JSON.stringify(first[key]);
    if (!same("fault") || !same("outages")) parts.push(this.failures().map(([words, from, until]) => `${words} from ${shown(from)} s${Number.isFinite(until) ? ` to ${shown(until)} s` : ""}`).join(", ") || "no failure");
    return parts;
  }

  mark() {
    if (!this.changed) return;
    const mission = this.mission(), row = Math.min(Number(this.clock.value), this.changed.rows - 1), period = this.pilot().period_s;
    const cloud = (this.cloud || []).map((one) => ({ look: one.fails ? "cloud bad" : "cloud", points: one.points }));
    const values = this.changed.values, width = this.changed.width;
    const at = (name, scale = 1) => shown(Number((scale * this.changed.values[row * this.changed.width + this.changed.columns.indexOf(name)]).toPrecision(3)));
    this.part("time").textContent = `${(row * period).toFixed(0)} s: ${at("x")} m north, ${at("y")} m east, ${at("z")} m deep, ${at("u")} m/s ahead`;
    const spots = this.failures().filter(([, from]) => from < this.changed.rows * period), step = (t) => Math.max(0, Math.min(this.changed.rows - 1, Math.round(t / period)));
    const spot = (k) => [0, 1, 2].map((axis) => this.changed.values[k * this.changed.width + axis]);
    const acting = spots.map(([, from, until]) => {
      const [a, b] = [step(from), step(until)], every = Math.max(1, Math.floor((b - a) / 500));
      return { look: "failing", points: [...Array.from({ length: Math.floor((b - a) / every) + 1 }, (_, k) => spot(a + k * every)), spot(b)] };
    });
    document.querySelector(".legend .failing").hidden = !spots.length;
    this.scene.show({
      tracks: [...cloud, { look: "plan", points: [this.begin.slice(0, 3), ...this.places.map((one) => one.place)] }, { look: "first", points: this.original.track() }, { look: "second", points: this.changed.track() }, ...acting],
      marks: spots.flatMap(([words, from]) => [{ place: spot(step(from)), name: words, look: "failure" }, { place: spot(step(from)), name: `${words}, ${shown(from)} s` }]),
      waypoints: this.places, obstacles: mission.obstacles, fence: mission.fence, current: this.state.current, bottom: this.setup.bottom,
      marker: row >= 0 && row < this.changed.rows ? [0, 1, 2].map((axis) => values[row * width + axis]) : null,
    });
  }

  turn() {
    this.scene.space = !this.scene.space;
    const button = this.section.querySelector("[data-act=space]");
    button.textContent = this.scene.space ? "From above" : "In space";
    button.setAttribute("aria-pressed", String(this.scene.space));
    this.scene.fit = null;
    this.scene.draw();
  }

  play() {
    const button = this.section.querySelector("[data-act=play]");
    if (this.playing) { clearInterval(this.playing); this.playing = null; button.textContent = "Play"; return; }
    if (Number(this.clock.value) >= Number(this.clock.max)) this.clock.value = 0;
    button.textContent = "Pause";
    const step = Math.max(1, Math.round(Number(this.clock.max) / 400));
    this.playing = setInterval(() => {
      this.clock.value = Number(this.clock.value) + step;
      this.mark();
      if (Number(this.clock.value) >= Number(this.clock.max)) this.play();
    }, 50);
  }

  // Vehicles drawn from the covariance, flown one by one; what the reader changes meanwhile goes first.
  async draws(count = 200) {
    const turn = ++this.gone, first = this.state.seed, normal = normals(first + 1), out = this.part("cloud");
    const cloud = (this.cloud = []);
    // What is changed meanwhile counts for the next draws, not for these.
    const common = (this.drawn = this.request({ coefficients: {}, seed: 0 }));
    let failed = 0, impossible = 0;
    while (cloud.length < count && turn === this.gone) {
      const coefficients = this.drawnBy(normal);
      let flown = null;
      try {
        const own = common.replace("\ncoefficients = []\n", () => `\ncoefficients = ${pairs(coefficients)}\n`).replace("\nseed = 0\n", () => `\nseed = ${first + cloud.length}\n`);
        flown = await this.core.ask("draws", "fly", own, 150);
      } catch (error) {
        if (++impossible > count) { out.textContent = `No vehicle could be drawn: ${error.message}`; return; }
        continue;
      }
      if (!flown || turn !== this.gone) return;
      const names = flown.text.split("\n")[0].split(" "), figures = Object.fromEntries(names.map((name, k) => [name, flown.numbers[k]]));
      const track = flown.numbers.subarray(names.length), points = [];
      for (let k = 0; k + 2 < track.length; k += 3) points.push([track[k], track[k + 1], track[k + 2]]);
      const fails = this.ending(figures) !== "complete";
      failed += fails;
      cloud.push({ points, fails });
      if (cloud.length % 10 === 0 || cloud.length === count) {
        const [low, high] = wilson(failed, cloud.length);
        out.textContent = `${failed} of ${cloud.length} drawn vehicles fail (${(100 * failed / cloud.length).toFixed(1)} %, 95 % interval ${(100 * low).toFixed(1)} to ${(100 * high).toFixed(1)} %): not flown to the end, a waypoint missed, too near to an obstacle or the bottom, or too deep. All of them fly in the water and with the sensors chosen here; a verification draws these too and has its own requirements.`
          + (impossible ? ` ${impossible} drawn vehicles were impossible and are drawn again.` : "");
        this.mark();
      }
    }
  }

  // A step of one set point after the vehicle has settled, in place of the mission.
  async step() {
    const one = this.setup.steps[this.part("stepof").selectedIndex], at = 60, until = 120, turn = this.gone, period = this.pilot().period_s;
    const speed = Math.min(...[this.pilot().gains["guidance.speed_max_m_s"] || 1, 1.5].map((x) => 0.7 * x));
    const levels = { speed: [speed, speed], heading: [this.begin[3], this.begin[3]], ...(one.set_point === "pitch" ? { pitch: [0, 0] } : { depth: [5, 5] }) };
    levels[one.set_point] = [levels[one.set_point][0], levels[one.set_point][0] + one.step];
    const trial = `times = [0.0, ${number(at)}]\nset_points = ${list(Object.entries(levels).map(([name, row]) => `[${JSON.stringify(name)}, ${list(row.map(number))}]`))}\n`;
    // Far from any waypoint, so that the mission does not end under way.
    const file = `format = 1\nname = "step"\nspeed_m_s = ${number(speed)}\nacceptance_radius_m = 1.0\n[start]\nnorth_m = 0.0\neast_m = 0.0\ndepth_m = 5.0\nheading_deg = ${number(this.begin[3] / DEGREE)}\n[[legs]]\nnorth_m = 5000.0\neast_m = 5000.0\ndepth_m = 5.0\n`;
    try {
      const flights = [];
      for (const [name, own] of [["original", { gains: {}, coefficients: {}, pilot: this.originalPilot }], ["changed", {}]]) {
        const flown = await this.core.ask(`step ${name}`, "fly", this.request({ ...own, file, until, trial, lines: "" }));
        if (!flown || turn !== this.gone) return;
        flights.push([name, new Flown(flown)]);
      }
      const lines = flights.map(([name, flown], k) => {
        const first = Math.round((at - 5) / period), raw = flown.column(one.channel, 1 / one.one).subarray(first);
        return { name, look: k ? "second" : "first", t: flown.times(period).subarray(first).map((t) => t - at), y: one.channel === "yaw" ? unwound(raw) : raw };
      });
      const [from, to] = levels[one.set_point].map((x) => x / one.one);
      const asked = { name: "asked for", look: "asked", t: Float64Array.from([-5, 0, 0, until - at]), y: Float64Array.from([from, from, to, to]) };
      const walls = one.corridor ? [["lower", "corridor"], ["upper", "corridor"]].map(([side, name]) => ({
        name, look: "wall", t: Float64Array.from(one.corridor.t), y: Float64Array.from(one.corridor[side], (share) => (share === null ? NaN : from + share * (to - from))),
      })) : [];
      const host = this.part("steps");
      host.replaceChildren();
      new Panels(host, { label: `Step of ${one.set_point}`, panels: [{ name: one.set_point, unit: one.unit, lines: [...walls, asked, ...lines] }], height: 220 });
    } catch (error) { this.refused(error); }
  }

  async save(what) {
    const state = this.state;
    try {
      const made = {
        autopilot: () => this.core.ask("save", "autopilot", `file = ${JSON.stringify(this.pilot().file)}\nvalues = ${pairs(state.gains)}`),
        vehicle: () => this.core.ask("save", "vehicle", `file = ${JSON.stringify(this.setup.vehicle_file)}\nvalues = ${pairs(state.coefficients)}`),
        mission: async () => ({ text: this.file() }),
      };
      const { text } = await made[what]();
      const link = element("a", { href: URL.createObjectURL(new Blob([text], { type: "application/toml" })), download: `${what}.toml` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
      this.exported = text;
    } catch (error) { this.refused(error); }
  }
}

async function flying() {
  const setups = inside("seatrial-flight"), section = document.getElementById("fly");
  if (!setups || !section) return;
  section.hidden = false;
  const status = section.querySelector("[data-part=status]");
  try {
    const core = await Core.begin();
    await core.ready;
    window.seatrial = new Deck(section, setups, core);
  } catch (error) {
    status.textContent = `Flights need a browser of 2023 or later (${error.message}); all results below can be read without.`;
  }
}

// Series of 16 bits a number.
function unpacked({ least, step, data }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0)), view = new DataView(bytes.buffer);
  return Float64Array.from({ length: bytes.length / 2 }, (_, k) => {
    const whole = view.getInt16(2 * k, true);
    return whole === -32768 ? NaN : least + (whole + 32500) * step;
  });
}

function evidence() {
  const runs = inside("seatrial-evidence") || [];
  for (const host of document.querySelectorAll(".evidence")) {
    host.hidden = false;
    runs[Number(host.dataset.run)].forEach((group, number) => {
      const place = element("div"), made = element("details", {}, element("summary", {}, group.title), place);
      made.addEventListener("toggle", () => {
        if (!made.open || place.childElementCount) return;
        const t = unpacked(group.t);
        const wrapped = (panel, y) => (panel.name === "yaw" ? aroundCircle(y, openedAt(unpacked(panel.lines[0].y))) : y);
        const panels = group.panels.map((panel) => ({ ...panel, lines: panel.lines.map((line) => ({ ...line, t, y: wrapped(panel, unpacked(line.y)) })) }));
        new Panels(place, { label: group.title, panels, windows: group.windows, shade: group.shade, shadeLabel: "held out of the fit", height: 84 });
      });
      host.append(made);
      if (number === 0) made.open = true;
    });
  }
}

// Every vehicle in space; the arrow keys and the pointer turn it.
function models() {
  const views = [...document.querySelectorAll("#views figure")];
  for (const { vehicle, shape } of inside("seatrial-flight") || []) {
    if (!shape.size[0] && !shape.actuators.length) continue;
    const place = element("div");
    const made = element("figure", { class: "model" }, place, element("figcaption", {}, `${vehicle} in space: drag it, or use the arrow keys`));
    views.find((view) => view.dataset.vehicle === vehicle)?.after(made);
    const scene = new Scene(place, {});
    scene.space = true;
    scene.turn = [0.9, 0.45];
    scene.show(modelOf(shape));
    scene.drawing.setAttribute("aria-label", `${vehicle} in space; arrow keys turn it`);
  }
}

// Parts of the report as tabs; without a script all of them stand below one another, and so they do on paper.
function tabs() {
  const list = document.querySelector(".tabs"), links = [...list.querySelectorAll("a")];
  const panel = (link) => document.querySelector(link.getAttribute("href"));
  const show = (link, focus = false) => {
    for (const one of links) {
      const on = one === link;
      one.setAttribute("aria-selected", String(on));
      one.setAttribute("tabindex", on ? "0" : "-1");
      panel(one).classList.toggle("away", !on);
    }
    if (focus) link.focus();
  };
  list.setAttribute("role", "tablist");
  for (const link of links) {
    link.id = `tab-${panel(link).id}`;
    link.hidden = panel(link).hidden = false;
    link.setAttribute("role", "tab");
    link.setAttribute("aria-controls", panel(link).id);
    panel(link).setAttribute("role", "tabpanel");
    link.addEventListener("click", (event) => { show(link); history.replaceState(null, "", link.getAttribute("href")); event.preventDefault(); });
    link.addEventListener("keydown", (event) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (by) { show(links[(links.indexOf(link) + by + links.length) % links.length], true); event.preventDefault(); }
    });
  }
  // A link into a part opens it; at first the last run is shown, whose verdict stands on top.
  const asked = () => links.find((link) => location.hash && panel(link).contains(document.querySelector(`[id="${CSS.escape(location.hash.slice(1))}"]`)));
  addEventListener("hashchange", () => { const link = asked(); if (link) show(link); });
  show(asked() || links.filter((link) => panel(link).id.startsWith("run-")).pop());
}

tabs();
theme();
models();
evidence();
flying();
