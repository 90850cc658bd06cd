// Every run of every camera, and the control charts of one.
import {card, draw as svg, figure, make, show, table} from './dom.js';
import {look, session} from './server.js';
import {text} from './strings.js';

const wanted = {camera: '', station: '', outcome: ''};
let runs = null, cameras = null, choices = {camera: [], station: []}, charts = null, trouble = '', asked = '';

const tone = {PASS: 'good', FAIL: 'bad', INCONCLUSIVE: 'unsure', ERROR: 'bad'};

function query() {
  return new URLSearchParams(Object.entries(wanted).filter(([, value]) => value)).toString();
}

async function fetchRuns() {
  const question = query();
  try {
    if (!choices.camera.length) {
      const all = await look('/api/fleet/runs');
      for (const key of ['camera', 'station']) choices[key] = [...new Set(all.map(run => run[key]))].sort();
    }
    cameras = (await look('/api/fleet/cameras')).cameras;
    runs = await look(`/api/fleet/runs?${question}`);
    charts = wanted.camera ? await look(`/api/fleet/charts?camera=${encodeURIComponent(wanted.camera)}`) : null;
    trouble = '';
  } catch (error) {
    trouble = error.message;
  }
}

function choice(label, key, values, again) {
  return make('label', {}, label, make('select', {onchange: event => { wanted[key] = event.target.value; again(); }},
    ['', ...values].map(value => make('option', {value, selected: value === wanted[key]}, value || text('all')))));
}

function worst(run) {
  const measured = run.quantities.filter(one => one.value !== null && one.limit);
  if (!measured.length) return '';
  const one = measured.reduce((a, b) => (b.value + b.u) / b.limit > (a.value + a.u) / a.limit ? b : a);
  return `${figure(one.value)} \u00b1 ${figure(one.u, 2)} ${one.unit} (${text('limit')} ${figure(one.limit)})`;
}

function runTable() {
  if (!runs?.length) return make('p', {class: 'soft'}, text('no_runs'));
  return table([text('date'), text('camera'), text('station'), text('outcome'), text('value'), text('who'), ''], runs.map(run => [
    run.started_utc.replace('T', ' ').replace('Z', ''), run.camera, run.station, make('strong', {class: tone[run.outcome] ?? ''}, run.outcome), worst(run), run.operator,
    make('a', {href: `/report?record=${encodeURIComponent(run.record)}`, target: '_blank', rel: 'noopener', 'aria-label': `${text('report')} ${run.record}`}, text('report'))]), text('runs'));
}

// ---- the state of each camera

function stateOf(camera) {
  const shown = camera.trends.filter(one => one.trend);
  const words = [];
  if (camera.is_due) words.push(make('strong', {class: 'bad'}, text(camera.due ? 'due_since' : 'due_now', {day: camera.due})));
  for (const quantity of camera.alarms) words.push(make('strong', {class: 'bad'}, `${text('drift')}: ${session.quantities[quantity] ?? quantity}`));
  for (const one of shown)
    words.push(make('strong', {class: 'bad'}, text('trend', {quantity: session.quantities[one.quantity] ?? one.quantity, rate: figure(one.per_year, 2), unit: one.unit, n: one.runs})));
  return words.length ? make('div', {}, words.map(word => make('div', {}, word))) : make('span', {class: 'good'}, text('no_drift'));
}

function cameraTable() {
  const wantedOnes = (cameras ?? []).filter(one => (!wanted.camera || one.camera === wanted.camera) && (!wanted.station || one.station === wanted.station));
  if (!wantedOnes.length) return make('p', {class: 'soft'}, text('no_runs'));
  return [table([text('camera'), text('station'), text('last_run'), text('outcome'), text('runs'), text('due'), text('state')], wantedOnes.map(one => [
    one.camera, one.station, one.last_utc.slice(0, 10), make('strong', {class: tone[one.last_outcome] ?? ''}, one.last_outcome), one.runs, one.due ?? '', stateOf(one)]), text('cameras')),
  make('p', {class: 'soft small'}, text('fleet_legend'))];
}

