// A run: from the camera's serial number to the verdict.
import {card, draw as svg, facts, figure, make, show, table} from './dom.js';
import {look, session} from './server.js';
import {clock, duration, text} from './strings.js';

const phases = ['preparing', 'measuring', 'analysing', 'ended'];
let wantsNew = false;          // after a verdict: the next run is typed in
let plan = {name: '', axes: [], poses: []};

function chooser(page) {
  if (session.stations.length === 1) return null;
  return make('label', {class: 'wide'}, text('station'), make('select', {name: 'station',
    onchange: event => { page.station = Number(event.target.value); }},
  session.stations.map((station, i) => make('option', {value: i, selected: i === page.station}, station.id))));
}

function operatorField(page) {
  return make('label', {class: 'wide'}, text('operator'), make('input', {name: 'operator', value: page.operator,
    maxlength: 60, required: true, autocomplete: 'off', oninput: event => { page.operator = event.target.value; }}));
}

// ---- before

function newRun(page) {
  const station = session.stations[page.station];
  const serial = make('input', {class: 'serial', name: 'serial', required: true, autocomplete: 'off', spellcheck: 'false',
    maxlength: 200, value: session.has_calibrations ? '' : station.serial});
  const form = make('form', {onsubmit: async event => {
    event.preventDefault();
    if (await page.attempt('/api/run/start', {station: page.station, serial: serial.value.trim(), operator: page.operator.trim()}))
      wantsNew = false;
  }},
  make('div', {class: 'row'}, chooser(page), make('label', {class: 'wide'}, text('serial'), serial)),
  make('p', {class: 'soft small'}, text('serial_hint')),
  make('div', {class: 'row'}, operatorField(page)),
  make('div', {class: 'row'}, make('button', {class: 'main large'}, text('start')),
    make('span', {class: 'soft'}, `${station.id}: ${text('run_from', station)}`)));
  return make('section', {class: 'card'}, make('h1', {}, text('new_run')), form);
}

function unfinished(runs, page) {
  if (!runs.length) return null;
  const goOn = run => make('button', {type: 'button', 'aria-label': `${text('go_on')}: ${run.record}`,
    onclick: async () => {
      if (!page.operator.trim()) return page.complain(text('operator_missing'));
      if (await page.attempt('/api/run/resume', {record: run.record, operator: page.operator.trim()})) wantsNew = false;
    }}, text('go_on'));
  return card(text('unfinished'), make('p', {class: 'soft'}, text('unfinished_hint')),
    table([text('camera'), text('begun'), text('ended_because'), ''],
      runs.map(run => [run.camera, run.started_utc.replace('T', ' ').replace('Z', ''), run.reason, goOn(run)]), text('unfinished')));
}

function before(container, state, page) {
  show(container, ['before', state.unfinished, page.station, document.documentElement.lang], () =>
    make('div', {class: 'starts'}, newRun(page), unfinished(state.unfinished, page)));
}

// ---- while it goes on

function steps(run) {
  const at = phases.indexOf(run.phase);
  return make('ol', {class: 'steps'}, phases.map((phase, i) =>
    make('li', {class: i < at ? 'past' : null, 'aria-current': i === at ? 'step' : null}, text(`phase_${phase}`))));
}

// The program's own line on a phase that is not in the record: "analysing: 22 of 60, 3 s left".
function toldProgress(run) {
  const told = /^\w+: (\d+) of (\d+), (.+) left$/.exec(run.said ?? '');
  return told ? {done: Number(told[1]), all: Number(told[2]), left: told[3]} : null;
}

function progress(run) {
  if (run.phase === 'measuring')
    return {left: duration(run.seconds_left), done: run.visited, all: run.poses, what: text('poses_done', run)};
  const told = run.phase === 'analysing' ? toldProgress(run) : null;
  return {left: told?.left ?? '', done: told?.done, all: told?.all ?? 1,
    what: text(run.phase === 'analysing' ? 'analysing' : 'preparing')};
}

