// Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
// Draws what /events says: one card a sensor. No dependencies; forces keep ten seconds.
const SPAN = 10, ANSWER_MS = 5000, STOPS = [[65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [253, 231, 37]];
const cards = new Map();
const note = document.getElementById('note');
let control = false, waiting = null, heard = 0, guide = null, answered = -ANSWER_MS;

const colour = (share) => {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1), i = Math.min(Math.floor(at), STOPS.length - 2);
  const mix = (k) => Math.round(STOPS[i][k] + (at - i) * (STOPS[i + 1][k] - STOPS[i][k]));
  return `rgb(${mix(0)},${mix(1)},${mix(2)})`;
};
const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const short = (x, digits = 3) => (x === null || x === undefined ? '–' : Number(x.toPrecision(digits)).toString());
const si = (x, unit) => {
  if (unit !== 'T') return short(x);
  const [scale, name] = x >= 1e-3 ? [1e3, 'mT'] : [1e6, 'µT'];
  return `${short(x * scale)} ${name}`;
};

function fit(canvas) {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  const [w, h] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const pen = canvas.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  return [pen, box.width, box.height];
}

class Card {
  constructor(name, layout) {
    const part = document.getElementById('card').content.cloneNode(true);
    this.root = part.querySelector('article');
    for (const key of ['badge', 'tare', 'skin', 'most', 'force', 'rate', 'lost', 'label', 'faults']) {
      this[key] = part.querySelector(`.${key}`);
    }
    this.name = name; this.history = [];
    part.querySelector('h2').textContent = name ? `${name} (${layout.sensor})` : layout.sensor || 'sensor';
    this.tare.addEventListener('click', () => this.askTare());
    this.take(layout);
  }

  take(layout) {
    this.layout = layout;
    const [x, y] = [0, 1].map((k) => layout.positions.map((p) => p[k]));
    this.low = [Math.min(...x), Math.min(...y)]; this.high = [Math.max(...x), Math.max(...y)];
    let pitch = Infinity;
    const few = layout.positions.slice(0, 400);
    few.forEach((a, i) => few.slice(i + 1).forEach((b) => {
      const apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (apart > 0) pitch = Math.min(pitch, apart);
    }));
    this.pitch = Number.isFinite(pitch) ? pitch : 4e-3;
  }

  hear(frame) {
    this.frame = frame;
    const last = this.history.at(-1);
    if (last && frame.t < last.t) this.history = [];
    this.history.push({ t: frame.t, force: frame.force, sigma: frame.sigma });
    while (this.history.length && this.history[0].t < frame.t - SPAN) this.history.shift();
  }

  draw() {
    const f = this.frame;
    if (!f) return;
    this.drawSkin(f);
    this.force.hidden = Boolean(guide) && this.history.every((p) => p.force.every((x) => x === null));
    if (!this.force.hidden) this.drawForce();
    const slips = f.slip === 1;
    this.badge.textContent = slips ? 'slips' : f.in_contact === 1 ? 'contact' : f.in_contact === 0 ? 'untouched' : 'contact unknown';
    this.badge.className = `badge ${slips ? 'slip' : f.in_contact === 1 ? 'on' : ''}`;
    this.rate.textContent = `${f.rate.toFixed(0)} Hz`;
    this.lost.textContent = f.lost;
    const named = f.label >= 0 ? `class ${f.label}` : f.cell >= 0 ? `cell ${f.cell}` : '–';
    this.label.textContent = f.probability === null || f.label < 0 ? named : `${named} (${Math.round(100 * f.probability)} %)`;
    const faults = guide ? f.faults.filter((one) => !/^(not calibrated|no baseline)/.test(one)) : f.faults;
    this.faults.textContent = faults.join('; ') || (f.valid || guide ? '' : 'not valid');
    this.most.textContent = si(f.most, this.layout.unit);
    this.tare.hidden = !control;
  }

