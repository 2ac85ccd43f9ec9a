// Copyright 2026 p4pfr_ros maintainers. SPDX-License-Identifier: Apache-2.0

// The page asks for the next message as soon as it has shown the last one, so that a slow
// connection skips images instead of delaying them.

'use strict';

const $ = (id) => document.getElementById(id);
const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
const AXES = { x: '#ff4d4d', y: '#3ddc84', z: '#4da3ff' };
const CORNER = '#00d5f2', OUTLINE = '#00a8c6', TARGET = '#ffb000', THERE = '#3ddc84';
const RETRY_MS = 1000, RATE_MS = 2000, TOAST_MS = 6000;

let maps = null;        // of the camera's last change
let mapsVersion = -1;
let last = null;        // the last state
let arrivals = [];      // times of the last messages
let updates = 0;

// --- connection ---------------------------------------------------------------------------

function connect() {
  const socket = new WebSocket(new URL('updates', location.href.replace(/^http/, 'ws')));
  socket.binaryType = 'arraybuffer';
  const ask = (sequence) => socket.send(JSON.stringify({ sequence, maps: mapsVersion }));
  socket.onopen = () => {
    $('offline').hidden = true;
    mapsVersion = -1;
    ask(-1);
  };
  socket.onmessage = async (event) => {
    const [state, raw, straight] = parts(event.data);
    await show(state, raw, straight);
    if (socket.readyState === WebSocket.OPEN) ask(state.sequence);
  };
  socket.onclose = () => {
    $('offline').hidden = false;
    setTimeout(connect, RETRY_MS);
  };
}

function parts(buffer) {
  const view = new DataView(buffer);
  const lengths = [0, 4, 8].map((at) => view.getUint32(at));
  let at = 12;
  const [text, raw, straight] = lengths.map((length) => buffer.slice(at, at += length));
  return [JSON.parse(new TextDecoder().decode(text)), raw, straight];
}

async function command(name) {
  try {
    const response = await fetch(name, { method: 'POST' });
    const answer = response.headers.get('Content-Type').startsWith('application/json')
      ? (await response.json()).message : await response.text();
    toast(answer);
  } catch {
    toast('no connection to the program');
  }
}

let toastTimer = 0;
function toast(words) {
  $('toast').textContent = words;
  $('toast').classList.add('shown');
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => $('toast').classList.remove('shown'), TOAST_MS);
}

// --- one message --------------------------------------------------------------------------

async function show(state, raw, straight) {
  last = state;
  if (state.maps) {
    maps = state.maps;
    mapsVersion = state.mapsVersion;
  }
  const [image, pinhole] = await Promise.all([raw, straight].map(bitmap));
  showHeader(state);
  showRaw(state, image);
  showPinhole(pinhole);
  showAdvice(state);
  showBars(state);
  showRejected(state);
  if (state.maps) showMaps(state);
  const now = performance.now();
  arrivals = [...arrivals.filter((time) => now - time < RATE_MS), now];
  document.body.dataset.updates = ++updates;
  document.body.dataset.rateHz = (arrivals.length / (RATE_MS / 1000)).toFixed(1);
}

function bitmap(data) {
  return data.byteLength ? createImageBitmap(new Blob([data], { type: 'image/jpeg' })) : null;
}

function showHeader(state) {
  const { source, paused } = state;
  const words = {
    waiting: `waiting for ${source.name || 'images'}`,
    running: source.name,
    ended: `${source.name}: end of the images`,
    failed: `${source.name}: ${source.detail}`,
  }[source.state];
  const image = state.image.number ? ` · image ${state.image.number}` : '';
  text($('source'), words + image);
  text($('state'), state.state);
  $('state').className = `chip ${state.state}`;
  $('state').title = state.stateText;
  const isRunning = source.state === 'running' && !paused;
  text($('rate'), paused ? 'paused' : isRunning ? `${state.rateHz.toFixed(1)} Hz` : source.state);
  text($('pause'), paused ? 'Resume' : 'Pause');
  $('pause').setAttribute('aria-pressed', paused);
  const hasCamera = state.bars.some((bar) => bar.value && bar.key === 'focal');
  $('save').disabled = !hasCamera;
  $('download').hidden = !hasCamera;
  document.title = `${state.state} · Camera calibration`;
}

// --- images -------------------------------------------------------------------------------

