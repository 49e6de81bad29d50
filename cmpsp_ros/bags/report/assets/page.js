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

/** Outlines of moving obstacles, predicted from when each was last seen. */
function outlines(bag, t) {
  const found = { x: [], y: [] };
  for (const each of bag.moving) {
    const k = latest(each.t, t);
    if (k < 0 || t - each.t[k] > bag.timeout) continue;
    for (let corner = 0; corner <= CORNERS; corner += 1) {
      const angle = (2 * Math.PI * corner) / CORNERS;
      const age = t - each.t[k];
      found.x.push(each.x[k] + age * each.vx[k] + each.radius[k] * Math.cos(angle));
      found.y.push(each.y[k] + age * each.vy[k] + each.radius[k] * Math.sin(angle));
    }
    found.x.push(null);
    found.y.push(null);
  }
  return found;
}

/** The goal that is driven to: since when, where, and in words. */
function goalAt(bag, t) {
  return bag.goals[Math.max(latest(bag.goalTimes, t), 0)];
}

function movePath(t) {
  const plans = { x: [], y: [] };
  const robots = { x: [], y: [], 'marker.angle': [] };
  const discs = { x: [], y: [] };
  const goals = { x: [], y: [] };
  for (const bag of data.bags) {
    const { x, y } = outlines(bag, t);
    discs.x.push(x);
    discs.y.push(y);
    const goal = goalAt(bag, t);
    goals.x.push(goal ? [goal[1]] : []);
    goals.y.push(goal ? [goal[2]] : []);
    const plan = bag.plans[latest(bag.planTimes, t)];
    plans.x.push(plan ? plan.x : []);
    plans.y.push(plan ? plan.y : []);
    const k = Math.max(latest(bag.t, t), 0);
    robots.x.push([bag.x[k]]);
    robots.y.push([bag.y[k]]);
    robots['marker.angle'].push(90 - (bag.heading[k] * 180) / Math.PI);
  }
  const count = data.bags.length;
  const traces = (first) => data.bags.map((_, index) => first + index);
  Plotly.restyle('path', plans, traces(count));
  Plotly.restyle('path', robots, traces(2 * count));
  Plotly.restyle('path', discs, traces(3 * count));
  Plotly.restyle('path', goals, traces(4 * count));
  showSeen(t);
}

/** What sensors had shown by then, below everything else. */
function showSeen(t) {
  if (!data.bags.some((bag) => bag.grids.length)) return;
  const images = [];
  for (const bag of data.bags) {
    const grid = bag.grids[latest(bag.gridTimes, t)];
    if (!grid) continue;
    const place = { x: grid.x, y: grid.y, sizex: grid.width, sizey: grid.height };
    const look = { xref: 'x', yref: 'y', sizing: 'stretch', layer: 'below' };
    images.push({ source: grid.source, ...place, ...look });
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