  drawSkin(f) {
    const [pen, w, h] = fit(this.skin), change = floats(f.change), n = this.layout.positions.length, c = change.length / n;
    const margin = 1.2 * this.pitch;
    const size = [0, 1].map((k) => this.high[k] - this.low[k] + 2 * margin);
    const scale = Math.min(w / size[0], h / size[1]), middle = [0, 1].map((k) => (this.high[k] + this.low[k]) / 2);
    const at = (x, y) => [w / 2 + (x - middle[0]) * scale, h / 2 - (y - middle[1]) * scale];
    const radius = Math.max(2, 0.36 * this.pitch * scale), bad = new Set(f.bad), tau = 2 * Math.PI;
    const many = n > 400;
    for (let i = 0; i < n; i += 1) {
      const d = change.subarray(i * c, i * c + c), [x, y] = at(...this.layout.positions[i]);
      const share = Math.hypot(...d) / f.most;
      pen.fillStyle = bad.has(i) ? ink('--line') : colour(share);
      if (many) pen.fillRect(x - radius, y - radius, 2 * radius, 2 * radius);
      else { pen.beginPath(); pen.arc(x, y, radius, 0, tau); pen.fill(); }
      if (bad.has(i)) this.cross(pen, x, y, radius);
      else if (c === 3 && !many) this.arrow(pen, x, y, x + 2 * radius * d[0] / f.most, y - 2 * radius * d[1] / f.most, ink('--ink'), 1.5);
    }
    if (f.in_contact !== 0) f.contacts.forEach((one, i) => this.contact(pen, at, scale, one, i === 0 ? f.ellipse : null));
    if (guide) this.targets(pen, at, radius);
    pen.fillStyle = ink('--soft'); pen.font = '12px system-ui';
    pen.fillText('x →  y ↑', 6, h - 6);
  }

  targets(pen, at, radius) {
    guide.targets.forEach(([px, py, count], i) => {
      const [x, y] = at(px, py), next = i === guide.next;
      pen.fillStyle = ink(count ? '--ink' : '--paper'); pen.strokeStyle = ink(count ? '--paper' : '--ink'); pen.lineWidth = 1.5;
      pen.beginPath(); pen.arc(x, y, 5, 0, 2 * Math.PI); pen.fill(); pen.stroke();
      if (!next) return;
      pen.strokeStyle = ink('--bad'); pen.lineWidth = 4;
      pen.beginPath(); pen.arc(x, y, Math.max(12, 1.4 * radius), 0, 2 * Math.PI); pen.stroke();
    });
  }

  contact(pen, at, scale, [px, py, fx, fy], ellipse) {
    const [x, y] = at(px, py), [a, b, turn] = ellipse ?? [0, 0, 0];
    pen.strokeStyle = ink('--bad'); pen.lineWidth = 2;
    pen.beginPath(); pen.ellipse(x, y, Math.max(5, a * scale), Math.max(5, b * scale), -turn, 0, 2 * Math.PI); pen.stroke();
    if (fx !== null && fy !== null) this.arrow(pen, x, y, x + 40 * fx, y - 40 * fy, ink('--bad'), 3);
  }

  cross(pen, x, y, r) {
    pen.strokeStyle = ink('--bad'); pen.lineWidth = 1.5;
    pen.beginPath(); pen.moveTo(x - r / 2, y - r / 2); pen.lineTo(x + r / 2, y + r / 2);
    pen.moveTo(x - r / 2, y + r / 2); pen.lineTo(x + r / 2, y - r / 2); pen.stroke();
  }

  arrow(pen, x0, y0, x1, y1, stroke, width) {
    const length = Math.hypot(x1 - x0, y1 - y0);
    if (!(length > 2)) return;
    const turn = Math.atan2(y1 - y0, x1 - x0), head = Math.min(8, length / 2);
    pen.strokeStyle = stroke; pen.lineWidth = width;
    pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(x1, y1);
    for (const side of [2.6, -2.6]) { pen.moveTo(x1, y1); pen.lineTo(x1 + head * Math.cos(turn + side), y1 + head * Math.sin(turn + side)); }
    pen.stroke();
  }

  drawForce() {
    const [pen, w, h] = fit(this.force), left = 44, bottom = 18, top = 20, now = this.frame.t;
    const shown = [0, 1, 2].filter((k) => this.history.some((p) => p.force[k] !== null));
    let low = 0, high = 0.1;
    for (const p of this.history) for (const k of shown) if (p.force[k] !== null) {
      const s = Math.min(2 * (p.sigma[k] ?? 0), Math.abs(p.force[k]) + 1);
      low = Math.min(low, p.force[k] - s); high = Math.max(high, p.force[k] + s);
    }
    const x = (t) => left + (w - left - 8) * (1 + (t - now) / SPAN), y = (v) => top + (h - bottom - top) * (high - v) / (high - low);
    pen.font = '12px system-ui'; pen.fillStyle = ink('--soft'); pen.strokeStyle = ink('--line'); pen.lineWidth = 1;
    for (const v of new Set([low, 0, high])) {
      pen.beginPath(); pen.moveTo(left, y(v)); pen.lineTo(w - 8, y(v)); pen.stroke();
      if (v === 0 || Math.abs(y(v) - y(0)) > 14) pen.fillText(`${short(v, 2)} N`, 2, Math.min(y(v) + 4, h - bottom));
    }
    pen.fillText('−10 s', left, h - 4); pen.fillText('now', w - 32, h - 4);
    if (!shown.length) { pen.fillText('no force is estimated', left + 40, h / 2); return; }
    shown.forEach((k, place) => {
      const points = this.history.filter((p) => p.force[k] !== null), stroke = ink(['--x', '--y', '--z'][k]);
      pen.fillStyle = stroke; pen.globalAlpha = 0.18; pen.beginPath();
      const edge = (p, sign) => pen.lineTo(x(p.t), Math.min(Math.max(y(p.force[k] + sign * 2 * (p.sigma[k] ?? 0)), top), h - bottom));
      points.forEach((p) => edge(p, 1)); [...points].reverse().forEach((p) => edge(p, -1)); pen.fill();
      pen.globalAlpha = 1; pen.strokeStyle = stroke; pen.lineWidth = 1.8; pen.beginPath();
      points.forEach((p) => pen.lineTo(x(p.t), y(p.force[k]))); pen.stroke();
      const f = this.frame.force[k], s = this.frame.sigma[k];
      const narrow = w < left + 3 * 124, digits = s !== null && s < 0.01 ? 3 : 2;
      pen.fillText(`F${'xyz'[k]} ${f === null ? '–' : f.toFixed(digits)}${s === null || narrow ? '' : ` ± ${short(s, 1)}`}`, left + 6 + place * (narrow ? 70 : 124), 13);
    });
  }

