'use strict';

// What comes from the server is text and numbers, and never becomes markup.
const ASK_PERIOD = 66;
const RETRY_PERIOD = 1000;
const SILENT_AFTER = 1.5;
const LEVELS = {
  nominal: '#009e73', elastic: '#b3a500', previous_plan: '#e69f00', stop: '#4d4d4d', arrived: '#0072b2',
};

const MOVING = '#b03a8c';

const known = {course: -1, run: -1, series: {path: [], steps: []}};
let latest = {};
let course = [];
let bounds = null;
let seen = null;
let arrival = '';

const element = (id) => document.getElementById(id);
const isNumber = (value) => typeof value === 'number';
const fixed = (value, digits, unit) => (isNumber(value) ? `${value.toFixed(digits)} ${unit}` : '–');
const signed = (value) => (isNumber(value) && value >= 0 ? '+' : '') + fixed(value, 3, 'm');
const several = (values, unit) =>
  Array.isArray(values) && values.every(isNumber) && values.length
    ? `${values.map((value) => value.toFixed(2)).join('  ')} ${unit}` : '–';

const isCar = () => isNumber((latest.decision || {}).steering_angle);

// Of a car the speed and the steering angle, of other robots the speed of each wheel.
function controls(wheels, angle) {
  if (!isCar() || !Array.isArray(wheels)) return several(wheels, 'rad/s');
  const speed = wheels[0] * (latest.robot || {})['robot.wheel_radius'];
  return fixed(speed, 2, 'm/s') + (isNumber(angle) ? `  ${fixed(angle, 3, 'rad')}` : '');
}

function say(id, text) {
  const place = element(id);
  if (place.textContent !== text) place.textContent = text;
}

async function ask() {
  const {path, steps} = known.series;
  const query = `course=${known.course}&run=${known.run}&path=${path.length}&steps=${steps.length}`;
  let pause = ASK_PERIOD;
  try {
    const answer = await fetch(`updates?${query}`);
    if (!answer.ok) throw new Error(answer.statusText);
    take(await answer.json());
    requestAnimationFrame(show);
  } catch {
    pause = RETRY_PERIOD;
    if (hasArrived()) state('The run is over. This is its last picture.', false);
    else state('The viewer does not answer. This is its last picture.', true);
  }
  setTimeout(ask, pause);
}

function take(updates) {
  latest = updates;
  if (latest.course_number !== known.course) {
    course = latest.course || [];
    bounds = null;
  }
  if (latest.run !== known.run) {
    bounds = null;
    arrival = '';
  }
  for (const [name, rows] of Object.entries(latest.series)) {
    known.series[name] = known.series[name].slice(0, latest.first[name]).concat(rows);
  }
  known.course = latest.course_number;
  known.run = latest.run;
}

function state(text, wrong) {
  say('state', text);
  element('state').className = wrong ? 'state wrong' : 'state';
}

function show() {
  const decision = latest.decision || {};
  const level = hasArrived() ? 'arrived' : decision.level || '';
  if (decision.level === 'arrived') arrival = decision.reason;
  const silent = isNumber(latest.silence) && latest.silence > SILENT_AFTER;
  if (!latest.decision) state('Listening; no decision has been received yet.', false);
  else if (hasArrived()) state('The run is over.', false);
  else if (silent) state(`No decision for ${Math.floor(latest.silence)} s.`, true);
  else state('Live.', false);
  say('level', level);
  element('level').dataset.level = level;
  say('namespace', latest.namespace === '/' ? '' : String(latest.namespace || ''));
  say('reason', (level === 'arrived' && arrival) || decision.reason || '');
  say('goal', goalOf(decision));
  say('time', fixed(decision.time, 1, 's'));
  say('time_left', fixed(decision.time_left, 1, 's'));
  say('clearance_now', signed(decision.clearance));
  say('worst_clearance', signed(decision.worst_clearance));
  say('terminal_error', fixed(decision.terminal_error, 3, 'm'));
  say('commanded', controls(decision.wheels, decision.steering_angle));
  say('driven', controls(latest.driven));
  loadSeen();
  say('step_ms', fixed(decision.step_ms, 2, 'ms'));
  drawCourse();
  drawStrips();
  Object.assign(document.body.dataset, {
    level, steps: known.series.steps.length, path: known.series.path.length, course: course.length,
    moving: (latest.moving || []).length, seen: seen ? seen.image.naturalWidth : 0,
  });
}

