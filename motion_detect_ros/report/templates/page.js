'use strict';

const $ = id => document.getElementById(id);

function bytesOf(id) {
  const text = atob($(id).textContent.trim()), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function inflated(id) {
  const stream = new Blob([bytesOf(id)]).stream().pipeThrough(new DecompressionStream('gzip'));
  return await new Response(stream).text();
}

/* The film: frame numbers here count its own pictures; data.film says which frames of the input they are. */
class Player {
  constructor(data) {
    this.data = data;
    this.frame = 0;
    this.chosen = null;
    this.listeners = [];
    this.video = $('video');
    this.canvas = $('overlay');
    this.video.src = URL.createObjectURL(new Blob([bytesOf('film-bytes')], {type: 'video/webm'}));
    this.video.addEventListener('loadeddata', () => this.show(0));
    this.video.addEventListener('play', () => this.playing());
    this.video.addEventListener('pause', () => this.playing());
    if (this.video.requestVideoFrameCallback) {
      const next = (_, meta) => {
        this.show(Math.round(meta.mediaTime * data.film.fps));
        this.video.requestVideoFrameCallback(next);
      };
      this.video.requestVideoFrameCallback(next);
    } else {
      for (const event of ['timeupdate', 'seeked']) {
        this.video.addEventListener(event, () => this.show(Math.floor(this.video.currentTime * data.film.fps)));
      }
    }
    $('play').addEventListener('click', () => this.toggle());
    $('back').addEventListener('click', () => this.step(-1));
    $('ahead').addEventListener('click', () => this.step(1));
    $('speed').addEventListener('change', () => { this.video.playbackRate = Number($('speed').value); });
    $('full').addEventListener('click', () => document.fullscreenElement ?
      document.exitFullscreen() : $('film').requestFullscreen());
    $('scrub').addEventListener('input', () => this.seekFrame(Number($('scrub').value)));
    for (const box of document.querySelectorAll('.controls input')) box.addEventListener('change', () => this.draw());
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    document.addEventListener('keydown', event => this.key(event));
  }

  key(event) {
    if (event.target.closest('input, select, button, summary, tr, figure') || event.ctrlKey || event.metaKey) return;
    const action = {' ': () => this.toggle(), ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1)}[event.key];
    if (action) { event.preventDefault(); action(); }
  }

  toggle() { if (this.video.paused) this.video.play(); else this.video.pause(); }

  playing() {
    $('play').textContent = this.video.paused ? '▶ Play' : '❚❚ Pause';
  }

  step(by) { this.video.pause(); this.seekFrame(this.frame + by); }

  seekFrame(frame) {
    const last = this.data.film.seconds.length - 1;
    frame = Math.max(0, Math.min(last, frame));
    this.video.currentTime = (frame + 0.5) / this.data.film.fps;
    this.show(frame);
  }

  /* seconds: of the recording, from its first frame */
  seek(seconds) {
    const times = this.data.film.seconds;
    let low = 0, high = times.length - 1;
    while (low < high) {  // the last picture that is not later
      const middle = Math.ceil((low + high) / 2);
      if (times[middle] <= seconds + 1e-6) low = middle; else high = middle - 1;
    }
    this.seekFrame(low);
  }

  show(frame) {
    this.frame = Math.max(0, Math.min(this.data.film.seconds.length - 1, frame));
    const seconds = this.data.film.seconds[this.frame];
    $('scrub').value = this.frame;
    $('now').textContent = `${seconds.toFixed(2)} s · frame ${this.data.film.frames[this.frame]}`;
    this.draw();
    for (const listener of this.listeners) listener(seconds);
  }

  draw() {
    const ratio = window.devicePixelRatio || 1, place = this.video.getBoundingClientRect();
    if (!place.width) return;
    const canvas = this.canvas, [width, height] = this.data.film.size;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    const pen = canvas.getContext('2d');
    const scale = Math.min(place.width / width, place.height / height);  // bars above or beside, where there are any
    const left = (canvas.clientWidth - width * scale) / 2, top = (canvas.clientHeight - height * scale) / 2;
    pen.setTransform(ratio, 0, 0, ratio, left * ratio, top * ratio);
    if (this.data.truth && $('show-truth').checked) this.drawTruth(pen, scale);
    if ($('show-boxes').checked) for (const box of this.data.boxes[this.frame]) this.drawBox(pen, scale, box);
  }

  drawTruth(pen, scale) {
    pen.lineWidth = 1.5;
    for (const [x, y, w, h, counts, found] of this.data.truth[this.frame]) {
      pen.setLineDash(counts ? [] : [2, 3]);
      pen.strokeStyle = !counts ? 'rgba(255,255,255,0.5)' : found ? '#fff' : '#ff3b6b';
      pen.strokeRect(x * scale - 2, y * scale - 2, w * scale + 4, h * scale + 4);
    }
    pen.setLineDash([]);
  }

  drawBox(pen, scale, [id, x, y, w, h, velU, velV]) {
    const color = this.data.colors[id] || '#888', chosen = id === this.chosen;
    pen.strokeStyle = color;
    pen.lineWidth = chosen ? 4 : 2;
    pen.strokeRect(x * scale, y * scale, w * scale, h * scale);
    if (chosen) {
      pen.strokeStyle = '#fff';
      pen.lineWidth = 1;
      pen.strokeRect(x * scale - 3, y * scale - 3, w * scale + 6, h * scale + 6);
    }
    if ($('show-arrows').checked) this.drawArrow(pen, (x + w / 2) * scale, (y + h / 2) * scale, velU * scale / 2,
      velV * scale / 2, color);
    if (!$('show-ids').checked) return;
    const label = String(id % 100000);
    pen.font = '600 12px system-ui, sans-serif';
    const wide = pen.measureText(label).width + 6, above = y * scale > 16 ? y * scale - 16 : (y + h) * scale;
    pen.fillStyle = color;
    pen.fillRect(x * scale - 1, above, wide, 16);
    pen.fillStyle = '#fff';
    pen.fillText(label, x * scale + 2, above + 12.5);
  }

  drawArrow(pen, x, y, dx, dy, color) {
    const length = Math.hypot(dx, dy);
    if (!(length > 4)) return;
    const head = Math.min(7, length / 2), turn = Math.atan2(dy, dx);
    pen.strokeStyle = color;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(x, y);
    pen.lineTo(x + dx, y + dy);
    for (const side of [2.6, -2.6]) {
      pen.moveTo(x + dx, y + dy);
      pen.lineTo(x + dx + head * Math.cos(turn + side), y + dy + head * Math.sin(turn + side));
    }
    pen.stroke();
  }
}