// ---- control charts

function chartPicture(chart) {
  const width = 460, height = 210, left = 48, right = 14, top = 14, bottom = 28;
  const points = chart.runs.map(run => ({...run, u: run.expanded_uncertainty ?? 0}));
  const limit = points.at(-1).limit;
  const high = 1.05 * Math.max(limit ?? 0, ...points.map(p => p.value + p.u)), low = Math.min(0, ...points.map(p => p.value - p.u));
  const x = i => left + (points.length === 1 ? 0.5 : i / (points.length - 1)) * (width - left - right);
  const y = value => top + (high - value) / (high - low || 1) * (height - top - bottom);
  const along = values => values.map(([i, value]) => `${x(i).toFixed(1)},${y(value).toFixed(1)}`).join(' ');
  const upper = points.map((p, i) => [i, p.value + p.u]), lower = points.map((p, i) => [i, p.value - p.u]).reverse();
  return svg('svg', {class: 'chart', viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': text('chart_label', {quantity: chart.quantity, camera: chart.camera, n: points.length})},
    svg('polygon', {class: 'band', points: along([...upper, ...lower])}),
    limit ? svg('line', {class: 'limit', x1: left, x2: width - right, y1: y(limit), y2: y(limit)}) : null,
    svg('polyline', {class: 'line', points: along(points.map((p, i) => [i, p.value]))}),
    points.map((p, i) => svg('line', {class: 'band bar', x1: x(i), x2: x(i), y1: y(p.value - p.u), y2: y(p.value + p.u)})),
    points.map((p, i) => svg('circle', {class: p.alarm ? 'alarm' : 'dot', cx: x(i), cy: y(p.value), r: p.alarm ? 6 : 4}, svg('title', {}, `${p.started_utc}: ${figure(p.value)} \u00b1 ${figure(p.u, 2)}, ${p.outcome}`))),
    [0, high / 1.05].map(value => svg('text', {x: left - 8, y: y(value) + 4, 'text-anchor': 'end'}, figure(value, 2))),
    svg('text', {x: left, y: height - 6}, points[0].started_utc.slice(0, 10)),
    svg('text', {x: width - right, y: height - 6, 'text-anchor': 'end'}, points.at(-1).started_utc.slice(0, 10)));
}

function chartCards() {
  if (!charts) return make('p', {class: 'soft'}, text('charts_hint'));
  return [make('div', {class: 'columns two'}, charts.charts.map(chart => make('figure', {}, make('h3', {}, `${session.quantities[chart.quantity] ?? chart.quantity} / ${chart.unit}, ${chart.station} `,
    make('strong', {class: chart.drifts ? 'bad' : 'good'}, text(chart.drifts ? 'drift' : 'no_drift'))), chartPicture(chart)))),
  make('p', {class: 'soft small'}, text('chart_legend'))];
}

export const fleetView = {
  draw(container, state, page) {
    const again = () => { asked = ''; fleetView.draw(container, state, page); };
    const moment = `${query()} ${state.run?.going ?? ''}`;  // a run that ends is one more
    if (asked !== moment) {
      asked = moment;
      if (state.run) choices.camera = [];
      fetchRuns().then(() => fleetView.draw(container, state, page));
    }
    show(container, ['fleet', wanted, choices, runs, cameras, charts?.charts, trouble, document.documentElement.lang], () => [make('h1', {}, text('view_fleet')),
      trouble ? make('p', {class: 'bad'}, trouble) : null,
      make('div', {class: 'row'}, choice(text('camera'), 'camera', choices.camera, again), choice(text('station'), 'station', choices.station, again),
        choice(text('outcome'), 'outcome', ['PASS', 'FAIL', 'INCONCLUSIVE', 'ERROR', 'ABORTED'], again)),
      card(text('cameras'), cameraTable()), card(text('charts'), chartCards()), card(text('runs'), runTable())]);
  },
};