// A goal alone has no name in decisions: it is passed at the final time.
function goalOf({goal: name, goal_time: time}) {
  const {final_time: end, 'follow.speed': pace} = latest.robot || {};
  if (name) return isNumber(time) ? `${name} at ${time.toFixed(1)} s` : name;
  return end && pace === 0 ? `at ${end.toFixed(1)} s` : '–';
}

// The node stops once more when it is shut down after the goal; the run has arrived all the same.
function hasArrived() {
  const last = known.series.steps.findLast((step) => step[4] !== 'stop');
  return last !== undefined && last[4] === 'arrived';
}

function canvas(id) {
  const place = element(id);
  const ratio = window.devicePixelRatio || 1;
  const width = place.clientWidth;
  const height = place.clientHeight;
  if (place.width !== Math.round(width * ratio) || place.height !== Math.round(height * ratio)) {
    place.width = Math.round(width * ratio);
    place.height = Math.round(height * ratio);
  }
  const pen = place.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return {pen, width, height};
}

// The view holds all that matters, and only grows while a run lasts: it is not to jump about.
function include(x, y, around) {
  if (!isNumber(x) || !isNumber(y)) return;
  bounds = bounds || {left: x, right: x, low: y, high: y};
  bounds.left = Math.min(bounds.left, x - around);
  bounds.right = Math.max(bounds.right, x + around);
  bounds.low = Math.min(bounds.low, y - around);
  bounds.high = Math.max(bounds.high, y + around);
}

function look() {
  for (const each of course) {
    if (each.kind === 'disc') include(...each.at, 1.5 + each.size / 2);
    if (each.of === 'obstacles') for (const point of each.points) include(...point, 0.5);
  }
  for (const each of [...known.series.path, ...(latest.plan || [])]) include(...each, 1);
  if (latest.place) include(latest.place[0], latest.place[1], 1);
}

function trace(pen, points, to) {
  pen.beginPath();
  for (const each of points) if (each.every(isNumber)) pen.lineTo(...to(each));
}

function drawCourse() {
  const {pen, width, height} = canvas('course');
  look();
  if (!bounds) return;
  const scale = Math.min(
    width / (bounds.right - bounds.left || 1), height / (bounds.high - bounds.low || 1));
  const middle = [(bounds.left + bounds.right) / 2, (bounds.low + bounds.high) / 2];
  const to = ([x, y]) => [
    width / 2 + (x - middle[0]) * scale, height / 2 - (y - middle[1]) * scale];
  drawRoad(pen, to);
  drawSeen(pen, to, scale);
  for (const each of course) drawMarker(pen, each, to, scale);
  for (const each of latest.moving || []) drawMoving(pen, each, to, scale);
  explain('seen', seen);
  explain('moving', (latest.moving || []).length);
  drawGoal(pen, to);
  const level = LEVELS[(latest.decision || {}).level] || '#8a93a1';
  stroke(pen, known.series.path, to, '#0072b2', 3, []);
  if (!hasArrived()) stroke(pen, latest.plan || [], to, level, 2.5, [7, 5]);
  if (latest.place && latest.place.every(isNumber)) drawRobot(pen, latest.place, to, scale);
  drawScale(pen, scale);
}

// A bar of a round length, a fifth of the picture long at most, and the directions of the axes.
function drawScale(pen, scale) {
  const most = pen.canvas.clientWidth / 5 / scale;
  const power = 10 ** Math.floor(Math.log10(most));
  const length = power * [5, 2, 1].find((each) => each * power <= most);
  const end = 16 + length * scale;
  stroke(pen, [[16, 22], [16, 28], [end, 28], [end, 22]], (point) => point, '#1b1f27', 1.5, []);
  pen.fillStyle = '#1b1f27';
  pen.font = '12px system-ui, sans-serif';
  pen.textAlign = 'left';
  pen.textBaseline = 'bottom';
  pen.fillText(`${length} m, x to the right, y up`, 16, 20);
}