/** Size a canvas for the screen's pixels; return its context, scaled to units of the image. */
function prepared(canvas, [width, height]) {
  canvas.style.aspectRatio = `${width} / ${height}`;
  const shown = Math.round(canvas.clientWidth * (window.devicePixelRatio || 1)) || width;
  canvas.width = shown;
  canvas.height = Math.round(shown * height / width);
  const context = canvas.getContext('2d');
  context.scale(shown / width, shown / width);
  return [context, width / (canvas.clientWidth || width)];
}

function showRaw(state, image) {
  $('raw-empty').hidden = Boolean(image);
  if (!image) return;
  const [context, px] = prepared($('raw'), state.size);
  context.drawImage(image, 0, 0, ...state.size);
  context.translate(0.5, 0.5);  // pixel centres are integers
  context.lineJoin = context.lineCap = 'round';
  const isThere = state.advice !== null && state.advice.length === 0;
  drawTarget(context, px, isThere);
  for (const board of state.boards) {
    for (const line of board.lines.outline || []) stroke(context, line, OUTLINE, 2 * px);
    context.strokeStyle = CORNER;
    context.lineWidth = 1.5 * px;
    for (let i = 0; i < board.points.length; i += 2) {
      context.beginPath();
      context.arc(board.points[i], board.points[i + 1], 3.5 * px, 0, 2 * Math.PI);
      context.stroke();
    }
    for (const axis of ['x', 'y', 'z']) {
      for (const line of board.lines[axis] || []) stroke(context, line, AXES[axis], 4 * px);
    }
  }
  if (maps?.target && state.boards[0]?.lines.outline && !isThere) {
    drawArrow(context, px, middle(state.boards[0].lines.x), middle(maps.target.lines.x));
  }
  const described = state.boards.map((board) => board.reason || board.verdict).join('; ');
  $('raw').setAttribute('aria-label', `Live image: ${described}`);
}

function drawTarget(context, px, isThere) {
  if (!maps?.target) return;
  const colour = isThere ? THERE : TARGET;
  context.save();
  for (const line of maps.target.lines.outline) {
    path(context, line);
    context.closePath();
    context.globalAlpha = 0.14;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
    context.setLineDash([]);
    stroke(context, line, 'rgb(0 0 0 / 55%)', 5 * px);
    context.setLineDash(isThere ? [] : [9 * px, 6 * px]);
    stroke(context, line, colour, 2.5 * px);
  }
  context.restore();
}

function drawArrow(context, px, from, to) {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const length = Math.hypot(dx, dy);
  if (!(length > 40 * px)) return;
  const [ux, uy] = [dx / length, dy / length];
  const tip = (side) => [
    to[0] - 13 * px * ux - side * 8 * px * uy, to[1] - 13 * px * uy + side * 8 * px * ux,
  ];
  for (const [colour, width] of [['rgb(0 0 0 / 55%)', 6], [TARGET, 3]]) {
    stroke(context, [...from, ...to], colour, width * px);
    stroke(context, [...tip(1), ...to, ...tip(-1)], colour, width * px);
  }
}

/** The origin of the board's frame: its axes begin there. */
const middle = (lines) => (lines.length ? lines[0].slice(0, 2) : [NaN, NaN]);

function path(context, line) {
  context.beginPath();
  for (let i = 0; i < line.length; i += 2) context.lineTo(line[i], line[i + 1]);
}

