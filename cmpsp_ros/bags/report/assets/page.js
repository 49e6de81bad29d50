'use strict';

const data = JSON.parse(document.getElementById('data').textContent);
const slider = document.getElementById('time');
const CORNERS = 24;
const playing = { since: null, from: 0 };

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (each) => each.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).text();
}

/** Index of the last of some ascending times that is not after t, or -1. */
function latest(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** Lines of all that moves at a time, predicted from when each was last seen. */
function moved(tracks, t, shape) {
  const found = { x: [], y: [] };
  for (const each of tracks) {
    const k = latest(each.t, t);
    if (k < 0 || t - each.t[k] > each.timeout) continue;
    const age = t - each.t[k];
    const center = [each.x[k] + age * each.vx[k], each.y[k] + age * each.vy[k]];
    for (const [x, y] of shape(each, k, age)) {
      found.x.push(center[0] + x);
      found.y.push(center[1] + y);
    }
    found.x.push(null);
    found.y.push(null);
  }
  return found;
}

function circle(radius) {
  return Array.from({ length: CORNERS + 1 }, (_, corner) => {
    const angle = (2 * Math.PI * corner) / CORNERS;
    return [radius * Math.cos(angle), radius * Math.sin(angle)];
  });
}

const outline = (each, k) => circle(each.radius[k]);
const doubt = (sigmas) => (each, k, age) => circle(
  each.radius[k] + sigmas * (each.position_stddev[k] + age * each.velocity_stddev[k]));
const velocity = (each, k) => [[0, 0], [each.vx[k], each.vy[k]]];

/** A point of each robot on its path, as the last that is not after t. */
function placeAt(path, t) {
  const k = Math.max(latest(path.t, t), 0);
  return [path.x[k], path.y[k], path.heading[k]];
}

/** The lines of a robot, in its own frame, at a place; null is a gap between two of them. */
function placed([xs, ys], [x, y, heading]) {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return {
    x: xs.map((each, k) => (each === null ? null : x + c * each - s * ys[k])),
    y: xs.map((each, k) => (each === null ? null : y + s * each + c * ys[k])),
  };
}

/** The other robots, as far as they have set out by then. */
function othersAt(bag, t) {
  const found = { x: [], y: [] };
  for (const each of bag.others.filter((other) => other.t[0] <= t)) {
    const { x, y } = placed(bag.disc, placeAt(each, t));
    found.x.push(...x, null);
    found.y.push(...y, null);
  }
  return found;
}

/** The goal that is driven to: since when, where, and in words. */
function goalAt(bag, t) {
  return bag.goals[Math.max(latest(bag.goalTimes, t), 0)];
}

function movePath(t) {
  const x = [];
  const y = [];
  const filled = [];
  const fill = (bag, part, points) => {
    const is = (trace) => trace.meta && trace.meta.bag === bag && trace.meta.part === part;
    filled.push(data.figures.path.data.findIndex(is));
    x.push(points.x);
    y.push(points.y);
    return filled.at(-1);
  };
  const robots = [];
  const angles = [];
  data.bags.forEach((bag, number) => {
    const goal = goalAt(bag, t);
    const pose = placeAt(bag, t);
    fill(number, 'doubts', moved(bag.moving, t, doubt(bag.sigmas)));
    fill(number, 'moving', moved(bag.moving, t, outline));
    fill(number, 'velocities', moved(bag.moving, t, velocity));
    fill(number, 'people', moved(bag.people, t, outline));
    fill(number, 'others', othersAt(bag, t));
    fill(number, 'plan', bag.plans[latest(bag.planTimes, t)] || { x: [], y: [] });
    fill(number, 'driven to', goal ? { x: [goal[1]], y: [goal[2]] } : { x: [], y: [] });
    fill(number, 'body', placed(bag.body, pose));
    robots.push(fill(number, 'robot', { x: [pose[0]], y: [pose[1]] }));
    angles.push([90 - (pose[2] * 180) / Math.PI]);
  });
  Plotly.restyle('path', { x, y }, filled);
  Plotly.restyle('path', { 'marker.angle': angles }, robots);
  showSeen(t);
}

/** What sensors had shown by then. */
function showSeen(t) {
  if (!data.bags.some((bag) => bag.grids.length)) return;
  const images = [];
  for (const bag of data.bags) {
    const grid = bag.grids[latest(bag.gridTimes, t)];
    if (!grid) continue;
    const place = { x: grid.x, y: grid.y, sizex: grid.width, sizey: grid.height };
    const look = { sizing: 'stretch', layer: 'above', opacity: 0.55 };
    const on = { xref: `x${bag.axes}`, yref: `y${bag.axes}` };
    images.push({ source: grid.source, ...place, ...look, ...on });
  }
  Plotly.relayout('path', { images });
}

function moveCursors(t) {
  for (const [name, figure] of Object.entries(data.figures)) {
    if (figure.layout.meta) Plotly.relayout(name, { 'shapes[0].x0': t, 'shapes[0].x1': t });
  }
}

function paragraph(text, kind) {
  const element = document.createElement('p');
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

function say(t) {
  const said = document.getElementById('said');
  said.replaceChildren();
  for (const bag of data.bags) {
    const decision = bag.decisions[latest(bag.decisionTimes, t)];
    const k = latest(bag.clearance.t, t);
    const clearance = k < 0 ? null : bag.clearance.value[k];
    const parts = [bag.label];
    if (decision) parts.push(decision[1]);
    if (goalAt(bag, t)) parts.push(`to ${goalAt(bag, t)[3]}`);
    if (clearance !== null) parts.push(`clearance ${clearance.toFixed(3)} m`);
    said.append(paragraph(parts.join(' · '), 'bag'));
    said.append(paragraph(decision ? decision[2] : 'No decision is recorded for this time.'));
  }
}

function show(t) {
  document.getElementById('now').value = `${t.toFixed(2)} s`;
  movePath(t);
  moveCursors(t);
  say(t);
}

function go(t) {
  slider.value = t;
  show(Number(slider.value));
}

function link() {
  location.replace(`#t=${Number(slider.value)}`);
}

function stop() {
  if (playing.since !== null) link();
  playing.since = null;
  document.getElementById('play').textContent = 'Play';
}

function tick(now) {
  if (playing.since === null) return;
  const t = playing.from + (now - playing.since) / 1000;
  go(t);
  if (t < Number(slider.max)) requestAnimationFrame(tick);
  else stop();
}

function toggle() {
  if (playing.since !== null) return stop();
  const t = Number(slider.value);
  playing.from = t < Number(slider.max) ? t : 0;
  playing.since = performance.now();
  document.getElementById('play').textContent = 'Pause';
  requestAnimationFrame(tick);
}

/** A link may end in the time that it is about, as in report.html#t=3.2. */
function goToLink() {
  const found = /^#t=([0-9.]+)$/.exec(location.hash);
  go(found ? Number(found[1]) : 0);
}

async function begin() {
  const library = document.createElement('script');
  library.textContent = await unpack(document.getElementById('library').textContent);
  document.head.append(library);
  for (const bag of data.bags) {
    bag.planTimes = bag.plans.map((each) => each.t);
    bag.gridTimes = bag.grids.map((each) => each.t);
    bag.decisionTimes = bag.decisions.map((each) => each[0]);
    bag.goalTimes = bag.goals.map((each) => each[0]);
  }
  const options = {
    responsive: true,
    displaylogo: false,
    // On a phone the buttons would lie over legends; two fingers zoom there.
    displayModeBar: window.innerWidth > 600,
    modeBarButtonsToRemove: ['lasso2d', 'select2d'],
  };
  await Promise.all(
    Object.entries(data.figures).map(([name, figure]) =>
      Plotly.newPlot(name, figure.data, figure.layout, options),
    ),
  );
  goToLink();
  // Let go, the slider leaves its time in the address, to be copied.
  slider.addEventListener('change', link);
  slider.addEventListener('input', () => {
    stop();
    show(Number(slider.value));
  });
  document.getElementById('play').addEventListener('click', toggle);
  window.addEventListener('hashchange', goToLink);
  document.body.dataset.ready = 'true';
}

begin();