// One edge there, the other one back: so a road is filled where it crosses itself, too. Edges of a
// ring are lines of their own.
function drawRoad(pen, to) {
  pen.beginPath();
  course.filter((marker) => marker.of === 'road').forEach((each, edge) => {
    const points = each.points.filter((point) => point.every(isNumber)).map(to);
    const [first, last] = [points[0], points.at(-1)];
    const ring = first && Math.hypot(first[0] - last[0], first[1] - last[1]) < 1;
    if (edge % 2) points.reverse();
    if (ring) pen.moveTo(...points[0]);
    for (const point of points) pen.lineTo(...point);
    if (ring) pen.closePath();
  });
  pen.fillStyle = '#eef0f3';
  pen.fill();
}

// What sensors have shown: a picture is drawn once it has been read, with its own place.
function loadSeen() {
  const next = latest.seen;
  if (!next || (seen && seen.source === next.source && seen.x === next.x && seen.y === next.y)) return;
  const image = new Image();
  image.onload = () => { seen = {...next, image}; };
  image.src = next.source;
}

// The legend keeps what was there once.
function explain(name, there) {
  if (there) document.getElementById(`key_${name}`).hidden = false;
}

function drawSeen(pen, to, scale) {
  if (!seen) return;
  pen.imageSmoothingEnabled = false;
  pen.drawImage(seen.image, ...to([seen.x, seen.y]), seen.width * scale, seen.height * scale);
}

function drawMarker(pen, marker, to, scale) {
  const [r, g, b, a] = marker.color.map((part) => (isNumber(part) ? part : 0));
  const color = `rgb(${255 * r} ${255 * g} ${255 * b} / ${a})`;
  if (marker.kind === 'line') {
    const dashes = marker.of === 'centre_line' ? [10, 10] : [];
    stroke(pen, marker.points, to, color, Math.max(marker.size * scale, 1), dashes);
  } else if (marker.kind === 'disc' && marker.at.every(isNumber) && isNumber(marker.size)) {
    pen.beginPath();
    const least = marker.of === 'goal' ? 5 : 0;
    pen.arc(...to(marker.at), Math.max(Math.abs(marker.size / 2 * scale), least), 0, 2 * Math.PI);
    pen.fillStyle = color;
    pen.fill();
  } else if (marker.kind === 'text' && marker.at.every(isNumber)) {
    // Names of obstacles are in them, those of goals beside them.
    const beside = marker.of === 'goal_names';
    const [x, y] = to(marker.at);
    pen.fillStyle = beside ? '#1b1f27' : '#fff';
    pen.font = '600 14px system-ui, sans-serif';
    const wide = pen.measureText(marker.text).width;
    pen.textAlign = beside ? 'left' : 'center';
    pen.textBaseline = 'middle';
    const end = pen.canvas.clientWidth - wide - 4;
    pen.fillText(marker.text, beside ? Math.min(x + 12, end) : x, beside ? y - 14 : y);
  }
}

// A moving obstacle as the last plan knew it, where it may be, and where it will be a second later.
function drawMoving(pen, {at, size, doubt, to: there}, to, scale) {
  if (!at.every(isNumber) || !isNumber(size)) return;
  for (const [across, color] of [[doubt, `${MOVING}40`], [size, MOVING]]) {
    if (!isNumber(across)) continue;
    pen.beginPath();
    pen.arc(...to(at), Math.max(Math.abs(across / 2 * scale), 3), 0, 2 * Math.PI);
    pen.fillStyle = color;
    pen.fill();
  }
  if (there) stroke(pen, [at, there], to, MOVING, 2, []);
}

// A ring around the goal that is driven to.
function drawGoal(pen, to) {
  const {goal: name, goal_x: x, goal_y: y} = latest.decision || {};
  if (!name || !isNumber(x) || !isNumber(y)) return;
  pen.beginPath();
  pen.arc(...to([x, y]), 13, 0, 2 * Math.PI);
  pen.strokeStyle = '#1a9940';
  pen.lineWidth = 2.5;
  pen.stroke();
}

function stroke(pen, points, to, color, width, dashes) {
  trace(pen, points, to);
  pen.setLineDash(dashes);
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.lineJoin = 'round';
  pen.stroke();
  pen.setLineDash([]);
}

