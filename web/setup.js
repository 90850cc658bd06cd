// Setting a station up: the camera's picture, the stage, what the plan will see, the devices.
import {card, facts, figure, make, show, table} from './dom.js';
import {look, session} from './server.js';
import {duration, text} from './strings.js';

let stage, step = 1, forecast = null, devices = null, timer = null;

function part(name) { return make('div', {'data-part': name}); }

// ---- the camera's picture

function liveFacts(live) {
  return facts([[text('sharpness'), figure(live.sharpness)], [text('saturated'), figure(100 * live.saturated, 2), '%'],
    [text('brightness'), figure(live.mean)], [text('noise'), figure(live.noise)],
    [text('per_second'), figure(live.per_second, 2), '/ s'], [text('bad_frames'), live.bad || null]]);
}

function picture(container, live, page) {
  const isOn = Boolean(live?.on), hasPicture = isOn && live.mean !== undefined, station = session.stations[page.station];
  show(container, [isOn, hasPicture, live?.fault, page.station], () => card(text('live'),
    hasPicture ? make('figure', {}, make('img', {src: `/api/live.mjpg?at=${Date.now()}`, alt: text('live_alt')}))
      : make('p', {class: 'soft'}, isOn ? text('live_wait') : live?.fault || text('live_off')),
    hasPicture ? [part('marker'), part('figures'), adjustment(live, page)] : null,
    hasPicture ? make('p', {class: 'soft small'}, text('live_settings_hint', {exposure: station.exposure_us, gain: station.gain_db})) : null,
    make('div', {class: 'row'}, make('button', {type: 'button', class: isOn ? null : 'main',
      onclick: () => page.attempt(isOn ? '/api/live/end' : '/api/live/start', {station: page.station})}, text(isOn ? 'live_end' : 'live_start')))));
  if (!hasPicture) return;
  show(container.querySelector('[data-part=marker]'), [live.marker_seen, live.marker_detail], () => make('p', {class: live.marker_seen ? 'good' : 'unsure'},
    live.marker_seen ? text('marker_yes') : text('marker_no', {why: live.marker_detail || '\u2026'})));
  show(container.querySelector('[data-part=figures]'), live, () => liveFacts(live));
}

function adjustment(live, page) {
  const exposure = make('input', {type: 'number', min: 1, max: 60000000, step: 'any', value: live.exposure_us, required: true});
  const gain = make('input', {type: 'number', min: 0, max: 100, step: 'any', value: live.gain_db, required: true});
  return make('form', {class: 'row', onsubmit: event => {
    event.preventDefault();
    page.attempt('/api/live/set', {exposure_us: exposure.valueAsNumber, gain_db: gain.valueAsNumber});
  }}, make('label', {}, `${text('exposure')} / \u00b5s`, exposure), make('label', {}, `${text('gain')} / dB`, gain), make('button', {}, text('set')));
}

// ---- the stage

function told(axis) {
  if (axis.emergency_stop) return ['bad', text('emergency_stop')];
  if (axis.alarm) return ['bad', text('alarm', {code: axis.alarm})];
  if (axis.limit) return ['unsure', text('at_limit')];
  const words = [axis.enabled ? text('enabled') : text('off'), axis.homed ? text('homed') : text('not_homed')];
  if (axis.moving) words.push(text('moving'));
  return ['', words.join(', ')];
}

function jogButton(axis, sign, page, isFree) {
  const name = text(sign < 0 ? 'axis_minus' : 'axis_plus', {axis: axis.name, step, unit: axis.unit});
  return make('button', {type: 'button', 'aria-label': name, disabled: !isFree || !axis.homed,
    onclick: () => asked(page) && page.attempt('/api/stage/jog', {station: page.station, operator: page.operator.trim(), axis: axis.name, step: sign * step})},
  sign < 0 ? '\u2212' : '+');
}

function asked(page) {
  if (page.operator.trim()) return true;
  page.complain(text('operator_missing'));
  return false;
}

function stageCard(container, state, page) {
  const isFree = state.work.kind === 'none', axes = stage?.axes;
  show(container, [axes?.map(axis => [axis.name, axis.homed]), stage === undefined, step, isFree, page.station], () => card(text('stage'),
    axes ? axes.map(axis => make('div', {class: 'axis', role: 'group', 'aria-label': axis.name}, make('span', {class: 'letter'}, axis.name),
      make('span', {class: 'position', 'data-axis': 'position'}), make('span', {class: 'jog'}, jogButton(axis, -1, page, isFree), jogButton(axis, 1, page, isFree)),
      make('span', {class: 'told', 'data-axis': 'told'}))) : make('p', {class: 'unsure'}, stage === undefined ? '\u2026' : text('stage_unknown')),
    make('div', {class: 'row'}, make('label', {}, text('step'), make('select', {onchange: event => { step = Number(event.target.value); container.shownKey = undefined; stageCard(container, page.state, page); }},
      [0.01, 0.1, 1, 10, 50].map(size => make('option', {value: size, selected: size === step}, String(size))))),
    make('label', {class: 'wide'}, text('operator'), make('input', {name: 'operator', value: page.operator, maxlength: 60, autocomplete: 'off',
      oninput: event => { page.operator = event.target.value; }}))),
    make('div', {class: 'row'}, make('button', {type: 'button', disabled: !isFree, onclick: async () => {
      if (asked(page) && await page.ask(text('home_question')))
        page.attempt('/api/stage/home', {station: page.station, operator: page.operator.trim()});
    }}, text('home')))));
  container.querySelectorAll('.axis').forEach((row, i) => {
    const [kind, words] = told(axes[i]);
    row.querySelector('[data-axis=position]').textContent = `${axes[i].position.toFixed(3)} ${axes[i].unit}`;
    row.querySelector('[data-axis=told]').textContent = words;
    row.querySelector('[data-axis=told]').className = `told ${kind}`;
  });
}

