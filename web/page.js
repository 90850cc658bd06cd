// The page: which view is shown, what goes on, and Stop, which is on every view.
import {act, begin, follow, Refused, session} from './server.js';
import {clock, kept, language, speak, text} from './strings.js';
import {fleetView} from './fleet.js';
import {runView} from './run.js';
import {setupView} from './setup.js';

const by = id => document.getElementById(id);
const views = {setup: setupView, run: runView, fleet: fleetView};
let state = null;

// What all views share.
export const page = {
  get station() {  // what is kept may be anything
    const index = Number(kept.get('station'));
    return Number.isInteger(index) && index in session.stations ? index : 0;
  },
  set station(index) { kept.set('station', index); redraw(); },
  get operator() { return kept.get('operator') ?? ''; },
  set operator(name) { kept.set('operator', name); },
  get state() { return state; },

  // What a person asked for: why it was refused is said on top.
  async attempt(path, body) {
    if (!tellStatus.isUnconfirmed) by('trouble').textContent = '';
    try {
      return await act(path, body);
    } catch (error) {
      by('trouble').textContent = error instanceof Refused ? error.message : text('lost');
      return null;
    }
  },
  complain(message) { by('trouble').textContent = message; },
  ask(question) {
    const dialog = by('question');
    by('question_text').textContent = question;
    dialog.returnValue = 'no';
    dialog.showModal();
    return new Promise(resolve => dialog.addEventListener('close', () => resolve(dialog.returnValue === 'yes'), {once: true}));
  },
};

function chosenView() {
  const name = location.hash.slice(1);
  return name in views ? name : 'run';
}

function showView() {
  for (const [name, view] of Object.entries(views)) {
    const is = name === chosenView();
    by(name).hidden = !is;
    const link = document.querySelector(`nav a[href="#${name}"]`);
    is ? link.setAttribute('aria-current', 'page') : link.removeAttribute('aria-current');
    if (!is) view.leave?.();
  }
  draw();
}

function draw() {
  if (state) views[chosenView()].draw(by(chosenView()), state, page);
}

function redraw() {
  for (const name of Object.keys(views)) by(name).shownKey = undefined;
  for (const part of document.querySelectorAll('main [data-part]')) part.shownKey = undefined;
  draw();
}

function tellStatus() {
  const {work} = state, moves = work.kind !== 'none';
  let told = moves ? text('by_since', {what: text(`work_${work.kind}`), who: work.who, time: clock(work.since_utc)})
    : text('idle');
  if (work.stop === 'stopping') told = text('stop_stopping');
  else if (work.stop === 'confirmed') told = text('stop_confirmed');
  const wasUnconfirmed = tellStatus.isUnconfirmed;
  tellStatus.isUnconfirmed = Boolean(work.stop) && !['stopping', 'confirmed'].includes(work.stop);
  if (tellStatus.isUnconfirmed) {
    told = moves ? told : '';
    page.complain(text('stop_failed', {why: work.stop}));
  } else if (wasUnconfirmed) page.complain('');
  else if (work.failure && work.failure !== tellStatus.failure) page.complain(work.failure);
  tellStatus.failure = work.failure;
  by('status').textContent = told;
  by('status').className = moves || work.stop === 'stopping' ? 'busy' : '';
}

function translate() {
  document.documentElement.lang = language();
  for (const element of document.querySelectorAll('[data-text]')) element.textContent = text(element.dataset.text);
  for (const element of document.querySelectorAll('[data-label]')) element.setAttribute('aria-label', text(element.dataset.label));
  by('language').value = language();
}

async function open() {
  translate();
  by('language').addEventListener('change', event => {
    speak(event.target.value);
    translate();
    if (state) tellStatus();
    redraw();
  });
  // Whatever else this page is busy with: it only asks, the server stops.
  by('stop').addEventListener('click', () => page.attempt('/api/stop'));
  window.addEventListener('hashchange', showView);
  // A picture is a connection of its own, which a page that is not seen gives back.
  document.addEventListener('visibilitychange', () => {
    if (document.hidden) document.querySelectorAll('img[src*="live.mjpg"]').forEach(image => image.removeAttribute('src'));
    else redraw();
  });
  try {
    await begin();
  } catch (error) {
    page.complain(error instanceof Refused ? error.message : text('lost'));
    return setTimeout(() => location.reload(), 5000);
  }
  follow(next => {
    const wasLost = by('trouble').textContent === text('lost');
    state = next;
    if (wasLost) page.complain('');
    tellStatus();
    draw();
  }, () => page.complain(text('lost')));
  showView();
}

open();