// Corners of a footprint as Nav2 writes it, on the screen: y is down there.
function cornersOf(text, scale) {
  const numbers = (text.match(/[-+]?[\d.]+(e[-+]?\d+)?/gi) || []).map(Number);
  const corners = [];
  for (let i = 0; i + 1 < numbers.length; i += 2) {
    corners.push([numbers[i] * scale, -numbers[i + 1] * scale]);
  }
  return corners;
}

function drawRobot(pen, place, to, scale) {
  const [x, y] = to(place);
  const corners = cornersOf((latest.robot || {})['robot.footprint'] || '', scale);
  const radius = corners.length ? 0 : ((latest.robot || {})['robot.radius'] || 0) * scale;
  pen.save();
  pen.translate(x, y);
  pen.rotate(-place[2]);
  pen.beginPath();
  if (corners.length) corners.forEach((corner) => pen.lineTo(...corner));
  else pen.arc(0, 0, radius, 0, 2 * Math.PI);
  pen.fillStyle = 'rgb(0 114 178 / 25%)';
  pen.fill();
  const size = Math.max(radius, 10);
  pen.beginPath();
  pen.moveTo(size, 0);
  pen.lineTo(-0.7 * size, 0.65 * size);
  pen.lineTo(-0.35 * size, 0);
  pen.lineTo(-0.7 * size, -0.65 * size);
  pen.closePath();
  pen.fillStyle = '#00456b';
  pen.fill();
  pen.restore();
}

const WHEELS = ['#0072b2', '#d55e00', '#009e73', '#cc79a7'];

// A step is (time, wheel speeds, clearance, fallback level): its last two places count from
// its end.
function drawStrips() {
  const steps = known.series.steps;
  const {'robot.max_wheel_speed': limit, 'robot.max_steering_angle': angle} = latest.robot || {};
  const column = (index) => steps.map((step) => [step[0], step.at(index)]);
  const wheels = steps.length ? steps[0].slice(1, -2) : [];
  document.querySelector('.wheels').hidden = wheels.length !== 2 || isCar();
  // Speed and steering angle have units of their own: parts of their limits have none.
  const parts = isCar() && limit && angle ? [limit, angle] : [];
  const scaled = (row, k) => row.map(([time, value]) => [time, value / (parts[k] || 1)]);
  const lines = wheels.map((_, k) => [scaled(column(k + 1), k), WHEELS[k % WHEELS.length]]);
  const marks = limit ? [limit] : [];
  drawStrip('wheels', lines, parts.length ? [1, -1] : marks);
  say('controls', parts.length
    ? 'Speed (blue) and steering angle (orange) commanded, as parts of their limits'
    : 'Wheel speeds commanded [rad/s]');
  drawStrip('clearance', [[column(-2), '#009e73']], [0]);
}

function drawStrip(id, lines, marks) {
  const {pen, width, height} = canvas(id);
  const rows = lines.flatMap(([row]) => row).filter((row) => row.every(isNumber));
  if (!rows.length) return;
  const values = [...rows.map((row) => row[1]), ...marks];
  const low = Math.min(...values);
  const high = Math.max(...values);
  const {time, time_left: left} = latest.decision || {};
  const end = isNumber(time) && isNumber(left) ? time + left : 0;
  const whole = Math.max(end, ...rows.map((row) => row[0])) || 1;
  const to = ([at, value]) => [
    40 + (width - 48) * at / whole, 8 + (height - 30) * (high - value) / (high - low || 1)];
  for (const mark of marks) stroke(pen, [[0, mark], [whole, mark]], to, '#a63d40', 1, [4, 4]);
  for (const [row, color] of lines) stroke(pen, row, to, color, 1.5, []);
  pen.fillStyle = '#5a6372';
  pen.font = '12px system-ui, sans-serif';
  pen.textAlign = 'right';
  pen.textBaseline = 'middle';
  const digits = high - low < 10 ? 2 : 0;
  for (const value of new Set([low, high])) pen.fillText(value.toFixed(digits), 36, to([0, value])[1]);
  for (const at of [0, whole]) pen.fillText(`${at.toFixed(0)} s`, Math.max(to([at, 0])[0], 56), height - 6);
}

// A picture is as large as the window was: it would be stretched, the last one for good.
addEventListener('resize', () => { drawCourse(); drawStrips(); });
ask();