  async askTare() {
    const answer = await fetch('tare', { method: 'POST', body: new URLSearchParams({ name: this.name }) });
    note.textContent = await answer.text();
    answered = performance.now();
  }
}

function drawGuide() {
  const root = document.getElementById('guide');
  root.hidden = !guide;
  if (!guide) return;
  const done = guide.targets.filter((one) => one[2]).length, bar = root.querySelector('progress');
  root.className = guide.phase;
  root.querySelector('.what').textContent = guide.text;
  if (guide.targets.length) { bar.max = guide.targets.length; bar.value = done; } else bar.removeAttribute('value');
  root.querySelector('.error').textContent = guide.error;
}

function drawGrips(grips) {
  const root = document.getElementById('grips'), names = Object.keys(grips);
  if (!names.length) return;
  const table = document.createElement('table'), row = (cells, kind) => {
    const line = table.insertRow();
    for (const text of cells) { const cell = document.createElement(kind); cell.textContent = text; line.append(cell); }
  };
  const phases = ['idle', 'close', 'touch', 'load', 'hold', 'release', 'fault'];
  for (const name of names) {
    const grip = grips[name];
    row([`grip ${name}`, phases[grip.phase] ?? grip.phase, grip.limited ? 'limited' : '', grip.refusal], 'th');
    const fingers = Object.keys(grip).filter((key) => key.endsWith('_target_force')).map((key) => key.slice(0, -13));
    for (const f of fingers) row([f, `${short(grip[`${f}_force`])} N of ${short(grip[`${f}_target_force`])} N`, `slip margin ${short(grip[`${f}_slip_margin`], 2)}`, ''], 'td');
  }
  root.replaceChildren(table);
}

const events = new EventSource('events');
events.addEventListener('layouts', (message) => {
  const data = JSON.parse(message.data);
  control = data.control;
  for (const [name, layout] of Object.entries(data.sensors)) {
    if (cards.has(name)) cards.get(name).take(layout);
    else cards.set(name, new Card(name, layout));
  }
  document.getElementById('sensors').append(...[...cards.keys()].sort().map((name) => cards.get(name).root));
});
events.addEventListener('frames', (message) => {
  waiting = JSON.parse(message.data); heard = performance.now();
  for (const [name, frame] of Object.entries(waiting.sensors)) cards.get(name)?.hear(frame);
});
events.addEventListener('end', () => { events.close(); note.textContent = 'the command has ended'; });
events.onerror = () => { note.textContent = 'connection lost; trying again …'; };

function paint() {
  if (waiting) {
    guide = waiting.guide;
    drawGuide();
    for (const card of cards.values()) card.draw();
    drawGrips(waiting.grips);
    if (performance.now() - answered > ANSWER_MS) note.textContent = control ? 'key T tares all sensors' : '';
    waiting = null;
  } else if (performance.now() - heard > 1000 && events.readyState === 1) {
    note.textContent = cards.size ? 'no new frames for a second' : 'waiting for the first frame …';
  }
  requestAnimationFrame(paint);
}
requestAnimationFrame(paint);
window.addEventListener('resize', () => cards.forEach((card) => card.draw()));
window.addEventListener('keydown', (key) => {
  if (control && key.key.toLowerCase() === 't' && !key.repeat && !key.ctrlKey && !key.metaKey) cards.forEach((card) => card.askTare());
});