/* The moment that the film shows, as a line on the charts that run over time. */
class Cursor {
  constructor(plots) {
    this.plots = plots.map(plot => ({plot, shapes: plot.layout.shapes || []}));
    this.waiting = false;
  }

  move(seconds) {
    this.seconds = seconds;
    if (this.waiting) return;
    this.waiting = true;
    setTimeout(() => { this.waiting = false; this.draw(); }, 120);
  }

  draw() {
    const line = {type: 'line', xref: 'x', yref: 'paper', x0: this.seconds, x1: this.seconds, y0: 0, y1: 1,
      line: {color: '#1f2a37', width: 1}};
    for (const {plot, shapes} of this.plots) Plotly.relayout(plot, {shapes: [...shapes, line]});
  }
}

/* One object is chosen at a time: in the table, on the timeline and in the film. */
class Choice {
  constructor(data, player, timeline) {
    Object.assign(this, {data, player, timeline});
    this.rows = new Map([...document.querySelectorAll('tr[data-object]')].map(row => [Number(row.dataset.object), row]));
  }

  /* scroll: the table to the object; otherwise, as it was chosen there, the timeline */
  choose(id, seconds, scroll) {
    for (const [other, row] of this.rows) row.classList.toggle('chosen', other === id);
    const row = this.rows.get(id);
    if (row && scroll) {
      const box = row.closest('.scroll');
      box.scrollTop = row.offsetTop - box.clientHeight / 2;
    }
    if (this.timeline) {
      const bars = this.timeline.data[0], width = bars.customdata.map(bar => bar[0] === id ? 2 : 0);
      Plotly.restyle(this.timeline, {'marker.line.width': [width], 'marker.line.color': '#1f2a37'});
      if (!scroll) {
        const box = this.timeline.parentNode, share = bars.y[width.indexOf(2)] / (this.rows.size || 1);
        box.scrollTop = share * box.scrollHeight - box.clientHeight / 2;
      }
    }
    if (this.player) {
      this.player.chosen = id;
      this.player.seek(seconds);
    }
  }
}

/* Where on the time axis of a chart the mouse is, s. */
function timeAt(plot, event) {
  const area = plot.querySelector('.nsewdrag').getBoundingClientRect(), [from, to] = plot.layout.xaxis.range;
  return from + (event.clientX - area.left) / area.width * (to - from);
}

async function draw(charts) {
  const plots = {}, config = {responsive: true, displaylogo: false, displayModeBar: 'hover',
    modeBarButtons: [['toImage', 'resetScale2d']]};
  for (const [name, chart] of Object.entries(charts)) {
    if ($(name)) plots[name] = await Plotly.newPlot($(name), chart.data, chart.layout, config);
  }
  return plots;
}

function clickable(elements, action) {
  for (const element of elements) {
    element.addEventListener('click', () => action(element));
    element.addEventListener('keydown', event => { if (event.key === 'Enter') action(element); });
  }
}

async function start() {
  const data = JSON.parse(await inflated('data'));
  const player = $('film-bytes') ? new Player(data) : null;
  const script = document.createElement('script');
  script.textContent = await inflated('plotly');
  document.head.append(script);
  const plots = await draw(data.charts);
  const choice = new Choice(data, player, plots.timeline);
  if (player) {
    const cursor = new Cursor(['timeline', 'ego', 'times', 'errors'].map(name => plots[name]).filter(Boolean));
    player.listeners.push(seconds => cursor.move(seconds));
    cursor.move(data.film.seconds[player.frame]);
    for (const name of ['ego', 'times', 'errors']) {
      if (plots[name]) plots[name].on('plotly_click', event => player.seek(event.points[0].x));
    }
    clickable(document.querySelectorAll('figure[data-seconds]'), figure => {
      player.seek(Number(figure.dataset.seconds));
      $('film').scrollIntoView({block: 'nearest'});
    });
  }
  if (plots.timeline) {
    plots.timeline.on('plotly_click', event => {
      const [id, from, to] = event.points[0].customdata;
      choice.choose(id, Math.max(from, Math.min(to, timeAt(plots.timeline, event.event))), true);
    });
    $('color-by').addEventListener('change', () =>
      Plotly.restyle(plots.timeline, {marker: [structuredClone(data.markers[$('color-by').value])]}));
  }
  clickable(document.querySelectorAll('tr[data-object]'), row =>
    choice.choose(Number(row.dataset.object), Number(row.dataset.seconds), false));
  document.body.dataset.ready = 'yes';
}

start().catch(error => {
  $('failure').textContent = `This page cannot show its charts here: ${error}. A browser of 2023 or later can.`;
  $('failure').hidden = false;
});