function stroke(context, line, colour, width) {
  path(context, line);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

function showPinhole(image) {
  $('pinhole-empty').hidden = Boolean(image);
  const canvas = $('pinhole');
  if (!image) {
    canvas.getContext('2d').clearRect(0, 0, canvas.width, canvas.height);
    return;
  }
  const [context] = prepared(canvas, [image.width, image.height]);
  context.drawImage(image, 0, 0);
}

// --- words --------------------------------------------------------------------------------

/** Set a text only if it differs, so that screen readers read changes alone. */
function text(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

const sentence = (words) => words.charAt(0).toUpperCase() + words.slice(1);

function showAdvice(state) {
  const isRunning = state.source.state === 'running' && !state.paused;
  const isThere = state.advice !== null && state.advice.length === 0;
  let words = 'Show the whole board to the camera.', then = '';
  if (state.paused) words = 'Paused: images are not used.';
  else if (!isRunning && state.source.state !== 'waiting') words = 'No more images.';
  else if (state.advice !== null) {
    words = isThere ? 'Here. Hold still.' : sentence(state.advice[0]);
    then = state.advice.slice(1).map((each) => `then ${each}`).join(', ');
  }
  text($('advice-first'), words);
  text($('advice-then'), then);
  $('advice').classList.toggle('there', isThere && isRunning);
  const target = maps?.target ? `Target: ${maps.target.words}.` : '';
  const isCalibrated = state.state === 'calibrated';
  text($('advice-target'), (isCalibrated ? 'More views still make the camera better. ' : '') + target);
  const missing = isCalibrated ? ['nothing: the camera is calibrated'] : state.missing;
  list($('missing'), missing.map((each) => ({ words: each, kind: isCalibrated ? 'done' : '' })));
}

function list(element, items) {
  const key = JSON.stringify(items);
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  element.replaceChildren(...items.map(({ words, kind, note }) => {
    const item = document.createElement('li');
    item.textContent = words;
    item.className = kind || '';
    if (note) {
      const small = document.createElement('small');
      small.textContent = note;
      item.append(small);
    }
    return item;
  }));
}

function showRejected(state) {
  const items = state.rejected.map((each) => ({
    words: (each.board ? `${each.board}: ` : '') + each.reason + (each.count > 1 ? ` (${each.count} times)` : ''),
    note: `${each.count > 1 ? 'last: ' : ''}${each.name}`,
  }));
  list($('rejected'), items.length ? items : [{ words: 'none so far', kind: 'quiet' }]);
}

function showBars(state) {
  for (const bar of state.bars) {
    const element = $(`bar-${bar.key}`) || newBar(bar);
    element.classList.toggle('reached', bar.reached);
    const note = bar.key === 'views' ? (bar.reached ? 'enough' : 'more needed')
      : !bar.sigma ? 'unknown'
        : `${bar.key === 'distortion' ? 'projection ' : ''}σ ${bar.sigma}, tolerance ${bar.tolerance}`;
    text(element.querySelector('.value'), bar.value || '–');
    text(element.querySelector('.note'), note);
    element.querySelector('.fill').style.width = `${100 * bar.share}%`;
    const track = element.querySelector('.track');
    track.setAttribute('aria-valuenow', Math.round(100 * bar.share));
    track.setAttribute('aria-valuetext', `${bar.value || 'unknown'}, ${note}`);
  }
}

function newBar(bar) {
  const element = document.createElement('div');
  element.id = `bar-${bar.key}`;
  element.className = 'bar';
  element.innerHTML = `<div class="line"><span class="label"></span><span class="value"></span></div>
    <div class="track" role="progressbar" aria-valuemin="0" aria-valuemax="100"><div class="fill"></div></div>
    <div class="note"></div>`;
  element.querySelector('.label').textContent = bar.label;
  element.querySelector('.track').setAttribute('aria-label', bar.label);
  $('bars').append(element);
  return element;
}

// --- maps ---------------------------------------------------------------------------------

function showMaps(state) {
  const label = (name) => (maps.boards.length > 1 ? `board ${name}` : 'board');
  const rows = [...maps.camera, ...maps.boards.map(([name, words]) => [label(name), words])];
  $('camera').replaceChildren(...rows.flatMap(([name, words]) => [
    Object.assign(document.createElement('dt'), { textContent: name }),
    Object.assign(document.createElement('dd'), { textContent: words }),
  ]));
  const size = state.size || [4, 3];
  showCoverage(size);
  showUncertainty(size, state.bars.find((bar) => bar.key === 'distortion'));
  showCourse();
}

function showCoverage(size) {
  const [context, px] = prepared($('coverage'), size);
  const seen = maps.coverage;
  let share = 0;
  if (seen) {
    const [width, height] = [size[0] / seen.columns, size[1] / seen.rows];
    context.fillStyle = css('--seen');
    context.globalAlpha = 0.28;
    seen.seen.forEach((isSeen, i) => {
      if (!isSeen) return;
      share += 1 / seen.seen.length;
      context.fillRect((i % seen.columns) * width, Math.floor(i / seen.columns) * height, width, height);
    });
  }
  context.globalAlpha = 1;
  context.fillStyle = css('--seen');
  for (let i = 0; i < maps.points.length; i += 2) {
    context.fillRect(maps.points[i] - px, maps.points[i + 1] - px, 2 * px, 2 * px);
  }
  const words = `Coverage: points in ${Math.round(100 * share)} % of the image`;
  caption($('coverage-text'), words, '');
  $('coverage').setAttribute('aria-label', words);
}

function showUncertainty(size, bar) {
  const [context] = prepared($('uncertainty'), size);
  const map = maps.uncertainty;
  if (!map) {
    caption($('uncertainty-text'), 'Projection uncertainty', ': unknown yet');
    return;
  }
  const most = 2 * parseFloat(bar.tolerance);
  // One pixel for each cell, enlarged smoothly.
  const small = new OffscreenCanvas(map.columns, map.rows);
  const cells = small.getContext('2d');
  map.px.forEach((sigma, i) => {
    if (sigma === null) return;  // the lens sees nothing there
    cells.fillStyle = colour(sigma / most);
    cells.fillRect(i % map.columns, Math.floor(i / map.columns), 1, 1);
  });
  context.drawImage(small, 0, 0, ...size);
  caption($('uncertainty-text'), 'Projection uncertainty', `: ${bar.sigma} at most where seen`);
  $('uncertainty-text').append(scale(['0', `tolerance ${bar.tolerance}`, `≥ ${most} px`]));
  $('uncertainty').setAttribute(
    'aria-label', `Map of projection uncertainty: ${bar.sigma} at most where points were seen`,
  );
}

function caption(element, words, more) {
  const rest = Object.assign(document.createElement('span'), { textContent: more });
  element.replaceChildren(words, rest);
}

function scale(labels) {
  const element = document.createElement('div');
  element.innerHTML = '<div class="ramp"></div><div class="scale"></div>';
  element.lastChild.append(...labels.map(
    (label) => Object.assign(document.createElement('span'), { textContent: label }),
  ));
  return element;
}

function colour(share) {
  const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1);
  const i = Math.min(Math.floor(at), VIRIDIS.length - 2);
  const mixed = VIRIDIS[i].map((from, c) => Math.round(from + (at - i) * (VIRIDIS[i + 1][c] - from)));
  return `rgb(${mixed.join(' ')})`;
}

function showCourse() {
  const canvas = $('course');
  if (!canvas.clientWidth || !maps) return;  // folded
  const ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  const context = canvas.getContext('2d');
  context.scale(ratio, ratio);
  const course = maps.course;
  if (course.length < 2) return;
  const [left, right, top, bottom] = [52, canvas.clientWidth - 6, 6, canvas.clientHeight - 18];
  const late = course.slice(Math.floor(course.length / 3));
  const low = Math.min(...late.map(([, f, s]) => f - 2 * s));
  const high = Math.max(...late.map(([, f, s]) => f + 2 * s));
  const first = course[0][0], end = course[course.length - 1][0];
  const x = (number) => left + (right - left) * (number - first) / (end - first);
  const y = (f) => bottom - (bottom - top) * (Math.min(Math.max(f, low), high) - low) / (high - low);
  context.fillStyle = css('--seen');
  context.globalAlpha = 0.22;
  path(context, [
    ...course.flatMap(([n, f, s]) => [x(n), y(f + s)]),
    ...[...course].reverse().flatMap(([n, f, s]) => [x(n), y(f - s)]),
  ]);
  context.fill();
  context.globalAlpha = 1;
  stroke(context, course.flatMap(([n, f]) => [x(n), y(f)]), css('--seen'), 1.6);
  context.fillStyle = css('--quiet');
  context.font = '11px system-ui, sans-serif';
  context.fillText(high.toFixed(1), 4, top + 9);
  context.fillText(low.toFixed(1), 4, bottom);
  context.fillText(`image ${first}`, left, bottom + 14);
  context.textAlign = 'right';
  context.fillText(`image ${end}`, right, bottom + 14);
}

function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name);
}

// --- begin --------------------------------------------------------------------------------

$('save').onclick = () => command('save');
$('pause').onclick = () => command(`pause?on=${!last?.paused}`);
$('reset').onclick = () => $('confirm').showModal();
$('keep').onclick = () => $('confirm').close();
$('drop').onclick = () => {
  $('confirm').close();
  command('reset');
};
document.querySelector('details').ontoggle = showCourse;
const redraw = () => { if (last && maps) showMaps(last); };
window.addEventListener('resize', redraw);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
connect();