function head(run) {
  const now = progress(run);
  return [steps(run),
    make('p', {class: 'left'}, now.left || '\u2026', now.left ? make('small', {}, ` ${text('left')}`) : null),
    make('progress', {max: now.all, value: now.done, 'aria-label': now.what}),
    make('p', {}, `${text('camera')} ${run.serial}: ${now.what}`)];
}

function pauseButton(run, page) {
  return [make('button', {type: 'button', disabled: run.pausing, onclick: () => page.attempt('/api/run/pause')}, text(run.pausing ? 'pausing' : 'pause')),
    make('span', {class: 'soft small'}, text('pause_hint'))];
}

function pictures(run) {
  if (run.latest_pose === undefined || run.latest_pose < 0) return null;
  const of = (kind, caption) => make('figure', {}, make('img', {src: `/api/run/${kind}.jpg?pose=${run.latest_pose}&run=${encodeURIComponent(run.name)}`,
    alt: caption}), make('figcaption', {}, caption));
  return make('section', {class: 'card pair'}, of('photo', text('photograph', {pose: run.latest_pose + 1})), of('render', text('render')));
}

// Two axes of the plan, the second upwards.
function projection(run, across, up) {
  const width = 260, height = 200, edge = 24;
  const scale = (axis, value, size, flip) => {
    const share = (value - axis.low) / (axis.high - axis.low || 1);
    return edge + (flip ? 1 - share : share) * (size - 2 * edge);
  };
  const [a, b] = [plan.axes[across], plan.axes[up]];
  const dot = (pose, i) => {
    const cx = scale(a, pose.target[across], width), cy = scale(b, pose.target[up], height, true);
    const mark = run.marks?.[i] ?? '.';
    const kind = {'.': 'planned', o: 'seen', x: 'missed'}[mark];
    return [mark === 'x' ? svg('path', {class: kind, d: `M${cx - 4} ${cy - 4}l8 8m0-8l-8 8`}) : svg('circle', {class: kind, cx, cy, r: mark === 'o' ? 4 : 3}),
      i === run.latest_pose ? svg('circle', {class: 'latest', cx, cy, r: 8}) : null];
  };
  return svg('svg', {viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': text('volume_label', run)},
    svg('rect', {class: 'frame', x: edge - 10, y: edge - 10, width: width - 2 * edge + 20, height: height - 2 * edge + 20, rx: 6}),
    plan.poses.map(dot),
    svg('text', {x: width / 2, y: height - 2, 'text-anchor': 'middle'}, `${a.name} / ${a.unit}`),
    svg('text', {x: 10, y: height / 2, 'text-anchor': 'middle', transform: `rotate(-90 10 ${height / 2})`}, `${b.name} / ${b.unit}`));
}

function volume(run) {
  if (plan.name !== run.name || plan.axes.length < 2) return null;
  return card(text('volume'), make('div', {class: 'pair narrow'}, projection(run, 0, 1), plan.axes.length > 2 ? projection(run, 0, 2) : null),
    make('p', {class: 'soft small'}, text('legend')));
}

async function fetchPlan(run) {
  if (plan.name === run.name || !run.poses || fetchPlan.busy) return;
  fetchPlan.busy = true;
  const read = await look('/api/run/plan').catch(() => null);
  fetchPlan.busy = false;
  if (read) plan = {name: run.name, ...read};
}

function figures(run) {
  if (!run.visited) return null;
  return card(text('first_figures'), facts([
    [text('marker_seen_in'), run.seen, text('of_poses', run)],
    [text('corner_noise'), run.corner_noise_px === null ? null : figure(run.corner_noise_px), 'px'],
    [text('frames_again'), run.rejected_frames]]),
  run.remarks?.length ? make('ul', {class: 'small'}, run.remarks.map(remark => make('li', {}, remark))) : null);
}

function going(container, run, page) {
  fetchPlan(run);
  show(container, ['going', run.name, document.documentElement.lang], () => [
    make('section', {class: 'card'}, make('div', {'data-part': 'head'}), make('div', {class: 'row', 'data-part': 'pause'})), make('div', {'data-part': 'seen'})]);
  const [first, buttons, second] = ['head', 'pause', 'seen'].map(name => container.querySelector(`[data-part=${name}]`));
  show(first, [run.phase, run.visited, run.said, run.serial, Math.round(run.seconds_left ?? 0)], () => head(run));
  show(buttons, [run.pausing], () => pauseButton(run, page));
  show(second, [run.latest_pose, run.marks, run.remarks, plan.name], () => make('div', {class: 'columns wide-left'},
    make('div', {}, pictures(run), figures(run)), make('div', {}, volume(run))));
}

// ---- after

const tone = {PASS: 'good', FAIL: 'bad', INCONCLUSIVE: 'unsure', ERROR: 'bad'};

function quantities(list) {
  if (!list?.length) return null;
  return table([text('quantity'), text('value'), 'U', text('limit'), text('outcome')], list.map(one => [
    session.quantities[one.name] ?? one.name, `${figure(one.value)} ${one.unit}`, `${figure(one.expanded_uncertainty, 2)} ${one.unit}`, `${figure(one.limit)} ${one.unit}`,
    make('strong', {class: tone[one.outcome] ?? ''}, one.outcome)]), text('quantity'));
}

function section(title, lines) {
  if (!lines?.length) return null;
  return [make('h3', {}, title), lines.length === 1 ? make('p', {}, lines[0]) : make('ul', {}, lines.map(line => make('li', {}, line)))];
}

// The quantities of a sentence by their words.
function inWords(sentence) {
  return Object.entries(session.quantities).reduce((told, [name, words]) => told.replaceAll(name, words), sentence);
}

function verdictOf(run) {
  const outcome = run.result?.outcome ?? run.outcome;
  if (outcome === 'ABORTED' && run.pausing) return {kind: 'ABORTED', word: text('word_PAUSED'), meaning: text('means_PAUSED')};
  if (outcome === 'ABORTED') return {kind: outcome, word: text('word_ABORTED'), meaning: text('means_ABORTED')};
  if (!outcome) return {kind: 'ERROR', word: 'ERROR', meaning: text('not_started')};
  return {kind: outcome, word: outcome, meaning: text(`means_${outcome}`)};
}

function after(container, state, page) {
  const run = state.run, result = run.result ?? {}, verdict = verdictOf(run);
  const canGoOn = ['ERROR', 'ABORTED'].includes(result.outcome);
  show(container, ['after', run.name, run.failure, result, run.pausing, document.documentElement.lang], () => [
    make('section', {class: `card verdict ${verdict.kind}`, 'aria-live': 'polite'},
      make('p', {class: 'soft'}, `${text('camera')} ${run.serial}, ${run.operator}`),
      make('h1', {class: 'word'}, verdict.word), make('p', {class: 'meaning'}, verdict.meaning),
      result.cause ? section(text('most_probable'), [`${result.cause.text} (${text('percent', {n: Math.round(100 * result.cause.probability)})})`]) : null,
      result.cause ? section(text('to_do'), result.cause.remedies) : null,
      section(text('why'), [run.failure || result.reason, ...(result.reasons ?? [])].filter(Boolean).map(inWords)),
      section(text('findings'), result.findings),
      make('div', {class: 'row'},
        result.has_report ? make('a', {class: 'button main', href: `/report?record=${encodeURIComponent(run.name)}`, target: '_blank', rel: 'noopener'}, text('open_report')) : null,
        canGoOn ? make('button', {type: 'button', class: result.has_report ? null : 'main', onclick: () => page.attempt('/api/run/resume', {record: run.name, operator: page.operator.trim() || run.operator})}, text('go_on')) : null,
        make('button', {type: 'button', onclick: () => { wantsNew = true; before(container, state, page); }}, text('another')))),
    result.quantities?.length ? make('section', {class: 'card'}, quantities(result.quantities)) : null]);
}

export const runView = {
  draw(container, state, page) {
    if (state.run?.going) {
      wantsNew = false;
      going(container, state.run, page);
    } else if (state.run && !wantsNew) {
      after(container, state, page);
    } else {
      before(container, state, page);
    }
  },
};