async function askStage(page) {
  stage = await look(`/api/stage?station=${page.station}`).catch(() => null);
}

// ---- what the plan will see

function warnings(plan) {
  const list = [];
  if (plan.detected_poses < plan.poses) list.push(text('warn_undetected', {n: plan.detected_poses, poses: plan.poses}));
  for (const one of plan.quantities)
    if (one.uncertainty_over_limit > 0.5) list.push(text('warn_wide', {name: session.quantities[one.name] ?? one.name, n: Math.round(100 * one.uncertainty_over_limit)}));
  const blind = plan.errors.filter(error => error.outcome !== 'OBSERVABLE').map(error => error.name);
  if (blind.length) list.push(text('warn_blind', {names: blind.join(', ')}));
  return list;
}

function planTables(plan) {
  const list = warnings(plan);
  return [make('h3', {}, text('plan_warnings')), list.length ? make('ul', {class: 'unsure'}, list.map(line => make('li', {}, line))) : make('p', {class: 'good'}, text('plan_no_warnings')),
    make('p', {}, text('plan_does', {...plan, time: duration(plan.duration_s)})),
    table([text('quantity'), text('limit'), text('expected_u'), text('share')], plan.quantities.map(one => [session.quantities[one.name] ?? one.name,
      `${figure(one.limit)} ${one.unit}`, `${figure(one.expected_uncertainty, 2)} ${one.unit}`,
      make('meter', {min: 0, max: 1, high: 0.5, optimum: 0, value: Math.min(1, one.uncertainty_over_limit), 'aria-label': `${Math.round(100 * one.uncertainty_over_limit)} %`})]), text('plan')),
    make('details', {}, make('summary', {}, text('detectable')), table([text('error'), text('detectable')],
      plan.errors.filter(error => error.outcome === 'OBSERVABLE').map(error => [error.name, `${figure(error.detectable_size)} ${error.unit === '1' ? '' : error.unit}`]), text('detectable')))];
}

function planCard(container, page) {
  show(container, [forecast, page.station], () => card(text('plan'), make('p', {class: 'soft'}, forecast?.going ? text('plan_going') : text('plan_hint')),
    forecast?.failure ? make('p', {class: 'bad'}, forecast.failure) : null, forecast?.plan ? planTables(forecast.plan) : null,
    make('div', {class: 'row'}, make('button', {type: 'button', disabled: Boolean(forecast?.going),
      onclick: async () => { if (await page.attempt('/api/forecast', {station: page.station})) forecast = {going: true}; }}, text('plan_compute')))));
}

// ---- devices

function devicesCard(container, page) {
  const found = devices?.camera_backends?.flatMap(backend => backend.cameras) ?? [];
  show(container, [devices], () => card(text('devices'), make('p', {class: 'soft'}, text('devices_hint')),
    found.length ? table([text('model'), text('serial'), text('address'), text('fault')], found.map(camera => [`${camera.vendor} ${camera.model}`, camera.serial, camera.uri, camera.fault]), text('devices'))
      : devices ? make('p', {}, text('devices_none')) : null,
    make('div', {class: 'row'}, make('button', {type: 'button', onclick: async event => {
      event.target.disabled = true;
      devices = await page.attempt('/api/devices') ?? devices;
      container.shownKey = undefined;
      devicesCard(container, page);
    }}, text('devices_find')))));
}

function stationChooser(page) {
  if (session.stations.length === 1) return null;
  return make('div', {class: 'row'}, make('label', {}, text('station'), make('select', {onchange: event => { page.station = Number(event.target.value); stage = undefined; forecast = null; }},
    session.stations.map((station, i) => make('option', {value: i, selected: i === page.station}, station.id)))));
}

export const setupView = {
  draw(container, state, page) {
    show(container, ['setup', page.station, document.documentElement.lang], () => [make('h1', {}, session.stations[page.station].id), stationChooser(page),
      make('div', {class: 'columns two'}, make('div', {}, part('picture'), part('devices')), make('div', {}, part('stage'), part('plan')))]);
    const [pictured, found, moved, planned] = ['picture', 'devices', 'stage', 'plan'].map(name => container.querySelector(`[data-part=${name}]`));
    picture(pictured, state.live, page);
    stageCard(moved, state, page);
    planCard(planned, page);
    devicesCard(found, page);
    if (timer) return;
    const ask = async () => {
      await askStage(page);
      if (forecast === null || forecast.going) forecast = await look(`/api/forecast?station=${page.station}`).catch(() => forecast);
      if (!container.hidden) setupView.draw(container, page.state, page);
    };
    timer = setInterval(ask, 1000);
    ask();
  },
  leave() {
    clearInterval(timer);
    timer = null;
  },
};
